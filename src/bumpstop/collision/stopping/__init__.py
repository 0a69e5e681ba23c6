"""Stopping: distances that makers publish, the law of slowing down they obey, and what a scenario takes of it."""

from bumpstop.collision.stopping.stopping_fit import DecelerationFit, StoppingFit, fit_stopping
from bumpstop.collision.stopping.stopping_table import StoppingTable
from bumpstop.collision.stopping.table_file import load_stopping_table

__all__ = ["DecelerationFit", "StoppingFit", "StoppingTable", "fit_stopping", "load_stopping_table"]
