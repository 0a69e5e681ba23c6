"""What the plant's arm runs into: bodies on a slide whose joint is the spring."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib import resources
from typing import Any

import numpy as np

from bumpstop.arrays import FloatArray, as_float_array, as_number
from bumpstop.errors import InputError, near_matches

# A body on its spring swings this fast where no mass is given [rad/s]: light enough to add no blow of its own at
# collision speeds, slow enough for the integration step.
_OWN_FREQUENCY = 2000.0
_DAMPING_RATIO = 0.3
# Of a free body's swing on its spring; its blow loses less than a fifth of a percent by it.
_FREE_DAMPING_RATIO = 0.001
_THICKNESS = 0.02
GAUGE = "gauge_"
_LIMITS = "bgia2011"


@lru_cache
def _kinds() -> dict[str, dict[str, Any]]:
    text = resources.files("bumpstop.plant").joinpath("data", "objects.toml").read_text(encoding="utf-8")
    kinds: dict[str, dict[str, Any]] = tomllib.loads(text)
    return kinds


@lru_cache
def _gauges() -> dict[str, Any]:
    text = resources.files("bumpstop.plant").joinpath("data", "gauges.toml").read_text(encoding="utf-8")
    return tomllib.loads(text)


def gauge_regions() -> tuple[str, ...]:
    """Body regions that have a gauge: arguments of :meth:`PlantObject.gauge`."""
    return tuple(_gauges()["spring_N_mm_and_shore_a"])


def gauge_pad_hardness(region: str) -> float:
    """Hardness of the pad of a region's gauge [Shore A]; the region is one of :func:`gauge_regions`."""
    return float(_gauges()["spring_N_mm_and_shore_a"][region][1])


def object_kinds() -> tuple[str, ...]:
    """Names of the objects whose stiffness is known: arguments of :meth:`PlantObject.of`."""
    return tuple(_kinds())


