"""Running arms: the control loop closed over networks, and damaged messages."""
