"""From measured shots to the parameters of a cell."""
