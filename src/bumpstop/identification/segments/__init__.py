"""Segments of recordings that a fit uses, and what is wrong with some of them."""
