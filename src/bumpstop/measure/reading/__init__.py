"""Recordings of gauges, read and judged."""
