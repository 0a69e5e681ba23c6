"""The page of one collision."""
