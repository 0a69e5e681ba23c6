"""Comparisons of what measured forces tell."""
