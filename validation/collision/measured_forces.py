"""Forces that others measured, beside those of the linear equations of an elastic arm; nothing is fitted.

What nobody published of the arms is assumed (``robot.drive_train`` says what), and drawn about the assumption: the band
of the predictions is what the assumptions leave open.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from bumpstop.collision.stopping import fit_stopping, load_stopping_table
from bumpstop.model import Robot, effective_mass, mass_matrix, with_rotors
from bumpstop.plant import PlantObject
from reference.elastic_arm import Body, ElasticArm, ElasticCollision, collide
from validation.collision.nonlinear_arm import Array
from validation.findings import Findings

TITLE = "Measured forces of collaborative arms beside predictions"
REPOSITORY = Path(__file__).resolve().parents[2]
DOWN = np.array([0.0, 0.0, -1.0])
_STEP = 1e-3
# Central share of the draws that a band holds.
_BAND = 0.9


@dataclass(frozen=True, kw_only=True)
class Assumed:
    """What nobody tells of a measurement; the factors multiply the assumed drive train.

    Attributes:
        rotor_inertia, gear_stiffness, servo_bandwidth, servo_position_gain: factors [1].
        gear_damping: share of critical [1].
        feedforward: share of the path's acceleration that the motors feed forward [1].
        reaction: from contact to the begin of the stop [s].
        deceleration: of the fastest joint [rad/s2].
        pad: stiffness of a gauge's pad, or None: that of its hardness [N/m].
        gauge_mass: that moves with a gauge's spring [kg].
        payload: at the tip [kg].
        height: beside the one told [m].
    """

    rotor_inertia: float = 1.0
    gear_stiffness: float = 1.0
    servo_bandwidth: float = 1.0
    servo_position_gain: float = 1.0
    gear_damping: float = 0.05
    feedforward: float = 1.0
    reaction: float = 0.04
    deceleration: float = 10.0
    pad: float | None = None
    gauge_mass: float = 0.5
    payload: float = 0.0
    height: float = 0.0

    @classmethod
    def draw(cls, rng: np.random.Generator) -> Assumed:
        """One of many, within what could be."""

        def spread(low: float, high: float) -> float:
            return float(np.exp(rng.uniform(np.log(low), np.log(high))))

        return cls(
            rotor_inertia=spread(0.5, 2.0),
            gear_stiffness=spread(0.5, 2.0),
            servo_bandwidth=spread(0.5, 2.0),
            servo_position_gain=spread(0.5, 2.0),
            gear_damping=spread(0.02, 0.1),
            feedforward=float(rng.uniform(0.0, 1.0)),
            reaction=float(rng.uniform(0.02, 0.06)),
            deceleration=spread(5.0, 20.0),
            pad=spread(1e5, 1e6),
            gauge_mass=spread(0.2, 1.0),
            payload=float(rng.uniform(0.0, 1.5)),
            height=float(rng.uniform(-0.1, 0.1)),
        )


def facts() -> dict[str, Any]:
    """What was measured and stated."""
    return tomllib.loads((REPOSITORY / "validation/data/measured_forces.toml").read_text(encoding="utf-8"))


def tool_down(robot: Robot, distance: float, height: float) -> Array:
    """Pose of an arm with six joints of the UR kind, elbow up, its tool pointing down at a place of the workspace."""

    def pose(q: Array) -> Array:
        return np.array([0.0, *q, -np.pi / 2, 0.0])

    def off(q: Array) -> list[float]:
        at = robot.pose(pose(q))
        return [float(np.hypot(at[0, 3], at[1, 3])) - distance, float(at[2, 3]) - height, float(at[2, 2]) + 1]

    found = least_squares(off, [-1.3, 1.8, -2.0])
    if found.cost > 1e-9:
        raise ValueError(f"{robot.name} does not reach {distance:g} m at a height of {height:g} m")
    return pose(found.x)


def blow(
    robot: Robot, q: Array, normal: Array, speed: float, body: Body, assumed: Assumed | None = None
) -> ElasticCollision:
    """A collision of an arm that stops after it has hit."""
    given = assumed or Assumed()
    train, jacobian = robot.drive_train, robot.jacobian(q)
    mass = mass_matrix(with_rotors(robot, 0.0), q) + given.payload * jacobian[:3].T @ jacobian[:3]
    rates = np.linalg.pinv(jacobian) @ np.concatenate([normal, np.zeros(3)])
    arm = ElasticArm.of_servo(
        mass,
        given.rotor_inertia * train.rotor_inertia,
        given.gear_stiffness * train.gear_stiffness,
        normal @ jacobian[:3],
        gear_damping_ratio=given.gear_damping,
        velocity_bandwidth=given.servo_bandwidth * train.servo_bandwidth,
        position_gain=given.servo_position_gain * train.servo_position_gain,
        rates=rates,
        feedforward=given.feedforward,
        feeds_motors=True,
    )
    t = _STEP * np.arange(301)
    braking = given.deceleration / np.abs(rates).max()
    late = np.clip(t - given.reaction, 0, speed / braking)
    path = speed * np.minimum(t, given.reaction) + speed * late - braking * late**2 / 2
    return collide(arm, body, path, _STEP, tiny=5e-5)


def gauge(region: str, assumed: Assumed) -> Body:
    """A gauge of test practice."""
    device = PlantObject.gauge(region, position=(0, 0, 0), normal=(0, 0, 1))
    pad = device.stiffness if assumed.pad is None else assumed.pad
    mass = assumed.gauge_mass
    return Body(
        stiffness=pad,
        damping=0.2 * float(np.sqrt(pad * mass)),
        mass=mass,
        spring=device.spring,
        spring_damping=0.1 * float(np.sqrt((device.spring or 0.0) * mass)),
    )


def compare(findings: Findings, *, quick: bool) -> None:
    """Every row and every statement."""
    told = facts()
    findings.say(
        "The drive trains are those of robot.drive_train, most of them assumed. About them are drawn: rotors, gears "
        "and gains by factors 0.5 to 2, damping 2 to 10 %, feedforward 0 to 1 through the motors, a stop 20 to 60 ms "
        "after contact with 5 to 20 rad/s2, a pad of 100 to 1000 N/mm, a gauge's mass of 0.2 to 1 kg, a payload to "
        "1.5 kg, and the height by 0.1 m. Nothing is fitted; what misses stays here."
    )
    _rows(findings, told["ur10e"], draws=40 if quick else 400)
    _workspace(findings, told["ur10e"], told["workspace"])
    _padding(findings, told["padding"])
    _speeds(findings, told["ur10e"], told["padding"])
    _inertia(findings, told["inertia"])
    _pinching(findings, told["pinching"])
    _stopping(findings, told["stopping"])


def _rows(findings: Findings, told: dict[str, Any], *, draws: int) -> None:
    robot, rng = Robot.load(told["robot"]), np.random.default_rng(15066)
    drawn = [Assumed.draw(rng) for _ in range(draws)]
    poses = [tool_down(robot, told["distance_from_base_m"], told["height_m"] + given.height) for given in drawn]
    nominal = tool_down(robot, told["distance_from_base_m"], told["height_m"])
    rows = []
    for speed, measured in told["speed_m_s_and_peak_N"]:
        forces = np.array(
            [
                blow(robot, q, DOWN, speed, gauge(told["gauge"], given), given).peak_measured
                for q, given in zip(poses, drawn, strict=True)
            ]
        )
        low, centre, high = np.quantile(forces, [(1 - _BAND) / 2, 0.5, (1 + _BAND) / 2])
        assumed = Assumed()
        single = blow(robot, nominal, DOWN, speed, gauge(told["gauge"], assumed), assumed).peak_measured
        # ISO/TS 15066, half of the moving mass on the gauge's spring.
        spring = PlantObject.gauge(told["gauge"], position=(0, 0, 0), normal=(0, 0, 1)).spring or 0.0
        half = speed * np.sqrt(float(effective_mass(robot, nominal, DOWN, definition="ts15066")) * spring)
        # An arm that does not give follows its path to the end of its stop.
        braking = assumed.deceleration / np.abs(np.linalg.pinv(robot.jacobian(nominal)) @ [*DOWN, 0, 0, 0]).max()
        rigid = spring * (speed * assumed.reaction + speed**2 / (2 * braking))
        rows.append([f"{1e3 * speed:g} mm/s", float(measured), single, low, centre, high, float(half), float(rigid)])
        findings.check(
            f"UR10e at {1e3 * speed:g} mm/s: the measured peak is inside the band",
            low <= measured <= high,
            f"measured {measured:g} N, band {low:.0f} to {high:.0f} N",
        )
        findings.check(
            f"UR10e at {1e3 * speed:g} mm/s: the band's centre is within 25 % of the measured peak",
            abs(centre / measured - 1) < 0.25,
            f"{100 * (centre / measured - 1):+.0f} %",
        )
    findings.table(
        f"{told['robot']}, {told['note']}; {draws} draws ({told['source']})",
        ["Speed", "Measured [N]", "As assumed [N]", "5 % [N]", "Centre [N]", "95 % [N]", "M/2 [N]", "Rigid arm [N]"],
        ["", ".0f", ".0f", ".0f", ".0f", ".0f", ".0f", ".0f"],
        rows,
    )


def _workspace(findings: Findings, arm: dict[str, Any], told: dict[str, Any]) -> None:
    robot = Robot.load(arm["robot"])
    distances, heights, speed = (0.4, 0.6, 0.8, 1.0), (0.1, 0.3, 0.5, 0.7), 0.25
    forces, half = np.empty((2, len(heights), len(distances)))
    body = gauge(arm["gauge"], Assumed())
    for i, height in enumerate(heights):
        for j, distance in enumerate(distances):
            q = tool_down(robot, distance, height)
            forces[i, j] = blow(robot, q, DOWN, speed, body).peak_measured
            mass = float(effective_mass(robot, q, DOWN, definition="ts15066"))
            half[i, j] = speed * np.sqrt(mass * (body.spring or 0.0))
    findings.say(f"{told['text']} ({told['source']}).")
    findings.table(
        f"{arm['robot']} moving down at {1e3 * speed:g} mm/s on the gauge of a hand, peak force [N]",
        ["Height [m] \\ distance [m]", *(f"{distance:g}" for distance in distances)],
        ["", *(".0f" for _ in distances)],
        [[f"{height:g}", *map(float, row)] for height, row in zip(heights, forces, strict=True)],
    )
    falls_out, falls_up = forces[:, -1] < forces[:, 0], forces[-1] < forces[0]
    steps = np.concatenate([np.diff(forces, axis=1).ravel(), np.diff(forces, axis=0).ravel()])
    findings.check(
        "The force falls with the distance, at every height",
        bool(falls_out.all()),
        ", ".join(f"{b / a - 1:+.0%}" for a, b in zip(forces[:, 0], forces[:, -1], strict=True)),
    )
    findings.check(
        "The force falls with the height, at every distance",
        bool(falls_up.all()),
        ", ".join(f"{b / a - 1:+.0%}" for a, b in zip(forces[0], forces[-1], strict=True)),
    )
    findings.say(f"From one place of the grid to the next it falls in {np.sum(steps < 0)} of {len(steps)} cases.")
    findings.check(
        "Over the grid it varies by more than 100 %",
        forces.max() > 2 * forces.min(),
        f"{forces.min():.0f} to {forces.max():.0f} N",
    )
    findings.check(
        "M/2 errs in both directions",
        bool((forces > half).any() and (forces < half).any()),
        f"predicted over M/2: {(forces / half).min():.2f} to {(forces / half).max():.2f}",
    )


def _padding(findings: Findings, told: dict[str, Any]) -> None:
    findings.say(
        f"{told['text']} ({told['source']}). Its stiffness is not told: 20 to 60 N/mm are assumed. The body is a hand "
        "of 0.6 kg and 75 N/mm that gets away, at 250 mm/s."
    )
    rows, lowered = [], []
    for name, q in (("ur10e", None), ("iiwa14", np.radians([0, 40, 0, -80, 0, 60, 0]))):
        robot = Robot.load(name)
        pose = tool_down(robot, 0.7, 0.4) if q is None else q
        bare_force = blow(robot, pose, DOWN, 0.25, Body(stiffness=75e3, mass=0.6)).peak_force
        for pad in (20e3, 40e3, 60e3):
            soft = blow(robot, pose, DOWN, 0.25, Body(stiffness=1 / (1 / 75e3 + 1 / pad), mass=0.6)).peak_force
            lowered.append(1 - soft / bare_force)
            rows.append([f"{name}, {pad / 1e3:g} N/mm", bare_force, soft, 100 * lowered[-1]])
    findings.table(
        "Transient contact with padding",
        ["Robot, padding", "Bare [N]", "Padded [N]", "Lower by [%]"],
        ["", ".0f", ".0f", ".0f"],
        rows,
    )
    middle = lowered[1::3]
    findings.check(
        "Padding of 40 N/mm lowers the force of transient contact by 30 to 50 %",
        all(0.3 <= share <= 0.5 for share in middle),
        ", ".join(f"{share:.0%}" for share in middle) + f"; measured about {told['lowers']:.0%}",
    )


def _speeds(findings: Findings, arm: dict[str, Any], told: dict[str, Any]) -> None:
    """How much faster than M/2 allows an arm may be, clamped and free, for a limit of 280 N."""
    robot, limit = Robot.load(arm["robot"]), 280.0
    rows = []
    for distance, height in ((0.6, 0.3), (0.8, 0.4), (1.0, 0.6)):
        q = tool_down(robot, distance, height)
        half = float(effective_mass(robot, q, DOWN, definition="ts15066"))
        for name, mass in (("clamped", None), ("free, 0.6 kg", 0.6)):
            body = Body(stiffness=75e3, mass=mass)
            # Without its reaction's share the peak is proportional to the speed.
            own = limit / (blow(robot, q, DOWN, 0.25, body).peak_force / 0.25)
            both = half if mass is None else 1 / (1 / half + 1 / mass)
            rows.append([f"{distance:g} m out, {height:g} m high, {name}", own, limit / np.sqrt(both * 75e3)])
    ratios = np.array([row[1] / row[2] for row in rows])
    findings.table(
        f"Speed at which the peak is {limit:g} N on 75 N/mm",
        ["Place and body", "Elastic arm [m/s]", "M/2 [m/s]"],
        ["", ".2f", ".2f"],
        rows,
    )
    findings.say(
        f"Up to {told['speed_ratio']:g} times the speed that M/2 allows complied in the measurements, pads and places "
        f"together. Without padding the prediction allows {ratios.min():.2f} to {ratios.max():.2f} times that speed."
    )
    findings.figures["speed_over_half_mass"] = ratios


def _inertia(findings: Findings, told: dict[str, Any]) -> None:
    robot = Robot.load(told["robot"])
    rng = np.random.default_rng(7)
    rows, larger = [], []
    for _ in range(6):
        q = rng.uniform(np.maximum(robot.lower, -2.5), np.minimum(robot.upper, 2.5))
        speed, stiffness = 0.1, 500e3
        # The mass whose blow on the same spring is as hard, in the first push.
        force = blow(robot, q, DOWN, speed, Body(stiffness=stiffness)).force
        first = int(np.argmax(np.diff(force) < 0))
        mass = (float(force[first]) / speed) ** 2 / stiffness
        definitions = ("links", "links_and_rotors", "composite_rigid_body", "ts15066")
        known = [float(effective_mass(robot, q, DOWN, definition=name)) for name in definitions]
        rows.append([", ".join(f"{angle:.1f}" for angle in q), mass, *known])
        larger.append(mass / known[0])
    findings.table(
        f"{told['robot']} on a plate of 500 N/mm, effective mass [kg]; {told['text']} ({told['source']})",
        ["Pose [rad]", "Of the blow", "Links", "Links and rotors", "Composite rigid body", "M/2"],
        ["", ".2f", ".2f", ".2f", ".2f", ".2f"],
        rows,
    )
    findings.say(
        f"This misses. In the first push the gears give, and the plate sees {min(larger):.2f} to {max(larger):.2f} "
        "times the mass of the links alone, less than the composite rigid body that fits the measurements: on a body "
        "as stiff as this an elastic arm with these gears is too light. Friction, which holds gears in the first "
        "moment, is not in the equations."
    )
    findings.figures["plate_mass_over_links"] = larger


def _pinching(findings: Findings, told: dict[str, Any]) -> None:
    """The force with which motors at a tenth of their rated torque push the way they move: power over speed."""
    robot = Robot.load(told["robot"])
    limit = 0.1 * robot.drive_train.torque_limit

    def force(distance: float, height: float, way: Array) -> float:
        rates = np.linalg.pinv(robot.jacobian(tool_down(robot, distance, height))) @ [*way, 0, 0, 0]
        return float(limit @ np.abs(rates))

    def direction(distance: float, height: float, tangential: bool) -> Array:
        at = robot.pose(tool_down(robot, distance, height))[:2, 3]
        radial = np.array([*(at / np.linalg.norm(at)), 0.0])
        return np.cross([0.0, 0.0, 1.0], radial) if tangential else radial

    far = (1.1, 0.7)  # the elbow nearly straight
    near = (told["near_base_m"], 0.4)
    middle = (0.7, 0.4)
    rows = []
    for name, place, usual, tangential in (
        ("radial, far out", far, middle, False),
        ("tangential, near", near, middle, True),
    ):
        here, there = (force(*where, direction(*where, tangential)) for where in (place, usual))
        rows.append([f"{name}: {place[0]:g} m out, {place[1]:g} m high", here, there, here / there])
        findings.check(
            f"Pinching is harder where the maker warns of it: {name}",
            here > 1.5 * there,
            f"{here:.0f} N, {there:.0f} N in the middle of the workspace",
        )
    findings.table(
        f"Force at a tenth of the rated torques; {told['text']} ({told['source']})",
        ["Motion", "There [N]", "In the middle [N]", "Ratio"],
        ["", ".0f", ".0f", ".1f"],
        rows,
    )


def _stopping(findings: Findings, told: dict[str, Any]) -> None:
    fit = fit_stopping(load_stopping_table(REPOSITORY / told["file"]))
    low, high = told["exponent"]
    exponents = np.asarray(fit.exponent)
    findings.check(
        f"TM5-700: {told['text']} ({told['source']})",
        bool(np.all((low <= exponents) & (exponents <= high))),
        "exponent of distance over speed " + ", ".join(f"{value:.3f}" for value in exponents),
    )
