"""Sources that need no network: recordings and the simulated robot."""
