"""Payloads: declared, or identified."""
