"""Speed: each figure beside its target and the reference simulator with the same flags, in one run on a core."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median

import numpy as np
import pinocchio as pin

REPOSITORY = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(REPOSITORY / "tests"))

import bumpstop as bs  # noqa: E402
import reference  # noqa: E402
import reference.library as reference_library  # noqa: E402
from benchmarks import studies  # noqa: E402
from benchmarks.million_rows import million_rows  # noqa: E402
from bumpstop import _native  # noqa: E402
from bumpstop.model import inverse_dynamics  # noqa: E402
from bumpstop.plant import line  # noqa: E402
from collision.cases import control_group, free, reference_settings  # noqa: E402
from model.dynamics_cases import general_arm, pinocchio_model  # noqa: E402
from plant.cases import STANDARD, source_plant  # noqa: E402

FLAGS = {
    "baseline": [],
    "neon": [],
    "avx2": ["-mavx2", "-mfma"],
    "avx512": ["-mavx512f", "-mavx512dq", "-mavx512vl", "-mavx2", "-mfma", "-mprefer-vector-width=512"],
}
COMMON = ["-std=c++20", "-O3", "-ffp-contract=off"]
REFERENCE_RUNS = 1000  # what Schroeder (2013) drew for one distribution
BATCH = 4000
# Half of random poses come near a singularity, and arms are followed there as finely as a distribution needs: these
# take longer than the others, and set the mean. Measured on AVX-512: 740 and 170 us of processor time.
RANDOM_POSE_US, EASY_POSE_US = 900, 220


def seconds(action: Callable[[], object], repeats: int) -> float:
    """Median wall time of ``action`` after one call to warm up [s]."""
    action()
    times = []
    for _ in range(repeats):
        begin = time.perf_counter()
        action()
        times.append(time.perf_counter() - begin)
    return median(times)


def row(what: str, value: str, target: str, ok: bool | None, ratio: str = "") -> None:
    """Print one line of the table; ``ok`` None: there is no target on this machine."""
    print(
        f"{what:<52} {value:>16} {target:>16} {ratio:>16}  {'' if ok is None else 'PASS' if ok else 'FAIL'}", flush=True
    )


def whole_law(problem: bs.CollisionProblem) -> object:
    """A complete result from a checked scenario: curve, distribution, moments, quantiles, exceedance."""
    result = bs.integrate(problem, bs.stopping_curve(problem))
    force = result.peak_force
    figures = [force.mean, force.sd, *(force.quantile(p) for p in (0.5, 0.95, 0.99, 0.999))]
    return figures, result.trigger_joint_probability


def reference_seconds_per_run(scenario: bs.Scenario, runs: int = 12) -> float:
    """Time of one run of the reference simulator with noise of its own [s]."""
    settings = reference_settings(scenario, noise_sd_Nm=bs.CollisionProblem.from_scenario(scenario).noise_sd)
    offsets = np.abs(np.random.default_rng(1).normal(size=runs)) * 0.1 * np.linalg.norm(settings.velocity_m_s)
    return seconds(lambda: reference.simulate_seeded(settings, offsets, 1), 3) / runs


def random_poses(robot: bs.Robot, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Poses as in Schroeder's section 6.2.3, and velocities of N(10, 2) mm/s in directions even over the sphere."""
    rng = np.random.default_rng(623)
    q = rng.uniform(robot.lower, robot.upper, size=(count, robot.dof))
    q[:, 6] = 0
    direction = rng.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    return q, direction * rng.normal(0.010, 0.002, size=(count, 1))


def figures(name: str) -> list[float]:
    """What a C++ program of this folder prints, compiled as the kernels are."""
    compiler = os.environ.get("CXX", "c++")
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder) / name
        command = [compiler, *COMMON, "-Wno-psabi", *FLAGS[_native.target]]
        command += ["-I", str(REPOSITORY / "include"), str(REPOSITORY / f"benchmarks/{name}.cpp"), "-o", str(program)]
        subprocess.run(command, check=True)
        return [float(x) for x in subprocess.run([program], check=True, capture_output=True, text=True).stdout.split()]


def substep() -> tuple[int, float, float, float, float]:
    """Lanes, then ns per lane and sub-step for 6 of 7 joints, 7 joints, 6 on a rail, and a plain double."""
    lanes, six, seven, rail, scalar = figures("substep")
    return int(lanes), six, seven, rail, scalar


def newton_euler() -> None:
    """Inverse dynamics of seven joints, sines and cosines included, beside Pinocchio through its binding."""
    robot = general_arm()
    model = pinocchio_model(robot)
    data = model.createData()
    q, qd, qdd = np.random.default_rng(7).normal(size=(3, 4000, robot.dof))

    def one_by_one() -> None:
        for row in zip(q, qd, qdd, strict=True):
            pin.rnea(model, data, *row)

    theirs = seconds(one_by_one, 9) / len(q) * 1e9
    lanes, wide, scalar = figures("dynamics")
    batch = seconds(lambda: inverse_dynamics(robot, q, qd, qdd), 9) / len(q) * 1e9
    row("", "measured", "target", None, "Pinocchio / ours")
    # The target is for eight lanes.
    target = 25 * 8 / lanes
    row(
        f"Newton-Euler per lane, {lanes:.0f} lanes",
        f"{wide:.1f} ns",
        f"<= {target:.0f}",
        wide <= target,
        f"{theirs / wide:.1f}",
    )
    row("Newton-Euler, one double", f"{scalar:.0f} ns", "<= 150", scalar <= 150, f"{theirs / scalar:.1f}")
    row(f"inverse_dynamics of {len(q)} rows, from Python, each", f"{batch:.0f} ns", "", None, f"{theirs / batch:.1f}")
    row("Pinocchio's rnea from Python, each", f"{theirs:.0f} ns", "", None)


