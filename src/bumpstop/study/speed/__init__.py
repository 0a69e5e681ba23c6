"""Safe speeds: at a pose, along a trajectory, all over the workspace."""
