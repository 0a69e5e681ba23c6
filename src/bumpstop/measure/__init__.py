"""Measuring collisions with a gauge."""