def plant_seconds() -> None:
    """A simulated second of the plant, beside MuJoCo's steps alone; the fastest of several."""
    import mujoco

    plant = source_plant(1)
    command = line(plant.robot, STANDARD, [0, 0, -0.005], duration=1.0, start="rest")
    times = []
    for _ in range(5):
        begin = time.perf_counter()
        plant.run(command)
        times.append(time.perf_counter() - begin)
    steps = []
    for _ in range(5):
        begin = time.perf_counter()
        for _ in range(5000):
            mujoco.mj_step(plant.model, plant.data)
        steps.append(time.perf_counter() - begin)
    row("", "measured", "target", None, "ours / MuJoCo")
    whole, bare = min(times), min(steps)
    row("plant, a simulated second of seven joints", f"{whole:.3f} s", "<= 0.5 s", whole <= 0.5, f"{whole / bare:.1f}")
    row("  of it 5000 steps of MuJoCo", f"{bare:.3f} s", "", None)


def detector() -> None:
    """A full tick of the detector for seven joints, beside Pinocchio's Newton-Euler through its binding."""
    robot = general_arm()
    model = pinocchio_model(robot)
    data = model.createData()
    q, qd, qdd = np.random.default_rng(7).normal(size=(3, 4000, robot.dof))
    theirs = seconds(lambda: [pin.rnea(model, data, *row) for row in zip(q, qd, qdd, strict=True)], 9) / len(q) * 1e9
    times = figures("detector")
    row("", "measured", "target", None, "Pinocchio / ours")
    for k, name in enumerate(("direct", "observer", "direct, uneven times")):
        middle, least, rare, most, worst, alone, plain, plain_rare, clock, clock_rare, own, own_worst = times[
            12 * k : 12 * k + 12
        ]
        goal = name == "direct"
        what = f"detector tick, 7 joints, {name}"
        # What the clock's own two calls always take is no part of the tick.
        half, rarely = middle - clock, rare - clock
        row(f"{what}, median", f"{half:.0f} ns", "<= 300" if goal else "", half <= 300 if goal else None)
        row(f"{what}, 99.9 %", f"{rarely:.0f} ns", "<= 1000" if goal else "", rarely <= 1000 if goal else None)
        row(
            "  the middle of five measurements of 10^6, from", f"{least - clock:.0f} to {most - clock:.0f} ns", "", None
        )
        row("  taken off for the clock, and its 99.9 %", f"{clock:.0f}, {clock_rare:.0f} ns", "", None)
        row(f"  arithmetic of {plain:.0f} ns without memory, 99.9 %", f"{plain_rare:.0f} ns", "", None)
        row("  each tick's least of five: 99.9 %, largest", f"{own:.0f}, {own_worst:.0f} ns", "", None)
        row(f"{what}, worst of 5 x 10^6", f"{worst:.0f} ns", "", None)
        row(f"{what}, without the clock", f"{alone:.0f} ns", "", None, f"{theirs / alone:.1f}")
    row("Pinocchio's rnea from Python, each", f"{theirs:.0f} ns", "", None)


def study_rows() -> None:
    """Schroeder's workspace, what it takes besides distributions, and the speed limits of a trajectory."""
    row("", "measured", "target", None)
    rows, page = studies.workspace_command()
    source = f"study workspace, {studies.SOURCE_POSES} poses"
    row(f"{source}, two threads, to its rows", f"{rows:.1f} s", "<= 10 s", rows <= 10)
    row("  to its page", f"{page:.1f} s", "", None)
    took = min(studies.workspace_without_laws() for _ in range(2))
    row(f"{source}, all but distributions", f"{took:.2f} s", "<= 3 s", took <= 3)
    each = studies.predicted_case()
    row("  predicted force of a pose, processor time", f"{each * 1e6:.0f} us", "", None)
    wall, processor = studies.speed_limits_command()
    row(f"study speed-limits --out, {studies.WAYPOINTS} waypoints, whole command", f"{wall:.2f} s", "<= 2 s", wall <= 2)
    row("  its processor time", f"{processor:.2f} s", "", None)


