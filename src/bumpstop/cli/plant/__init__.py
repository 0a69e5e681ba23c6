"""Commands of the simulated arm."""
