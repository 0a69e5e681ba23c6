"""Studies of parameters: one key of a scenario after the other, pairs, effectiveness."""