def main() -> None:
    """Print the table."""
    reference_library.DEFAULT_FLAGS = (*COMMON, "-shared", "-fPIC", *FLAGS[_native.target])
    needed = f"the reference simulator needs {REFERENCE_RUNS} runs for a distribution like Schroeder's"
    print(f"kernels: {_native.target}; one core; {needed}\n")
    row("", "measured", "target", None, "reference / ours")
    for path in sorted((REPOSITORY / "examples").glob("*.toml")):
        scenario = bs.load_scenario(path)
        # A mixture of hundreds of distributions, which the reference simulator does not know.
        if scenario.motion.kind == "trajectory":
            continue
        problem = bs.CollisionProblem.from_scenario(scenario)
        ours = seconds(lambda p=problem: whole_law(p), 30)  # type: ignore[misc]
        theirs = reference_seconds_per_run(scenario) * REFERENCE_RUNS
        row(
            f"complete distribution, {path.stem}",
            f"{ours * 1e3:.2f} ms",
            "<= 1 ms",
            ours <= 1e-3,
            f"{theirs / ours:.0f}",
        )

    for what, scenario in (
        ("free contact, 4.4 kg", free(4.4)),
        ("free contact, 40 kg, soft", free(40.0, contact__stiffness_N_m=12000)),
        ("correlated noise", control_group(detector__noise_correlation=0.5)),
    ):
        problem = bs.CollisionProblem.from_scenario(scenario)
        row(f"complete distribution, {what}", f"{seconds(lambda p=problem: whole_law(p), 5) * 1e3:.1f} ms", "", None)  # type: ignore[misc]

    scenario = control_group(motion__velocity_mm_s=[0, 0, -10])
    q, velocity = random_poses(bs.Robot.load("sia5d"), BATCH)
    begin = time.perf_counter()
    laws = bs.evaluate_batch(scenario, q, velocity, limits_N=[135.0])
    each = (time.perf_counter() - begin) / BATCH
    theirs = reference_seconds_per_run(scenario) * REFERENCE_RUNS
    row(
        f"distribution in a batch of {BATCH} random poses",
        f"{each * 1e6:.0f} us",
        f"<= {RANDOM_POSE_US} us",
        each <= RANDOM_POSE_US * 1e-6,
        f"{theirs / each:.0f}",
    )
    robot = bs.Robot.load("sia5d")
    singular = np.linalg.svd(robot.jacobian(q)[:, :, :6], compute_uv=False)[:, -1]
    easy = (singular > 0.02) & (laws.end == "all_detected")
    begin = time.perf_counter()
    bs.evaluate_batch(scenario, q[easy], velocity[easy], limits_N=[135.0])
    each = (time.perf_counter() - begin) / easy.sum()
    row(
        f"  of them the {easy.sum()} clear of singularities and limits",
        f"{each * 1e6:.0f} us",
        f"<= {EASY_POSE_US} us",
        each <= EASY_POSE_US * 1e-6,
    )

    scenario = bs.load_scenario(REPOSITORY / "examples/01_hand_downward.toml")
    problem = bs.CollisionProblem.from_scenario(scenario)
    curve = bs.stopping_curve(problem)
    runs = 500_000
    settings = _native.MonteCarloSettings()
    settings.seed, settings.count, settings.noise = 1, runs, False
    ours = seconds(lambda: curve.line.monte_carlo(problem.detector, problem.contact, settings, None), 3) / runs
    theirs = reference_seconds_per_run(scenario)
    row("sampled runs per second, one curve", f"{1 / ours:.3g}", ">= 1e6", ours <= 1e-6, f"{theirs / ours:.0f}")

    lanes, six, seven, rail, scalar = substep()
    settings = reference_settings(scenario)
    begin = time.perf_counter()
    path = reference.trace(reference_settings(scenario, duration_s=0.4), float("inf"))
    literal = (time.perf_counter() - begin) / (len(path.time_s) * settings.substeps) * 1e9
    wide = _native.target == "avx512"
    what = f"controller sub-step per lane, {lanes} lanes"
    for joints, took in (("6 of 7 joints", six), ("7 joints", seven), ("6 joints on a rail", rail)):
        passes = took <= 60 if wide else None
        row(f"{what}, {joints}", f"{took:.1f} ns", "<= 60 (avx512)", passes, f"{literal / took:.0f}")
    row("controller sub-step, one double", f"{scalar:.0f} ns", "", None, f"{literal / scalar:.0f}")

    newton_euler()
    plant_seconds()
    detector()
    study_rows()
    million_rows(row)

    command = [sys.executable, "-c", "from bumpstop.cli.main import main; main()"]
    example = str(REPOSITORY / "examples/01_hand_downward.toml")

    def run(*arguments: str) -> float:
        return seconds(lambda: subprocess.run([*command, *arguments], check=False, capture_output=True), 5)

    for what, limit, arguments in (
        ("bumpstop --help", 0.25, ["--help"]),
        ("bumpstop evaluate --json", 1.0, ["evaluate", example, "--json"]),
    ):
        took = run(*arguments)
        row(what, f"{took:.2f} s", f"< {limit:g} s", took < limit)
    with tempfile.TemporaryDirectory() as folder:
        took = run("evaluate", example, "--out", folder)
    row("bumpstop evaluate --out (report, figures, tables)", f"{took:.2f} s", "< 4 s", took < 4)


if __name__ == "__main__":
    main()
