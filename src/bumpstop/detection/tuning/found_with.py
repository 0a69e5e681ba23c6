"""What residuals were found with: it goes into their files with them, and into thresholds that are tuned on them."""

from __future__ import annotations

import zlib
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from bumpstop.errors import InputError
from bumpstop.model.dynamics import STANDARD_GRAVITY
from bumpstop.text_files import parse_toml, toml_value

if TYPE_CHECKING:
    from bumpstop.detection.settings import DetectorSettings
    from bumpstop.identification.dynamics.dynamics_model import DynamicsModel
    from bumpstop.joint import JointTorqueModel
    from bumpstop.model import Robot

SETTINGS = (
    "residual",
    "observer_gain_1_s",
    "window_s",
    "measured_rates",
    "limit_margin",
    "frozen_s",
    "payload_kg",
    "payload_center",
    "gravity",
    "causal",
)
"""Of the detector whose residuals thresholds were found for, beside its rate."""
# Beside these.
_PARTS = ("robot", "model")
# Residuals of which are signals of another kind: no threshold is one of both.
_KIND = ("residual", "observer_gain_1_s")
SAME_GAIN = 0.01
"""Share by which gains of observers may differ and are the same."""


def found_with(
    robot: Robot, model: JointTorqueModel | DynamicsModel | None, settings: DetectorSettings
) -> dict[str, Any]:
    """Robot, model and settings that decide what the residuals of a motion are.

    Returns:
        ``robot``: its name; ``model``: its kind and a check sum of its parameters, as it need not be a file; and
        settings by their names, as a file of thresholds has them, those that such a residual has.
    """
    from bumpstop.identification.dynamics.dynamics_model import DynamicsModel

    names = ["residual", "frozen_s"]
    fitted = isinstance(model, DynamicsModel)
    if fitted:
        names.append("causal")
    if settings.causal or not fitted:
        names += ["window_s", "measured_rates", "limit_margin", "payload_kg", "payload_center"]
    if settings.residual == "observer":
        names.append("observer_gain_1_s")
    found = {name: value for name in names if (value := getattr(settings, name)) is not None}
    falls = settings.gravity or (STANDARD_GRAVITY if model is None else model.gravity)
    if not fitted and falls != STANDARD_GRAVITY:
        found["gravity"] = falls
    return {"robot": robot.name, "model": _name_of(model)} | found


def _name_of(model: JointTorqueModel | DynamicsModel | None) -> str:
    from bumpstop.identification.dynamics.dynamics_model import DynamicsModel

    if model is None:
        return "none: recorded torque"
    if isinstance(model, DynamicsModel):
        parameters = [model.values, model.predicting, model.sign_speed, model.presliding, model.top_speed, model.gains]
        text = repr([None if one is None else one.tolist() for one in parameters])
        text += repr([model.columns, model.predicted_by_all, model.couplings, model.loaded, model.cutoff_hz])
        return f"fitted dynamics {zlib.crc32(text.encode()):08x}"
    return f"joint model {zlib.crc32(repr(model.joints).encode()):08x}"


def settings_of(found: Mapping[str, Any]) -> dict[str, Any]:
    """The settings of the detector among them."""
    return {name: value for name, value in found.items() if name not in _PARTS}


def to_text(found: Mapping[str, Any]) -> str:
    """As a file of residuals holds them: TOML."""
    return "\n".join(f"{name} = {toml_value(value)}" for name, value in found.items())


def from_text(text: str, file: str) -> dict[str, Any]:
    """What :func:`to_text` wrote; ``file`` is how errors call it.

    Raises:
        InputError: it is no such text, or holds settings that no detector has.
    """
    from bumpstop.detection.settings import DetectorSettings

    found = parse_toml(text, file)
    unknown = [name for name in found if name not in (*_PARTS, *SETTINGS)]
    try:
        if unknown:
            raise InputError(unknown[0], "is no setting of residuals")
        DetectorSettings(**settings_of(found))
    except InputError as error:
        raise InputError(file, f"says of its residuals what cannot be ({error})", "find them anew") from None
    return found


def check_kind(found: Mapping[str, Any], residual: str, observer_gain_1_s: float, field: str) -> None:
    """Refuse residuals of another kind than a detector has, where they say theirs.

    Args:
        found: what they were found with.
        residual: of the detector.
        observer_gain_1_s: of its observer [1/s].
        field: how the error calls the residuals.

    Raises:
        InputError: another kind, or an observer of another gain.
    """
    kind, gain = found.get("residual", residual), found.get("observer_gain_1_s", observer_gain_1_s)
    if kind != residual:
        raise InputError(field, f"holds the {kind} residual", f"the detector's is {residual!r}")
    if kind == "observer" and abs(gain - observer_gain_1_s) > SAME_GAIN * gain:
        raise InputError(
            field, f"holds residuals of an observer of {gain:g} 1/s", f"the detector's is of {observer_gain_1_s:g}"
        )


def of_another_robot(found: Mapping[str, Any], robot: str) -> list[str]:
    """A sentence where residuals say that they are of another robot than the one of this name, else none."""
    theirs = found.get("robot", robot)
    return [] if theirs == robot else [f"The residuals are of the robot {theirs!r}, and this one is {robot!r}."]


def in_common(sources: Sequence[tuple[str, Mapping[str, Any]]]) -> tuple[dict[str, Any], list[str]]:
    """What all residuals were found with, and sentences on what differs.

    Args:
        sources: name of the file, and what its residuals were found with; empty: it does not say.

    Raises:
        InputError: some are of the direct residual and others of an observer, or of observers of other gains.
    """
    dumb = [name for name, found in sources if not found]
    saying = [(name, found) for name, found in sources if found]
    if not saying:
        return {}, []
    notes = [
        f"{name} does not say what its residuals were found with: whether it is what those of {saying[0][0]} were is "
        "not known, and the thresholds do not say it either."
        for name in dumb
    ]
    (first, ours), *others = saying
    common = {} if dumb else dict(ours)
    for name, theirs in others:
        texts = {
            key: (_said(ours, key), _said(theirs, key))
            for key in dict.fromkeys([*ours, *theirs])
            if _said(ours, key) != _said(theirs, key)
        }
        for key in _KIND:
            if key in texts:
                mine, other = texts[key]
                raise InputError(name, f"holds residuals of {key} = {other}", f"those of {first} are of {mine}")
        common = {key: value for key, value in common.items() if key not in texts}
        if texts:
            which = ", ".join(f"{key} = {other} (there {mine})" for key, (mine, other) in texts.items())
            notes.append(
                f"The residuals of {name} were found with something else than those of {first}: {which}. The rate is "
                "that of both together, and need not be that of either; the thresholds do not say these settings."
            )
    return common, notes


def _said(found: Mapping[str, Any], name: str) -> str:
    return toml_value(found[name]) if name in found else "not said"
