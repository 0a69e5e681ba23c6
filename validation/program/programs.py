"""Random programs with the speeds that were written for them, on the plant: how hard they hit, how long they take."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

import bumpstop as bs
from bumpstop.arrays import FloatArray
from bumpstop.collision.trajectory.trajectory import Trajectory, point_motion, point_places
from bumpstop.plant import Plant, PlantObject, PlantReaction, Sample, Sensors, along
from bumpstop.program.cell import Cell
from bumpstop.program.evaluation import ProgramResult, SegmentResult, evaluate_program
from program.corpora import EXAMPLES
from validation.findings import Findings

TITLE = "Random programs on the plant"
PROGRAMS, CONTACTS = 200, 25
# Contacts that are this far along a motion at least: before, the arm has not left [share].
_EDGE = 0.05
_STANDS = 5e-4  # [rad] from its end the arm has arrived


def compare(
    findings: Findings, *, quick: bool, programs: int | None = None, contacts: int | None = None, first: int = 0
) -> None:
    """Judge, write, run: every collision against the limit, every duration against the clock."""
    programs = programs or (1 if quick else PROGRAMS)
    contacts = contacts or (2 if quick else CONTACTS)
    findings.say(
        "URScript programs with a joint move and a line from it, of random targets and speeds. What is written is run "
        "on the UR10e in MuJoCo; a lower arm stands where a contact begins at a random time. The detector compares the "
        "plant's own contact torque with noise added at every feedback sample."
    )
    forces: list[float] = []
    clocks: list[float] = []
    segments = inconclusive = 0
    for number in range(first, first + programs):
        result = judged(number)
        for one in result.segments:
            segments += 1
            if one.written.verdict is None or not one.safe_factor > 0:
                inconclusive += 1
                continue
            motion = one.segment.at(one.factor)
            clocks.append(_clock_error(one, result.cell, motion))
            draw = np.random.default_rng([7, number, segments])
            times = draw.uniform(_EDGE, 1 - _EDGE, contacts) * motion.duration
            forces += [hit(result.cell, motion, float(t), seed) for seed, t in enumerate(times)]
    limit, peaks = result.cell.allowed_force, np.array(forces)
    over = float((peaks > limit).mean()) if peaks.size else 0.0
    accepted = result.cell.scenario.verdict.accepted_probability
    slack = 3 * np.sqrt(accepted / max(peaks.size, 1))
    findings.check(
        f"{segments} segments, {peaks.size} contacts: over the limit no more often than {accepted:g}",
        peaks.size > 0 and over <= accepted + slack,
        f"{int((peaks > limit).sum())} over, hardest {peaks.max(initial=0):.1f} of {limit:g} N",
    )
    worst = max(clocks, default=0.0)
    findings.check("time won or lost within 1 % of the plant's clock", worst <= 0.01, f"{100 * worst:.2f} % at most")
    findings.say(f"{inconclusive} of {segments} segments are inconclusive, or no speed is safe.")


def judged(number: int) -> ProgramResult:
    """A random program and what is found of it."""
    draw = np.random.default_rng([5, number])
    home = np.radians([0, -90, 90, -90, -90, 0])
    joints = home + draw.uniform(-0.25, 0.25, 6)
    robot = bs.Robot.load("ur10e")
    pose = robot.pose(joints)
    from scipy.spatial.transform import Rotation

    place = pose[:3, 3] + draw.uniform(-0.08, 0.08, 3)
    turn = Rotation.from_matrix(pose[:3, :3]).as_rotvec()
    numbers = ", ".join(f"{x:.6f}" for x in joints)
    target = ", ".join(f"{x:.6f}" for x in (*place, *turn))
    text = (
        f"movej([{numbers}], a={draw.uniform(0.8, 2):.3f}, v={draw.uniform(0.05, 1):.3f})\n"
        f"movel(p[{target}], a={draw.uniform(0.5, 2):.3f}, v={draw.uniform(0.02, 0.4):.3f})\n"
    )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "program.script"
        path.write_text(text, encoding="utf-8")
        return evaluate_program(path, bs.load_scenario(EXAMPLES / "cell.toml"))


def hit(cell: Cell, motion: Trajectory, begin: float, seed: int) -> float:
    """Peak force of one collision that begins at a time of a motion [N]."""
    problem = cell.at_rest
    at = np.array([begin])
    velocity = point_motion(motion, cell.robot, problem.contact_point, at)[0][0]
    place = point_places(motion, cell.robot, problem.contact_point, at)[0]
    thing = PlantObject(
        name="body",
        position=(float(place[0]), float(place[1]), float(place[2])),
        normal=(float(velocity[0]), float(velocity[1]), float(velocity[2])),
        stiffness=problem.stiffness,
        size=(0.02, 0.02),
    )
    noise = np.random.default_rng([11, seed])
    reaction = cell.scenario.reaction

    def watch(sample: Sample) -> PlantReaction | None:
        residual = sample.contact_torque + noise.normal(size=cell.robot.dof) * problem.noise_sd
        # Before contact the noise alone is no question here: an alarm there stops the arm sooner.
        if not sample.contact_force.any() or not (np.abs(residual) > problem.thresholds).any():
            return None
        return PlantReaction(
            kind="stop", joint_acceleration=problem.joint_acceleration.tolist(), latency_s=reaction.latency_s
        )

    rate = 1 / cell.scenario.detector.feedback_period_s
    plant = Plant(cell.robot, sensors=Sensors(rate_hz=rate), objects=[thing], seed=seed)
    return float(plant.run(along(motion, cell.robot, 0.2), on_sample=watch).peak_force)


def _clock_error(one: SegmentResult, cell: Cell, motion: Trajectory) -> float:
    """Difference of the time won on the plant from the one stated, as a share of the longer motion."""
    given, written = (_arrival(cell, each) for each in (one.segment.at(1.0), motion))
    return abs((given - written) - one.won_s) / max(one.present_s, one.written_s)


def _arrival(cell: Cell, motion: Trajectory) -> float:
    """When the arm of the plant is where its motion ends [s]."""
    recording = Plant(cell.robot, sensors=Sensors(rate_hz=1000.0)).run(along(motion, cell.robot, 0.5)).recording
    away: FloatArray = np.abs(recording.q - recording.q[-1]).max(axis=1)
    return float(recording.t[int(np.flatnonzero(away > _STANDS)[-1]) + 1])
