"""What a person called a value on the command line, where something refuses it by the name of a field."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from bumpstop.errors import InputError


@contextmanager
def as_options(names: Mapping[str, str]) -> Iterator[None]:
    """Raise refusals of the fields ``names`` again under the options they came from."""
    try:
        yield
    except InputError as error:
        raise InputError(names.get(error.field, error.field), error.problem, error.valid) from None
