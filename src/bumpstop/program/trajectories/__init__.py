"""Trajectories and recordings as programs: their segments, and the same files with other times."""
