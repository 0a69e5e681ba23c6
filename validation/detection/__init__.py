"""Comparisons of the detector and of what it cannot detect."""
