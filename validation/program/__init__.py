"""Comparisons about programs of robots."""
