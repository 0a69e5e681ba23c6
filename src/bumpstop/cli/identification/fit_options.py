"""Options of ``bumpstop identify`` that only some of its fits take."""

from __future__ import annotations

from collections.abc import Mapping

from bumpstop.errors import InputError

_JOINT, _DYNAMICS, _PAYLOAD, _PROTOCOL = "joint models", "dynamics", "a payload", "a protocol"
_DRIVE_TRAIN = "a drive train"
FITS = {
    "joint": _JOINT,
    "dynamics": _DYNAMICS,
    "payload": _PAYLOAD,
    "drive-train": _DRIVE_TRAIN,
    "protocol": _PROTOCOL,
}
# What each is written into in a folder.
FIT_FILES = {
    "joint": "joint_model.toml",
    "dynamics": "model.toml",
    "payload": "payload.toml",
    "drive-train": "drive_train.toml",
    "protocol": "joint_model.toml",
}
# The fits that take an option, and why the others do not, where that is worth a word.
_TAKEN_BY: Mapping[str, tuple[tuple[str, ...], Mapping[str, str]]] = {
    "--model": (("joint", "dynamics", "payload", "drive-train"), {"protocol": "leave it out: it finds a joint model"}),
    "--consistent": (("dynamics",), {}),
    "--shared-motor": (
        ("dynamics",),
        {"joint": "currents are taken joint by joint", "payload": "a payload is fitted to an arm that is known"},
    ),
    "--known": (("joint", "dynamics"), {}),
    "--cutoff": (("joint", "dynamics", "payload", "drive-train"), {}),
    "--pushes": (("drive-train",), {"dynamics": "give --model drive-train", "joint": "give --model drive-train"}),
    "--inertia-uncertainty": (("joint", "payload"), {"dynamics": "they are fitted without the robot's inertia"}),
    "--payload": (
        ("joint", "dynamics", "drive-train"),
        {"payload": "leave it out: it is what this fit looks for", "protocol": "leave it out: the plan says it"},
    ),
    "--joint-model": (("payload",), {"dynamics": "give --model payload"}),
    "--dynamics": (("payload",), {"dynamics": "give --model payload"}),
    "--mass": (("payload",), {"dynamics": "give --model payload"}),
    "--second-moments": (("payload",), {"dynamics": "give --model payload"}),
    "--base": (("joint", "dynamics", "payload", "drive-train"), {"protocol": "leave it out: the plan says it"}),
    "--tip": (("joint", "dynamics", "payload", "drive-train"), {"protocol": "leave it out: the plan says it"}),
    "--gravity": (("joint", "dynamics", "payload", "drive-train"), {"protocol": "leave it out: the plan says it"}),
}


def check_options(fit: str, options: Mapping[str, object]) -> None:
    """Reject options that the fit does not take.

    Args:
        fit: a key of ``FITS``.
        options: every option that only some fits take, by name; None, False or an empty list: not given.

    Raises:
        InputError: an option belongs to other fits; it names the option.
    """
    for option, value in options.items():
        fits, advice = _TAKEN_BY[option]
        if fit in fits or value is None or value is False or value == []:
            continue
        valid = advice.get(fit, "leave it out")
        if len(fits) == 1 and fit != "protocol":
            raise InputError(option, f"is for {FITS[fits[0]]}, not for {FITS[fit]}", valid)
        raise InputError(option, f"is not for {FITS[fit]}", valid)
