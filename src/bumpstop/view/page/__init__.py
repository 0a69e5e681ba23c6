"""The page of one browser, and the server behind it."""
