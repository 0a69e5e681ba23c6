"""Residuals: what the detector sees when nothing is touched."""

from bumpstop.detection.residuals import ResidualRecord

__all__ = ["ResidualRecord"]
