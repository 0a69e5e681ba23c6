"""Pages of measurements: the sheet of a plan, recordings of gauges, what they say of a cell."""
