"""Studies: many laws with a question."""

from bumpstop.study.run import run
from bumpstop.study.study import Study, to_jsonable
from bumpstop.study.variable import Variable

__all__ = ["Study", "Variable", "run", "to_jsonable"]
