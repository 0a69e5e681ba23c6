"""Scenarios: the tables a person writes, read and checked."""
