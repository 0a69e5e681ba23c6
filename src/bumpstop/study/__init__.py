"""Studies: many laws with a question."""

from bumpstop.study.run import run
from bumpstop.study.study import Study, plain
from bumpstop.study.variable import Variable

__all__ = ["Study", "Variable", "plain", "run"]
