"""The controls of the page, each with the key of the scenario that it shows and sets: one table."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, get_args

from bumpstop.collision.scenario.scenario_tables import DetectorTable, MotionTable, ReactionTable, VerdictTable
from bumpstop.collision.scenario.spellings import other_spelling
from bumpstop.collision.scenario.uncertainty_table import uncertain_inputs
from bumpstop.collision.stopping.braking_keys import OF_LAW
from bumpstop.contact import LimitTable
from bumpstop.contact.limits import builtin_tables
from bumpstop.errors import InputError
from bumpstop.study.parameters.region_collisions import keys_of_the_body
from bumpstop.view.field_text import OFFERED, PREFIX, field_text, numbers_of, spec_of, text_of, value_at

if TYPE_CHECKING:
    from bumpstop.collision import Scenario
    from bumpstop.model import Robot

Kind = Literal["slider", "number", "choice", "vector", "text"]
Shown = float | str | tuple[float, float, float]
SPEED, DIRECTION = "motion.speed", "motion.direction"
# Sliders of joints without limits, and of speeds.
_TURN_DEG, _SLIDE_M, _SPEED_MM_S = 180.0, 1.0, 300.0
# What a choice says where the key is left out.
NOT_GIVEN = "(not given)"


@dataclass(frozen=True, kw_only=True)
class Control:
    """One control.

    Attributes:
        key: dotted key of the scenario, with ``[i]`` for an item of a list, counted from 1; or :data:`SPEED` and
            :data:`DIRECTION`, which are the length of the velocity and where it points.
        label: beside the control, with the unit.
        panel: it stands in.
        kind: a number with a slider, a number, one of ``choices``, three numbers, or text: a TOML value, or numbers
            with commas between them; empty: the key is left out.
        low, high, step: of the slider; the number beside it may be any that the scenario takes.
        choices: names to choose from.
        optional: the key may be left out.
        hint: what it means.
    """

    key: str
    label: str
    panel: str
    kind: Kind
    low: float = -math.inf
    high: float = math.inf
    step: float = 1.0
    choices: tuple[str, ...] = ()
    optional: bool = False
    hint: str = ""

    def text(self, scenario: Scenario) -> str:
        """What stands in the field of the control."""
        return field_text(self.read(scenario))

    def read(self, scenario: Scenario) -> Shown:
        """What the control shows of a scenario."""
        value = _value(scenario, self.key)
        if self.kind in ("slider", "number"):
            return float(value)
        if self.kind == "vector":
            x, y, z = value
            return float(x), float(y), float(z)
        if self.kind == "choice":
            return NOT_GIVEN if value is None else str(value)
        return text_of(value) if self.key.startswith(PREFIX) else field_text(value)

    def write(self, scenario: Scenario, shown: Shown) -> dict[str, Any]:
        """The keys to change so that the scenario says what the control shows; None takes a key out.

        What is no number where one is wanted becomes the value all the same: the scenario refuses it as a file's.

        Raises:
            InputError: the limit table of the scenario has no such body part, or no speed or direction is shown.
        """
        if self.kind in ("slider", "number", "vector") and isinstance(shown, str):
            shown = numbers_of(shown)
        if self.key in (SPEED, DIRECTION):
            return {"motion.velocity_mm_s": _velocity(scenario, self.key, shown)}
        if self.key.startswith(PREFIX):
            return {self.key: spec_of(str(shown))}
        if self.key == "contact.body":
            return body_changes(scenario, None if shown == NOT_GIVEN else str(shown))
        if "[" in self.key:
            name, _, item = self.key.removesuffix("]").partition("[")
            values = list(_value(scenario, name))
            values[int(item) - 1] = shown
            return {name: values}
        value: Any = shown
        if self.kind == "vector":
            value = list(shown) if isinstance(shown, tuple) else shown
        elif self.kind == "choice" and shown == NOT_GIVEN:
            value = None
        elif self.kind == "text":
            value = value_at(self.key, str(shown))
        changes = {self.key: value}
        if value is not None and self.key in _OF_CHOICE:
            choice, name = _OF_CHOICE[self.key]
            changes[choice] = name
            return changes | dict.fromkeys(_instead(scenario, choice, name))
        # Left out is what it says, however it is spelled.
        spelled = other_spelling(self.key) if value is None else ()
        return changes | dict.fromkeys((*_instead(scenario, self.key, value), *spelled))


def _velocity(scenario: Scenario, key: str, shown: Any) -> list[float]:
    """The velocity with another length, or in another direction [mm/s].

    Raises:
        InputError: what is shown is no speed, or no direction.
    """
    numbers = shown if isinstance(shown, tuple | list) else (shown,)
    length, valid = (1, "a number of mm/s above 0") if key == SPEED else (3, "three numbers with commas between them")
    whole = len(numbers) == length and all(isinstance(each, float) and math.isfinite(each) for each in numbers)
    if not whole or (key == SPEED and numbers[0] <= 0):
        said = field_text(shown)
        raise InputError(
            "motion.velocity_mm_s", f"the {key.partition('.')[2]} {said!r} cannot be used", f"wanted {valid}"
        )
    x, y, z = scenario.motion.velocity
    speed = 1e3 * math.hypot(x, y, z)
    if key == SPEED:
        return [_rounded(1e3 * part / speed * shown) for part in (x, y, z)]
    size = math.hypot(*shown)
    return [_rounded(part / size * speed) if size else 0.0 for part in shown]


def _rounded(value: float) -> float:
    """A value that can be read: twelve digits, and no negative zero."""
    return float(f"{value:.12g}") + 0.0


# What is typed here has a meaning with one choice only: the scenario makes it then. Without the number it could not.
_OF_CHOICE = {
    "contact.body_mass_kg": ("contact.kind", "free"),
    "contact.offset_mm": ("contact.offset_law", "fixed"),
    "reaction.stopping_time_s": ("reaction.deceleration", "constant_time"),
    "reaction.ramp_time_s": ("reaction.deceleration", "ramp"),
}


def _instead(scenario: Scenario, key: str, value: Any) -> tuple[str, ...]:
    """Keys that lose their meaning with a new value, and would make the scenario none."""
    lost: dict[tuple[str, Any], tuple[str, ...]] = {
        ("contact.kind", "clamped"): ("contact.body_mass_kg", "contact.arm"),
        ("arm.model", "rigid"): ("arm.file", *(f"arm.{name}" for name in _ARM)),
        ("arm.model", "elastic"): ("contact.arm",),
    }
    if key == "contact.offset_law" and value != "fixed":
        return ("contact.offset_mm",)
    if key == "reaction.deceleration":
        return tuple(f"reaction.{own}" for own, law in OF_LAW.items() if law != value)
    if (key, value) == ("contact.kind", "free") and scenario.contact.gauge_spring_N_m is not None:
        # The stiffness is that of its pad, not of the body.
        pad = ("contact.stiffness_N_m", "contact.stiffness_N_mm") if scenario.contact.body is not None else ()
        return ("contact.gauge_spring_N_m", "contact.gauge_mass_kg", *pad)
    return lost.get((key, value), ()) if isinstance(value, str) else ()


def body_changes(scenario: Scenario, body: str | None) -> dict[str, Any]:
    """The keys to change so that another body part is hit: its own data take the place of what was given of the former.

    Args:
        scenario: in which the former is hit.
        body: name of the region; None: none, and what is given stays.

    Raises:
        InputError: the limit table of the scenario has no such region.
    """
    if body is None:
        return {"contact.body": None, "contact.pressure_area": None}
    region = LimitTable.load(scenario.contact.limits, relative_to=scenario.folder).region(body)
    own = [f"contact.{key}" for key in keys_of_the_body(region)]
    # A factor on a value has a meaning for that of the new part, too.
    figures = [each for each in uncertain_inputs(scenario) if each.key in own and not each.relative]
    return {"contact.body": body, **dict.fromkeys((*own, *(f"{PREFIX}{each.key}" for each in figures)))}


def _value(scenario: Scenario, key: str) -> Any:
    if key in (SPEED, DIRECTION):
        velocity = scenario.motion.velocity
        speed = 1e3 * math.hypot(*velocity)
        return speed if key == SPEED else tuple(_rounded(1e3 * part / speed) for part in velocity)
    if key.startswith(PREFIX):
        return scenario.uncertainty.get(key.removeprefix(PREFIX))
    if "[" in key:
        name, _, item = key.removesuffix("]").partition("[")
        return _value(scenario, name)[int(item) - 1]
    here: Any = scenario
    for part in key.split("."):
        here = getattr(here, part)
    return here


_ARM = {
    "gear_stiffness_Nm_rad": "gear stiffness, Nm/rad",
    "gear_damping": "gear damping",
    "rotor_inertia_kg_m2": "rotor inertia, kg m²",
    "servo_bandwidth_hz": "servo bandwidth, Hz",
    "servo_position_gain_1_s": "position gain, 1/s",
    "torque_limit_Nm": "torque limit, Nm",
    "acceleration_feedforward": "acceleration feedforward",
}
PANELS = ("Motion", "Contact", "Detector", "Reaction", "Arm", "Uncertainty", "Verdict")


def controls_of(scenario: Scenario, robot: Robot) -> tuple[Control, ...]:
    """The controls of a scenario, in the order of the page.

    Args:
        scenario: with its motion; a trajectory has no pose and no velocity of its own.
        robot: of the scenario.
    """
    line = scenario.motion.kind == "line"
    return (
        *(_pose(scenario, robot) if line else ()),
        *(_motion(scenario) if line else ()),
        *_contact(scenario, robot),
        *_detector(),
        *_reaction(),
        *_arm(),
        *_uncertainty(scenario),
        *_verdict(),
    )


def _pose(scenario: Scenario, robot: Robot) -> list[Control]:
    key, found = "pose_deg" if scenario.pose_deg is not None else "pose_rad", []
    for j, joint in enumerate(robot.joints):
        turns = joint.kind == "revolute"
        degrees = turns and key == "pose_deg"
        unit = "°" if degrees else ("rad" if turns else "m")
        low, high = joint.lower, joint.upper
        if degrees:
            # A limit's last digit must not be outside it.
            low, high = math.ceil(1e6 * math.degrees(low)) / 1e6, math.floor(1e6 * math.degrees(high)) / 1e6
        widest = _TURN_DEG if degrees else (math.pi if turns else _SLIDE_M)
        now = float(_value(scenario, f"{key}[{j + 1}]"))
        low = min(low if math.isfinite(low) else -widest, now)
        high = max(high if math.isfinite(high) else widest, now)
        label = f"joint {j + 1}, {unit}"
        step = 0.1 if degrees else 0.001
        found.append(
            Control(
                key=f"{key}[{j + 1}]", label=label, panel="Motion", kind="slider", low=low, high=high, step=step,
                hint=joint.name,
            )
        )  # fmt: skip
    return found


def _motion(scenario: Scenario) -> list[Control]:
    speed = 1e3 * math.hypot(*scenario.motion.velocity)
    return [
        Control(
            key=SPEED, label="speed, mm/s", panel="Motion", kind="slider", low=1.0, step=1.0,
            high=max(_SPEED_MM_S, 2 * math.ceil(speed / 10) * 10), hint="of the tip, along its direction",
        ),
        Control(
            key=DIRECTION, label="direction", panel="Motion", kind="vector",
            hint="of the tip in the base frame; its length does not count",
        ),
        _number("motion.duration_s", "duration, s", "Motion", "how long the motion is simulated"),
        _choice("motion.start", "start", "Motion", MotionTable),
        _choice("motion.task", "task", "Motion", MotionTable),
        _text("motion.held_joints", "joints held", "Motion", "numbers of joints that do not move, from 1"),
        _number("motion.damping", "damping near singularities", "Motion", "of the least-norm rates"),
    ]  # fmt: skip


def _contact(scenario: Scenario, robot: Robot) -> list[Control]:
    contact = scenario.contact
    table = LimitTable.load(contact.limits, relative_to=scenario.folder)
    bodies = tuple(region.name for region in table.regions)
    areas = tuple(dict.fromkeys(area.label for area in table.areas if area.region == contact.body))
    links = (*(joint.link for joint in robot.joints), *(frame.name for frame in robot.frames))
    tables = dict.fromkeys((*builtin_tables(), contact.limits))
    found = [
        Control(
            key="contact.body", label="body part", panel="Contact", kind="choice", choices=(NOT_GIVEN, *bodies),
            optional=True, hint="or click on the figure of a person",
        ),
        Control(key="contact.limits", label="limits", panel="Contact", kind="choice", choices=tuple(tables)),
        Control(
            key="contact.pressure_area", label="pressure area", panel="Contact", kind="choice",
            choices=(NOT_GIVEN, *areas), optional=True,
        ),
        _choice("contact.kind", "contact", "Contact", type(contact)),
        Control(
            key="contact.area_cm2", label="area, cm²", panel="Contact", kind="slider", low=0.1,
            high=max(20.0, 2 * contact.area_cm2), step=0.1,
        ),
        Control(
            key="contact.link", label="link", panel="Contact", kind="choice",
            choices=(NOT_GIVEN, *dict.fromkeys(links)), optional=True, hint="or click on the arm; without it the tip",
        ),
        Control(
            key="contact.point_m", label="point, m", panel="Contact", kind="vector",
            hint="in the frame of the link",
        ),
        _text("contact.normal", "normal", "Contact", "direction of contact in the base frame; empty: of the motion"),
        _text("contact.stiffness_N_m", "stiffness, N/m", "Contact", "of the body; empty: of the limit table"),
        _text("contact.padding_N_m", "padding, N/m", "Contact", "of the arm, in series with the body"),
        _text("contact.body_mass_kg", "body mass, kg", "Contact", "of free contact; empty: of the limit table"),
        _number("contact.damping_Ns_m", "damping, Ns/m", "Contact", "of the body"),
        _number("contact.peak_factor", "peak factor", "Contact", "highest over mean pressure"),
        Control(
            key="contact.arm", label="arm in free contact", panel="Contact", kind="choice",
            choices=get_args(type(contact).model_fields["arm"].annotation),
        ),
    ]  # fmt: skip
    if scenario.motion.kind == "line":
        found += [
            _choice("contact.offset_law", "distance law", "Contact", type(contact)),
            _text("contact.offset_mm", "distance, mm", "Contact", "of the fixed law"),
            _number("contact.offset_sd_s", "distance sd, s", "Contact", "of the half-normal law"),
        ]
    return found


def _detector() -> list[Control]:
    return [
        _text("detector.thresholds_Nm", "thresholds, Nm", "Detector", "by joint; inf: not monitored"),
        _text("detector.noise_sd_Nm", "noise sd, Nm", "Detector", "by joint, or one for all"),
        _text("detector.noise_mean_Nm", "noise mean, Nm", "Detector", "by joint, or one for all"),
        Control(
            key="detector.noise_correlation", label="noise correlation", panel="Detector", kind="slider", low=-0.99,
            high=0.995, step=0.005, hint="from one control cycle to the next",
        ),
        _number("detector.feedback_period_s", "feedback period, s", "Detector", ""),
        _choice("detector.residual", "residual", "Detector", DetectorTable),
        _number("detector.observer_gain_1_s", "observer gain, 1/s", "Detector", ""),
        _number("detector.arming_delay_s", "arming delay, s", "Detector", ""),
    ]  # fmt: skip


def _reaction() -> list[Control]:
    return [
        _choice("reaction.kind", "reaction", "Reaction", ReactionTable),
        _text("reaction.joint_acceleration_rad_s2", "joint acceleration, rad/s²", "Reaction", "by joint, or one"),
        Control(
            key="reaction.latency_s", label="latency, s", panel="Reaction", kind="slider", low=0, high=0.2, step=0.001,
            hint="from detection until the arm begins to slow down",
        ),
        _number("reaction.dead_time_s", "dead time, s", "Reaction", ""),
        _choice("reaction.deceleration", "deceleration", "Reaction", ReactionTable),
        _text("reaction.stopping_time_s", "stopping time, s", "Reaction", "of constant_time"),
        _text("reaction.ramp_time_s", "ramp time, s", "Reaction", "of ramp"),
        _text("reaction.stop_category", "stop category", "Reaction", "0, 1 or 2 (IEC 60204-1)"),
    ]  # fmt: skip


def _arm() -> list[Control]:
    model = Control(key="arm.model", label="arm", panel="Arm", kind="choice", choices=("rigid", "elastic"))
    hint = "by joint, or one for all; empty: what is known or assumed of the robot"
    return [model, *(_text(f"arm.{key}", label, "Arm", hint) for key, label in _ARM.items())]


def _uncertainty(scenario: Scenario) -> list[Control]:
    labels = OFFERED | {key: key for key in scenario.uncertainty if key not in OFFERED}
    hint = "how well it is known: 5 %, 1.8 to 2.5, or a table of [uncertainty]; empty: exactly"
    return [_text(f"{PREFIX}{key}", label, "Uncertainty", hint) for key, label in labels.items()]


def _verdict() -> list[Control]:
    return [
        _text("verdict.accepted_probability", "accepted probability", "Verdict", "of exceeding a limit"),
        _text("verdict.max_false_alarm", "accepted false alarm", "Verdict", "before contact"),
        _text("verdict.confidence", "confidence", "Verdict", "of a verdict with uncertain inputs"),
        _choice("verdict.clamped_limit", "clamped limit", "Verdict", VerdictTable),
    ]


def _number(key: str, label: str, panel: str, hint: str) -> Control:
    return Control(key=key, label=label, panel=panel, kind="number", hint=hint)


def _text(key: str, label: str, panel: str, hint: str) -> Control:
    return Control(key=key, label=label, panel=panel, kind="text", optional=True, hint=hint)


def _choice(key: str, label: str, panel: str, model: Any) -> Control:
    choices = get_args(model.model_fields[key.rpartition(".")[2]].annotation)
    return Control(key=key, label=label, panel=panel, kind="choice", choices=choices)
