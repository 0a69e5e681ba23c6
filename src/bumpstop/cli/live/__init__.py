"""Commands for a running arm."""
