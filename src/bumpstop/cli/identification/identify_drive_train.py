"""``bumpstop identify --model drive-train``: rotors, servos and gears of an arm, as a drive train file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from bumpstop.cli.folders import writing
from bumpstop.cli.identification.fit_options import FIT_FILES
from bumpstop.cli.identification.fit_verdict import print_reading
from bumpstop.cli.progress import progress

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bumpstop.identification import Payload
    from bumpstop.identification.drive_train import DriveTrainFit, JointValues
    from bumpstop.model import Robot
    from bumpstop.recording import Recording

_NOT_USABLE = 3


def identify_drive_train_of(
    logs: Sequence[Recording],
    arm: Robot,
    *,
    pushes: Path | None,
    payloads: Sequence[Payload | None],
    cutoff_hz: float | None,
    gravity: tuple[float, float, float] | None,
    out: Path | None,
    as_json: bool,
) -> int:
    """Fit what recordings and pushes show of a drive train, write it, and print what was found."""
    from bumpstop.identification.drive_train import Pushes, identify_drive_train
    from bumpstop.identification.fit_verdict import reading_faults
    from bumpstop.model.dynamics import STANDARD_GRAVITY

    table = None if pushes is None else Pushes.load(pushes, arm)
    with progress("fitting"):
        found = identify_drive_train(
            logs, arm, pushes=table, payloads=payloads, cutoff_hz=cutoff_hz, gravity=gravity or STANDARD_GRAVITY
        )
    faults = reading_faults(logs)
    usable = found.identified and not faults
    file = out if out is None or out.suffix == ".toml" else out / FIT_FILES["drive-train"]
    if file is not None and out is not None and usable:
        with writing(None if file == out else out):
            found.save(file)
    if as_json:
        typer.echo(json.dumps(_json(found) | {"faults": faults}, allow_nan=False, indent=2))
    else:
        typer.echo(str(found))
        print_reading(list(logs))
        for fault in faults:
            typer.echo(f"not usable: {fault}")
        if file is not None and usable:
            typer.echo(f"drive train: {file}")
    return 0 if usable else _NOT_USABLE


def _json(found: DriveTrainFit) -> dict[str, Any]:
    return {
        "kind": "drive_train",
        "identified": list(found.identified),
        "quantities": {
            name: {
                "values": _numbers(values, values.values),
                "standard_errors": _numbers(values, values.errors),
                "reasons": list(values.reasons),
                "status": found.drive_train.status[name],
            }
            for name, values in found.found.items()
        },
        "not_looked_for": dict(found.reasons),
        "warnings": list(found.warnings),
    }


def _numbers(values: JointValues, numbers: Any) -> list[float | None]:
    return [float(x) if told else None for x, told in zip(numbers, values.identified, strict=True)]
