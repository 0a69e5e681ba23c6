"""Comparisons of what is identified with what is true."""
