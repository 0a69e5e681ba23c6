"""Collisions on a joint trajectory: the motion, the onset of contact, the result."""
