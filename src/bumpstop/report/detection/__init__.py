"""Pages about detection."""
