"""Trajectories and recordings as programs: their stretches, and the same files with other times."""
