"""The page of a robot program."""
