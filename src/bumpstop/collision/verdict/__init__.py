"""Verdicts: a result against the limits, and the notes beside it."""
