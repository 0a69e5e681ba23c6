"""Published works that bumpstop reproduces, one room each."""
