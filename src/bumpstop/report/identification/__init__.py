"""Pages about identification."""
