"""Robot languages: syntax trees without loss, and what of them is understood."""
