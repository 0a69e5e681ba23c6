"""Distributions of the quantities of a collision, and what they are made of."""