@dataclass(frozen=True, kw_only=True)
class PlantObject:
    """One object. Pushed along ``normal`` by x it pushes back with ``stiffness`` times x, at rest.

    It is clamped, unless it has a body's mass behind its spring: that gets away along the normal, and nothing holds it,
    unless it is a gauge, whose body stands on a spring of its own.

    Attributes:
        name: unique in a plant.
        position: where its face is touched first, in the base frame [m].
        normal: the direction it yields in: away from the arm, base frame; any length.
        stiffness: [N/m].
        mass: that moves with the face [kg]; None: so little that it swings on the spring with 2000 rad/s.
        damping_ratio: of that swing, 1 is critical; a free body has next to none.
        body_mass: of a free body or of a gauge, its face included [kg]; None: clamped.
        spring: of a gauge, between its body and the ground: what it shows is this spring's force [N/m]; None: no gauge.
            Its pad is ``stiffness``.
        spring_damping_ratio: of body and spring.
        size: half width and half height of the face [m].
        status: of the stiffness: ``"given"``, ``"published"``, ``"derived"`` or ``"assumed"``.
        source: where the stiffness comes from.
        colour: red, green, blue, 0 to 1.
    """

    name: str
    position: tuple[float, float, float]
    normal: tuple[float, float, float]
    stiffness: float
    mass: float | None = None
    damping_ratio: float = _DAMPING_RATIO
    body_mass: float | None = None
    spring: float | None = None
    spring_damping_ratio: float = _FREE_DAMPING_RATIO
    size: tuple[float, float] = (0.06, 0.06)
    status: str = "given"
    source: str = ""
    colour: tuple[float, float, float] = (0.34, 0.71, 0.91)

    def __post_init__(self) -> None:
        where = f"object {self.name!r}"
        as_float_array(self.position, f"{where} position", (3,))
        normal = as_float_array(self.normal, f"{where} normal", (3,))
        if np.linalg.norm(normal) < 1e-9:
            raise InputError(f"{where} normal", f"{list(self.normal)} is no direction", "wanted three numbers")
        for name, low, high in (("stiffness", 1.0, 1e7), ("damping_ratio", 0.0, 10.0)):
            if not low <= as_number(getattr(self, name), f"{where} {name}") <= high:
                raise InputError(f"{where} {name}", f"is {getattr(self, name)}", f"wanted {low:g} to {high:g}")
        if self.mass is not None:
            least = self.stiffness / 1e7
            if not least <= as_number(self.mass, f"{where} mass") <= 1e4:
                problem = f"{self.mass:g} kg on {self.stiffness:g} N/m cannot be used"
                raise InputError(f"{where} mass", problem, f"wanted {least:.3g} to 10000: lighter swings too fast")
        if self.body_mass is not None:
            least = 2 * self.moving_mass
            if not least <= as_number(self.body_mass, f"{where} body_mass") <= 1e4:
                problem = f"is {self.body_mass:g}, with {self.moving_mass:.3g} kg in its face"
                raise InputError(f"{where} body_mass", problem, f"wanted {least:.3g} to 10000 kg")
        if self.spring is not None:
            if self.body_mass is None:
                raise InputError(f"{where} body_mass", "is missing", "a gauge has a body between pad and spring")
            most = self.body_mass * 1e7
            for name, low, high in (("spring", 1.0, most), ("spring_damping_ratio", 0.0, 10.0)):
                if not low <= as_number(getattr(self, name), f"{where} {name}") <= high:
                    raise InputError(f"{where} {name}", f"is {getattr(self, name)}", f"wanted {low:g} to {high:g}")
        if not all(0 < length < math.inf for length in self.size):
            raise InputError(f"{where} size", f"is {self.size}", "wanted two finite lengths above 0")

    @classmethod
    def of(
        cls,
        kind: str,
        *,
        position: Sequence[float],
        normal: Sequence[float],
        name: str = "",
        stiffness: float | None = None,
        limits: str | None = None,
        **more: Any,
    ) -> PlantObject:
        """An object of a kind: foam, plexiglas, ..., or a body region of a limit table.

        Args:
            kind: one of :func:`object_kinds`, a body region of ``limits``, or ``"gauge_"`` and a region of
                :func:`gauge_regions`.
            position: as the attribute.
            normal: as the attribute.
            name: default: the kind.
            stiffness: replaces the kind's [N/m].
            limits: name or path of a limit table, of a body region only; None: ``"bgia2011"``.
            more: further attributes.

        Raises:
            InputError: there is no such kind or body region, or a limit table for what is none.
        """
        kinds = _kinds()
        if limits is not None and (kind.startswith(GAUGE) or kind in kinds):
            raise InputError("object.limits", f"has no meaning with {kind!r}", "leave it out: it is for body regions")
        if kind.startswith(GAUGE):
            more |= {} if stiffness is None else {"stiffness": stiffness, "status": "given", "source": ""}
            return cls.gauge(kind.removeprefix(GAUGE), position=position, normal=normal, name=name or kind, **more)
        if kind in kinds:
            row = kinds[kind]
            figures = (float(row["stiffness_N_m"]), str(row["status"]), str(row["source"]))
            more.setdefault("colour", tuple(row["colour"]))
        else:
            figures = _of_body(kind, _LIMITS if limits is None else limits, tuple(kinds))
            more.setdefault("colour", (0.80, 0.47, 0.65))
        if stiffness is not None:
            figures = (stiffness, "given", "")
        x, y, z = (float(value) for value in as_float_array(position, "position", (3,)))
        a, b, c = (float(value) for value in as_float_array(normal, "normal", (3,)))
        return cls(
            name=name or kind,
            position=(x, y, z),
            normal=(a, b, c),
            stiffness=figures[0],
            status=figures[1],
            source=figures[2],
            **more,
        )

    @classmethod
    def gauge(
        cls, region: str, *, position: Sequence[float], normal: Sequence[float], name: str = "", **more: Any
    ) -> PlantObject:
        """A device that measures a collision as test practice has it: a pad on a body on a spring.

        Args:
            region: one of :func:`gauge_regions`, which names spring and pad.
            position: as the attribute.
            normal: as the attribute.
            name: default: ``"gauge_"`` and the region.
            more: further attributes; ``stiffness`` [N/m] and ``body_mass`` [kg] replace what is assumed of the pad.

        Raises:
            InputError: there is no such region.
        """
        table = _gauges()
        springs = table["spring_N_mm_and_shore_a"]
        if region not in springs:
            raise InputError("object.kind", f"{region!r} is no region of gauges", near_matches(region, tuple(springs)))
        spring, shore = springs[region]
        area, thickness = 1e-4 * float(table["pad_area_cm2"]), 1e-3 * float(table["pad_thickness_mm"])
        mine: dict[str, Any] = {
            "stiffness": rubber_modulus(shore) * area / thickness,
            "mass": float(table["pad_mass_kg"]),
            "body_mass": float(table["body_mass_kg"]),
            "damping_ratio": 0.1,
            "status": "assumed",
            "source": str(table["source"]),
            "colour": (0.45, 0.45, 0.45),
        } | more
        x, y, z = (float(value) for value in as_float_array(position, "position", (3,)))
        a, b, c = (float(value) for value in as_float_array(normal, "normal", (3,)))
        name = name or f"{GAUGE}{region}"
        return cls(name=name, position=(x, y, z), normal=(a, b, c), spring=1e3 * float(spring), **mine)

    @property
    def geom(self) -> str:
        """Name of its body and of its face in MuJoCo."""
        return f"object:{self.name}"

    @property
    def behind(self) -> str:
        """Name of a free body's mass behind the spring in MuJoCo."""
        return f"{self.geom}:behind"

    @property
    def moving_mass(self) -> float:
        """Mass that moves [kg]."""
        return self.stiffness / _OWN_FREQUENCY**2 if self.mass is None else self.mass

    @property
    def damping(self) -> float:
        """Of the spring [N s/m]."""
        if self.spring is not None and self.body_mass is not None:
            return 2 * self.damping_ratio * math.sqrt(self.stiffness * self.body_mass)
        if self.body_mass is not None:
            return 2 * _FREE_DAMPING_RATIO * math.sqrt(self.stiffness * self.body_mass)
        return 2 * self.damping_ratio * math.sqrt(self.stiffness * self.moving_mass)

    @property
    def direction(self) -> tuple[float, float, float]:
        """The normal, of length 1."""
        unit = np.asarray(self.normal, dtype=np.float64) / np.linalg.norm(self.normal)
        return float(unit[0]), float(unit[1]), float(unit[2])

    def mjcf(self, contact_radius: float) -> list[str]:
        """The body; its face is a ball's radius back, so that the ball's centre is where contact begins [m]."""
        n = np.asarray(self.direction)
        side = np.cross(n, (0.0, 0.0, 1.0) if abs(n[2]) < 0.9 else (1.0, 0.0, 0.0))
        side /= np.linalg.norm(side)
        # z of the body along the normal.
        x, y = (" ".join(map(repr, axis.tolist())) for axis in (side, np.cross(n, side)))
        centre = np.asarray(self.position) + (contact_radius + _THICKNESS / 2) * n
        mass, colour = self.moving_mass, " ".join(f"{part:g}" for part in self.colour)
        name = quoted(self.geom)
        place = f'pos="{" ".join(map(repr, centre.tolist()))}" xyaxes="{x} {y}"'
        before, after = [], []
        if self.body_mass is not None:
            behind = quoted(self.behind)
            before = [
                f'<body name="{behind}" {place} gravcomp="1">',
                _inertial(self.body_mass - mass),
                f'<joint name="{behind}" type="slide" axis="0 0 1" {self._ground()}/>',
            ]
            place, after = 'pos="0 0 0"', ["</body>"]
        return [
            *before,
            f'<body name="{name}" {place} gravcomp="1">',
            _inertial(mass),
            f'<joint name="{name}" type="slide" axis="0 0 1" stiffness="{self.stiffness!r}" '
            f'damping="{self.damping!r}"/>',
            f'<geom name="{name}" type="box" size="{self.size[0]!r} {self.size[1]!r} {_THICKNESS / 2!r}" '
            f'rgba="{colour} 1"/>',
            "</body>",
            *after,
        ]

    def _ground(self) -> str:
        """The spring of a gauge, as attributes of its body's slide."""
        if self.spring is None or self.body_mass is None:
            return ""
        damping = 2 * self.spring_damping_ratio * math.sqrt(self.spring * self.body_mass)
        return f'stiffness="{self.spring!r}" damping="{damping!r}"'


