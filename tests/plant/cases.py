"""The arm of Schroeder (2013) with planted rotors, and what its recordings say: for tests and for the validation."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

import bumpstop as bs
from bumpstop.joint import JointTorqueModel, Parameter
from bumpstop.model import Robot, inverse_dynamics
from bumpstop.plant import Command, Gears, Plant, PlantObject, PlantReaction, PlantRun, Sample, Sensors, line, press
from bumpstop.signal import derivatives, zero_phase_lowpass

Floats = npt.NDArray[np.float64]

# Planted: Schroeder (2013) left them out. Of the order of a harmonic drive's motor behind its gear.
ROTORS = [1.0, 1.0, 0.5, 0.35, 0.15, 0.15, 0.05]
STANDARD = np.radians([0, 30, 0, -20, 0, -40, 0])
SENSORS = Sensors(rate_hz=250.0, position_step=1e-6)
POSES = {
    "standard, downward": ([0, 30, 0, -20, 0, -40, 0], [0, 0, -50]),
    "standard, sideways": ([0, 30, 0, -20, 0, -40, 0], [0, 50, 0]),
    "reaching, downward": ([20, 50, 10, -40, 15, -50, 0], [0, 0, -50]),
}
# Section 3.2: object, speed [mm/s], the error its force estimate stayed under [N], how far we press before the arm
# turns [m], and the cut-off at which forces are compared [Hz]: a contact of 30 ms needs a higher one.
PRESSES = [
    ("foam", 25, 5, 0.012, 10.0),
    ("foam", 50, 5, 0.012, 10.0),
    ("fiberboard", 25, 5, 0.002, 10.0),
    ("foam", 75, 10, 0.012, 10.0),
    ("plexiglas", 25, 10, 0.0025, 10.0),
    ("plexiglas", 125, 10, 0.005, 25.0),
]


def source_arm() -> Robot:
    return Robot.load("sia5d")


def joint_model(*, inertia: bool) -> JointTorqueModel:
    """Table 2.2, with the planted rotors or without."""
    model = JointTorqueModel.load("sia5d")
    if not inertia:
        return model
    joints = [
        replace(joint, parameters={**joint.parameters, "inertia": Parameter(rotor)})
        for joint, rotor in zip(model.joints, ROTORS, strict=False)
    ]
    return replace(model, joints=tuple(joints))


def source_plant(seed: int, objects: list[PlantObject] | None = None, sensors: Sensors = SENSORS) -> Plant:
    """Friction of table 2.2 with its scatter."""
    gears = Gears(rotor_inertia=ROTORS)
    return Plant(
        source_arm(), joint_model(inertia=False), friction=gears, sensors=sensors, objects=objects or [], seed=seed
    )


def free_residual(run: PlantRun, *, inertia: bool) -> Floats:
    """Predicted minus estimated torque of joints 1 to 6, from nothing but the recording (N, 6) [Nm]."""
    log = run.recording
    q, qd, qdd = derivatives(log.t, log.q)
    assert log.current is not None
    estimated = joint_model(inertia=inertia).torque(log.current[:, :6], qd[:, :6], qdd[:, :6])
    return np.asarray(inverse_dynamics(source_arm(), q, qd, qdd)[:, :6] - estimated)


@dataclass(frozen=True)
class PressError:
    """Of the force estimated from currents, beside the wrist's.

    Attributes:
        outside: greatest while the arm touches and moves steadily [N].
        during: greatest at all while it touches [N].
        peak: of the wrist's force [N].
        steady_rows: samples that ``outside`` is of.
    """

    outside: float
    during: float
    peak: float
    steady_rows: int


def press_error(kind: str, speed_mm_s: float, seed: int, into: float, cutoff_hz: float) -> PressError:
    """Press along the tool, and estimate the force from the currents, both compared below a cut-off.

    Steady is where no joint is told to accelerate, nor was or will be within half a period of the cut-off.
    """
    robot = source_arm()
    tip = robot.pose(STANDARD)[:3, 3]
    free = 0.6 * speed_mm_s / 1e3 + 0.005
    thing = PlantObject.of(kind, position=tip - [0, 0, free], normal=[0, 0, -1])
    command = press(robot, STANDARD, [0, 0, -speed_mm_s / 1e3], way=free + into, held_joints=[7])
    run = source_plant(seed, [thing]).run(command)
    log = run.recording
    assert log.wrench is not None
    torque = -free_residual(run, inertia=True)
    lever = robot.jacobian(log.q)[:, :3, :6].transpose(0, 2, 1) @ np.array([0.0, 0.0, -1.0])
    estimated = (torque * lever).sum(axis=1) / (lever**2).sum(axis=1)
    measured = np.linalg.norm(log.wrench[:, :3], axis=1)
    error = zero_phase_lowpass(log.t, (estimated - measured)[:, None], cutoff_hz)[:, 0]
    touching = measured > 1.0
    braking = np.abs(np.diff(command.qd, axis=0)).max(axis=1) > 0.5 * 1e-3  # rad/s2, by the millisecond
    times = run.trace.t[braking]
    near = np.searchsorted(times, log.t + 0.5 / cutoff_hz) > np.searchsorted(times, log.t - 0.5 / cutoff_hz)
    steady = touching & ~near
    return PressError(
        outside=float(np.abs(error[steady]).max(initial=0.0)),
        during=float(np.abs(error[touching]).max()),
        peak=float(measured.max()),
        steady_rows=int(steady.sum()),
    )


def hit_scenario(pose: str, body: str, stiffness: float | None = None) -> bs.Scenario:
    """Schroeder's control group in a pose, against a body region."""
    degrees, velocity = POSES[pose]
    contact = {"body": body, "area_cm2": 1.0, "offset_law": "uniform"}
    return bs.Scenario.from_dict(
        {
            "robot": "sia5d",
            "pose_deg": degrees,
            "motion": {"velocity_mm_s": velocity, "held_joints": [7]},
            "contact": contact | ({} if stiffness is None else {"stiffness_N_m": stiffness}),
            "detector": {
                "thresholds_Nm": [20, 10, 20, 20, 20, 20, 20],
                "noise_sd_Nm": [3.636, 1.818, 3.636, 3.636, 3.636, 3.636, 3.636],
            },
            "reaction": {"kind": "reverse", "joint_acceleration_rad_s2": 4.5},
        }
    )


