"""Statistics of the fits: robust least squares, correlated residuals, essential parameters."""
