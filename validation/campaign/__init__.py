"""Campaigns: faults survived, and how the cost grows."""
