"""What stands for the arm in a collision: its mass, its compliance, its torque limits, and the other arm beside it."""
