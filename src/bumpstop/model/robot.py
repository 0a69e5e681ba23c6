"""Robots: serial chains that are read from files, with the drive train that is known or assumed of them."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from importlib import resources
from pathlib import Path
from typing import Any

from bumpstop.arrays import as_name
from bumpstop.errors import InputError, near_matches
from bumpstop.model.drive_train.assumed import drive_train_of
from bumpstop.model.drive_train.drive_train import DriveTrain
from bumpstop.model.robot_file import fields_of
from bumpstop.model.serial_chain import SerialChain
from bumpstop.model.urdf.chain import chain_from_urdf
from bumpstop.text_files import as_path


@dataclass(frozen=True, kw_only=True, repr=False)
class Robot(SerialChain):
    """A serial chain of one to sixteen joints. Immutable.

    Attributes:
        name: short name, as scenarios use it.
        joints: from the base to the tip.
        tip_name: name of the tip frame.
        tip_origin: its position in the frame of the last link [m].
        tip_rotation: its orientation there, as rows of a rotation matrix.
        frames: further named frames fixed to the links.
        title, source, note: what it is, where its figures come from, what is uncertain about them.
        warnings: what its reader left out or doubted.
        mass_warnings: which of them are about masses, rotors and torque limits alone.
        payload_kg: rated payload, or None.
        inertia_status: ``"published"``, ``"unverified"`` (as a URDF has it), ``"assumed"`` (say so wherever it is used)
            or ``"unknown"`` (of some link).
        inertia_source: where the inertia comes from.
        drive_train_entries: what is known of its rotors, gears and servos; see :attr:`drive_train`.
        base_joints: joints of its URDF that move the base, which is taken to stand still.
        other_joints: joints of its URDF that move something on it beside the chain or beyond the tip.
    """

    @cached_property
    def drive_train(self) -> DriveTrain:
        """Its rotors, gears and servos: what is known of them, and a class of arms for the rest.

        Every quantity says by its status whether it is published, identified, unverified or assumed. A joint's
        own ``rotor_inertia`` counts. The class: :func:`bumpstop.model.drive_train.assumed.assumed_drive_train`.
        """
        return drive_train_of(self)

    @classmethod
    def load(cls, name: str) -> Robot:
        """Load a built-in robot by name.

        Raises:
            InputError: there is none of that name; near matches are offered.
        """
        if as_name(name, "robot", f"wanted one of {', '.join(robots())}") not in robots():
            file = Path(name).suffix in (".urdf", ".xml", ".xacro")
            valid = "wanted Robot.from_urdf(path)" if file else near_matches(str(name), robots())
            raise InputError("robot", f"there is no built-in robot {str(name)!r}", valid)
        return _load_builtin(name)

    @classmethod
    def from_urdf(
        cls, path: str | Path, base: str | None = None, tip: str | None = None, *, strict_inertia: bool = False
    ) -> Robot:
        """Read the chain between two links of a URDF file.

        Links that are fixed to each other become one, with the inertia of all of them; their names stay, as
        :attr:`frames`. What moves beside the chain is left out, and :attr:`warnings` says so.

        Args:
            path: of the file.
            base: link in whose frame everything is given; default: the root.
            tip: link at the end of the chain; default: the last link of the only chain.
            strict_inertia: refuse an inertia that no body can have, instead of warning.

        Raises:
            InputError: the file cannot be read, is no sound URDF, or has no such chain.
        """
        for field, link in (("base", base), ("tip", tip)):
            if link is not None:
                as_name(link, field)
        return chain_from_urdf(as_path(path, "path"), base, tip, make=cls, strict_inertia=strict_inertia)


@lru_cache
def robots() -> tuple[str, ...]:
    """Names of the built-in robots."""
    folder = resources.files("bumpstop.model") / "data"
    return tuple(sorted(Path(entry.name).stem for entry in folder.iterdir() if entry.name.endswith(".toml")))


def robot_from_dict(data: Mapping[str, Any]) -> Robot:
    """Build a robot from the contents of a robot file (see docs/reference/robot/model.md for its keys).

    Raises:
        InputError: a key is unknown, missing or has a value that cannot be used.
    """
    return Robot(**fields_of(data))


@lru_cache
def _load_builtin(name: str) -> Robot:
    text = (resources.files("bumpstop.model") / "data" / f"{name}.toml").read_text(encoding="utf-8")
    return robot_from_dict(tomllib.loads(text))
