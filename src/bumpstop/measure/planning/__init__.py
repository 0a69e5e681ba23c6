"""Measurement plans: gauges, places, shots in order."""