def rubber_modulus(shore_a: float) -> float:
    """Young's modulus of rubber from its Shore A hardness [Pa] (Gent 1958, Rubber Chemistry and Technology 31)."""
    return 1e6 * 0.0981 * (56 + 7.62336 * shore_a) / (0.137505 * (254 - 2.54 * shore_a))


def _inertial(mass: float) -> str:
    inertia = max(mass * 1e-4, 1e-12)
    return f'<inertial pos="0 0 0" mass="{mass!r}" diaginertia="{inertia!r} {inertia!r} {inertia!r}"/>'


def quoted(name: str) -> str:
    """A name as it may stand in an attribute of XML."""
    return name.replace("&", "&amp;").replace("<", "&lt;").replace('"', "&quot;")


def _of_body(body: str, limits: str, kinds: tuple[str, ...]) -> tuple[float, str, str]:
    from bumpstop.contact import LimitTable

    table = LimitTable.load(limits, field="object.limits")
    try:
        found = table.contact_limits(body, "clamped")
    except InputError:
        known = (*kinds, *(region.name for region in table.regions))
        raise InputError(
            "object.kind", f"{body!r} is neither an object nor a body region of {limits}", near_matches(body, known)
        ) from None
    return found.stiffness_N_m, "published", f"{limits}: {body}"


class ObjectForces:
    """Forces on the objects of a plant, as MuJoCo has them now.

    Args:
        model: MuJoCo's, of the plant.
        data: its state.
        objects: of the plant.
    """

    def __init__(self, model: Any, data: Any, objects: Sequence[PlantObject]) -> None:
        self._data, self._objects = data, objects
        self._object_of = {model.geom(thing.geom).id: i for i, thing in enumerate(objects)}

    def contact(self) -> FloatArray:
        """On each object along its normal (objects,) [N]."""
        forces = np.zeros(len(self._objects))
        if self._data.ncon:
            geoms, addresses = self._data.contact.geom, self._data.contact.efc_address
            for pair, address in zip(geoms, addresses, strict=True):
                if address >= 0:
                    forces[self._object_of[int(max(pair))]] += self._data.efc_force[address]
        return forces

    def measured(self, contact: FloatArray) -> FloatArray:
        """Forces that gauges show, and contact forces of other objects (objects,) [N]."""
        measured = contact.copy()
        for i, thing in enumerate(self._objects):
            if thing.spring is not None:
                measured[i] = thing.spring * self._data.joint(thing.behind).qpos[0]
        return measured
