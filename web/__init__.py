"""The page of the documentation that computes collisions in the browser: what it is made of, and how it is made."""
