"""Along a trajectory: the highest safe speed at every waypoint, and the same path slowed down to it."""
