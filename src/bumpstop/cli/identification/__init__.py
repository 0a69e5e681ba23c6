"""Commands from recordings to models: recording, plan, identify, validate."""
