"""Tuning: thresholds from the residuals of contact-free motion."""
