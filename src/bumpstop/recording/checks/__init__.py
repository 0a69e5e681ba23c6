"""Checks of a recording: rows, time stamps, rates, limits."""
