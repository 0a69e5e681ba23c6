"""Scores: events against labels, and against measured contact forces."""