@dataclass(frozen=True)
class Hits:
    """Peak forces of the plant beside the law's.

    Attributes:
        stiffness: in series, as measured [N/m].
        law: mean peak force of the integrated distribution with that stiffness [N].
        law_sd: its sd [N].
        peaks: of the plant (seeds,) [N].
    """

    stiffness: float
    law: float
    law_sd: float
    peaks: Floats

    @property
    def ratio(self) -> float:
        """Mean of the plant over that of the law."""
        return float(self.peaks.mean() / self.law)

    @property
    def ratio_error(self) -> float:
        """Its standard error: offsets are spread evenly, so this is an upper bound."""
        return float(self.peaks.std(ddof=1) / np.sqrt(len(self.peaks)) / self.law)


def hits(pose: str, body: str, seeds: int) -> Hits:
    """Run the plant into a body once for each seed, with the law's detector: a threshold on J' F + noise."""
    problem = bs.CollisionProblem.from_scenario(hit_scenario(pose, body))
    robot, n = problem.robot, problem.velocity / np.linalg.norm(problem.velocity)
    tip = robot.pose(problem.q)[:3, 3]

    def thing(ahead: float) -> PlantObject:
        return PlantObject.of(body, position=tip + n * ahead, normal=n)

    stiffness = source_plant(0).series_stiffness(problem.q, thing(0.0))
    law = bs.evaluate(hit_scenario(pose, body, stiffness)).peak_force
    command: Command = line(robot, problem.q, list(problem.velocity), duration=1.0, held_joints=[7])
    peaks = []
    for seed in range(seeds):
        rng = np.random.default_rng([5, seed])
        # One in each of as many equal parts of the law's offsets; none begins inside.
        ahead = (seed + rng.random()) / seeds * problem.offset_size + 1e-7

        def watch(sample: Sample, rng: np.random.Generator = rng) -> PlantReaction | None:
            residual = sample.contact_torque + rng.normal(size=robot.dof) * problem.noise_sd
            if (np.abs(residual) > problem.thresholds).any():
                return PlantReaction(kind="reverse", joint_acceleration=4.5)
            return None

        peaks.append(source_plant(seed, [thing(ahead)]).run(command, on_sample=watch).peak_force)
    return Hits(stiffness, law.mean, law.sd, np.array(peaks))
