"""Comparisons of collisions, their forces and what studies make of them."""
