"""Schroeder's study of random poses (its section 6.2.3) with integrated distributions instead of single runs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure

import bumpstop as bs
from bumpstop.report.picture import INK, LAW, LIMIT, Picture, axes
from bumpstop.study import run
from bumpstop.study.directions import DirectionSampling
from bumpstop.study.workspace.workspace import WorkspaceStudy
from collision.cases import control_group, reference_settings
from reference import simulate_seeded
from validation.facts import load
from validation.findings import Cell, Findings

TITLE = "Random poses and directions (Schroeder 2013, section 6.2.3)"
Floats = npt.NDArray[np.float64]
LIMIT_N = 135.0  # hand, clamped, BG/BGIA 2011
# Joint accelerations: that of table 5.2, and one of a brisker arm. Schroeder (2013) read its own from a file not
# printed.
ACCELERATIONS_RAD_S2 = (4.5, 20.0)
# Damped least squares, the way many controllers cross singularities: the arm gets slower there instead of faster.
DAMPING = 0.01
DIRECTIONS: dict[DirectionSampling, str] = {"polar": "polar angle even", "sphere": "even on the sphere"}
BIN_N = 10.0  # as wide as Schroeder (2013) states its most common force
MOST_COMMON_N = (30.0, 50.0)
# Bins differ by more than chance if their counts differ by this many standard errors.
BEYOND_CHANCE = 2.0
EDGES_N = np.arange(0.0, 300.0 + BIN_N, BIN_N)
SEED = 623
# Single collisions of the reference simulator: so many sampling errors may lie between it and the sum of our
# probabilities.
AGREES = 3.0
# Undamped, the reference simulator goes on where our motions end at a singularity: collisions that we count as
# undetected.
UNDETECTED_SHARE = 0.02
Limits = Literal["respect", "ignore"]


@dataclass(frozen=True)
class Case:
    """One study of the library, under one direction distribution, joint acceleration, damping and respect for limits.

    Attributes:
        name: for people.
        compared: joint rates are exact and limits hold; or the case is there for its share alone.
        summary: what the study found.
    """

    name: str
    compared: bool
    summary: dict[str, Any]

    @property
    def medians(self) -> Floats:
        """Histogram of the median peak force, one count a pose."""
        return np.asarray(self.summary["distribution"]["poses_by_median"], dtype=np.float64)

    @property
    def mixture(self) -> Floats:
        """Expected histogram of the peak force over all collisions, in poses."""
        return np.asarray(self.summary["distribution"]["collisions"])


def compare(findings: Findings, *, quick: bool) -> None:
    """Draw poses and directions, and compute the distribution of each."""
    facts = load("dissertation")
    study, pose_facts = facts["workspace_study"], facts["robot"]["simulation_pose"]
    count = 30 if quick else 2000
    robot = bs.Robot.load("sia5d")
    findings.say(
        f"{count} poses, each joint even between its limits, joint 7 held at 0; the tool moves at "
        f"N({study['speed_mean_mm_s']}, {study['speed_sd_mm_s']}) mm/s and hits a hand, clamped, 75 000 N/m, force "
        f"limit {LIMIT_N:g} N. Schroeder (2013) ran one collision each of {study['samples']} poses; here every pose "
        "has its whole distribution, by bumpstop study workspace. Singularities end the motion instead of being "
        "crossed with a truncated inverse, unless joint rates are damped. Joint limits end it too, and velocity limits "
        "slow it; the source's simulator had neither, and 'no limits' is without both. Collisions never detected count "
        "as over the limit."
    )
    _limits(findings, robot, study, pose_facts)
    cases = []
    for directions, words in DIRECTIONS.items():
        for acceleration in ACCELERATIONS_RAD_S2:
            for damping in (0.0, DAMPING):
                for limits in ("respect", "ignore"):
                    name = f"{words}, {acceleration:g} rad/s2" + (f", damping {damping:g}" if damping else "")
                    name += ", no limits" if limits == "ignore" else ""
                    workspace = _study(directions, acceleration, damping, limits, count, study)
                    case = Case(name, not damping and limits == "respect", run(workspace, threads=2).summary)
                    cases.append(case)
                    findings.progress(f"{name}: {100 * case.summary['p_over_force']['mean']:.1f} % over {LIMIT_N:g} N")
    _report(findings, cases, study)
    _against_the_reference_simulator(findings, study, quick=quick)


def _limits(findings: Findings, robot: bs.Robot, study: dict[str, Any], pose_facts: dict[str, Any]) -> None:
    """Show the joint ranges beside Schroeder's, in Schroeder's angles."""
    sign, offset = np.array(pose_facts["urdf_sign"]), np.array(pose_facts["urdf_offset_deg"])
    ends = sign * (np.degrees([robot.lower, robot.upper]) - offset)
    low, high = ends.min(axis=0), ends.max(axis=0)
    rows: list[list[Cell]] = []
    differ = []
    for j in range(robot.dof):
        theirs = (float(study["joint_min_deg"][j]), float(study["joint_max_deg"][j]))
        held = j == 6
        ours = (0.0, 0.0) if held else (float(low[j]), float(high[j]))
        if not np.allclose(ours, theirs):
            differ.append(
                f"joint {j + 1}: {ours[0]:g} to {ours[1]:g} deg instead of {theirs[0]:g} to {theirs[1]:g} deg"
            )
        rows.append([f"{j + 1}", *ours, *theirs])
    findings.table(
        "Ranges of the joints, in Schroeder's angles",
        ["Joint", "From [deg]", "To [deg]", "Schroeder, from [deg]", "Schroeder, to [deg]"],
        ["", ".0f", ".0f", ".0f", ".0f"],
        rows,
    )
    findings.say(
        "The built-in robot counts joint 4 from another zero (90 deg further on) and joint 2 the other way round. "
        + (
            f"Otherwise its ranges differ: {'; '.join(differ)}."
            if differ
            else "Apart from that the ranges are the same."
        )
    )


def _study(
    directions: DirectionSampling,
    acceleration: float,
    damping: float,
    limits: Limits,
    count: int,
    facts: dict[str, Any],
) -> WorkspaceStudy:
    scenario = control_group(
        reaction__joint_acceleration_rad_s2=acceleration,
        motion__damping=damping,
        motion__velocity_mm_s=[0.0, 0.0, -float(facts["speed_mean_mm_s"])],
    )
    return WorkspaceStudy(
        scenario,
        poses=count,
        directions=directions,
        speed_sd_mm_s=float(facts["speed_sd_mm_s"]),
        joint_limits=limits,
        velocity_limits=limits,
        seed=SEED,
    )


def _against_the_reference_simulator(findings: Findings, facts: dict[str, Any], *, quick: bool) -> None:
    """Run one collision of every pose in the reference simulator, as Schroeder (2013) did; count those over."""
    rows: list[list[Cell]] = []
    walls: list[list[Cell]] = []
    for acceleration in ACCELERATIONS_RAD_S2:
        for damping, velocity_limits in ((DAMPING, "respect"), (0.0, "ignore"), (0.0, "respect")):
            literal = not damping and velocity_limits == "ignore"
            count = 4 if quick else 2000 if damping else 800 if literal else 500
            # The reference simulator knows no joint limits.
            study = replace(
                _study("polar", acceleration, damping, "ignore", count, facts), velocity_limits=velocity_limits
            )
            found = run(study, threads=2).rows
            found = found.filter(found["end"] != "singular_start")
            p = found["p_over_force"].to_numpy()
            passes = np.array([_reference_exceeds(study, row, i) for i, row in enumerate(found.iter_rows(named=True))])
            over = int(passes.sum())
            errors = float((over - p.sum()) / max(np.sqrt((p * (1 - p)).sum()), 0.5))
            name = f"{acceleration:g} rad/s2, " + (f"damping {damping:g}" if damping else "undamped")
            name += ", no velocity limits" if velocity_limits == "ignore" else ""
            rows.append([name, len(p), over / len(p), float(p.mean()), errors])
            findings.progress(
                f"{name}: the reference simulator {100 * over / len(p):.1f} %, ours {100 * p.mean():.1f} %"
            )
            if literal:
                by_walls = np.array(
                    [_reference_exceeds(study, row, i, walls=True) for i, row in enumerate(found.iter_rows(named=True))]
                )
                share = f"{acceleration:g} rad/s2"
                apart = int((np.abs(passes - p) > 0.5).sum())
                walls.append([share, len(p), float(p.mean()), over / len(p), apart, float(by_walls.mean())])
                findings.progress(f"{share}, three walls: the reference simulator {100 * by_walls.mean():.1f} %")
                findings.check(
                    f"{name}: collisions of the reference simulator over {LIMIT_N:g} N within {AGREES:g} sampling "
                    f"errors and {UNDETECTED_SHARE:.0%} of the poses",
                    abs(over - p.sum()) < AGREES * np.sqrt((p * (1 - p)).sum()) + UNDETECTED_SHARE * len(p),
                    f"{over} of {len(p)}, we expect {p.sum():.1f}",
                )
            if damping:
                findings.check(
                    f"{name}: reference collisions over {LIMIT_N:g} N within {AGREES:g} sampling errors",
                    abs(errors) < AGREES,
                    f"{over} of {len(p)}, we expect {p.sum():.1f}, {errors:+.2f} errors",
                )
    findings.table(
        f"One reference collision for every pose, polar angle even, no joint limits: share over {LIMIT_N:g} N",
        ["Acceleration", "Poses", "The reference simulator", "Ours", "Sampling errors between them"],
        ["", "d", ".4f", ".4f", "+.2f"],
        rows,
    )
    findings.table(
        f"Undamped poses without velocity limits, against one plane and against Schroeder's walls: share over "
        f"{LIMIT_N:g} N",
        [
            "Acceleration",
            "Poses",
            "Ours, one plane",
            "The reference simulator, one plane",
            "Poses on which these two differ",
            "The reference simulator, three walls",
        ],
        ["", "d", ".4f", ".4f", "d", ".4f"],
        walls,
    )
    findings.say(
        "Schroeder's simulator has three walls, one across each axis, each with a distance of its own drawn from that "
        "axis's speed, and each touched behind the start as well. An arm that moves obliquely meets the nearest of "
        "them with a fraction of its speed, and one that is turned aside meets those beside its line."
    )
    findings.say(
        "A sampling error is that of one draw from each pose's own probability, which is small: most poses are over "
        "the limit or not whatever chance does. Undamped arms are not tested: at a singularity the reference "
        "simulator's inverse drops a direction and goes on, and ours ends the motion."
    )


def _reference_exceeds(study: WorkspaceStudy, row: dict[str, Any], number: int, *, walls: bool = False) -> bool:
    """Whether one collision of the reference simulator at the pose of a row passes the limit; one never detected does.

    ``walls``: against three walls, and with an inverse that drops what is smaller by 1e-7, as Schroeder (2013) had it.
    """
    scenario = study.scenario
    velocity = np.array([row[f"velocity_{axis}_m_s"] for axis in "xyz"])
    speed = float(np.linalg.norm(velocity))
    contact: dict[str, Any] = {"per_axis_walls": True, "singular_tolerance": 1e-7} if walls else {}
    settings = reference_settings(
        scenario,
        start_position=[row[f"q_{j + 1}"] for j in range(7)],
        velocity_m_s=velocity,
        noise_sd_Nm=scenario.detector.noise_sd_Nm,
        **(contact or {"normal": velocity / speed}),
        **({"max_speed": np.inf} if study.velocity_limits == "ignore" else {}),
    )
    drawn = np.abs(np.random.default_rng([SEED, number]).normal(size=3)) * scenario.contact.offset_sd_s
    runs = simulate_seeded(settings, [drawn * np.abs(velocity)] if walls else [drawn[0] * speed], number)
    force = float(runs.max_force_N[0])
    return bool(force > LIMIT_N if runs.detected[0] else force > 0)


def _report(findings: Findings, studies: list[Case], facts: dict[str, Any]) -> None:
    rows: list[list[Cell]] = []
    for study in studies:
        found = study.summary
        over = found["p_over_force"]
        rows.append(
            [
                study.name,
                over["mean"],
                over["standard_error"],
                found["p_over_force_or_no_contact"]["mean"],
                _mode(study.medians)[0],
                _mode(study.mixture)[0],
                found["median_force_N"]["median"],
                found["singular_starts"],
                found["poses_more_often_undetected"],
                found["undetected"]["mean"],
                found["no_contact"]["mean"],
                *(found["ends"][end] for end in ("joint_limit", "singularity", "motion_end")),
            ]
        )
    findings.table(
        f"Share over {LIMIT_N:g} N, most common force, and what could not be detected",
        [
            "Directions, acceleration",
            f"P(over {LIMIT_N:g} N)",
            "its standard error",
            "with those that hit nothing",
            "Mode of medians, from [N]",
            "Mode of all collisions, from [N]",
            "Median of medians [N]",
            "Singular starts",
            "Poses more often undetected than not",
            "P(undetected)",
            "P(no contact)",
            "Ended by a joint limit",
            "by a singularity",
            "by the time simulated",
        ],
        ["", ".3f", ".3f", ".3f", "g", "g", ".1f", "d", "d", ".4f", ".4f", "d", "d", "d"],
        rows,
    )
    low, high = facts["most_common_force_N"]
    findings.say(
        "Three or four bins about the mode are almost equally full, so which one is fullest is partly chance. The "
        f"check asks whether any bin is fuller, by more than {BEYOND_CHANCE:g} standard errors of the counts, than "
        f"the fullest between {MOST_COMMON_N[0]:g} and {MOST_COMMON_N[1]:g} N."
    )
    for study in studies:
        if not study.compared:
            continue
        for what, histogram in (("median peak force", study.medians), ("peak force of all collisions", study.mixture)):
            begin, end = _mode(histogram)
            there, elsewhere = _fullest(histogram)
            findings.check(
                f"{study.name}: nothing speaks against a most common {what} of "
                f"{MOST_COMMON_N[0]:g} to {MOST_COMMON_N[1]:g} N",
                elsewhere - there <= BEYOND_CHANCE * np.sqrt(there + elsewhere),
                f"fullest bin {begin:g} to {end:g} N; {there:.0f} poses in the fullest there, {elsewhere:.0f} in the "
                f"fullest elsewhere; Schroeder (2013): {low} to {high} N",
            )
    shares = ", ".join(f"{100 * study.summary['p_over_force']['mean']:.1f} %" for study in studies)
    findings.say(
        f"Schroeder (2013) has less than {100 * facts['over_force_limit_fraction_max']:g} % over {LIMIT_N:g} N; we "
        f"find {shares} in the order of the table. Nothing is tested on the share: it hangs on the joint acceleration, "
        "which Schroeder (2013) does not print, on the distribution of directions, and on what an arm does at a "
        "singularity or a joint limit. Without limits the share should be Schroeder's: its simulator had none. With "
        "them its arm goes on where ours ends before contact; another column counts cases in which nothing is hit as "
        "over, those that a false alarm stops among them."
    )
    findings.figures |= {
        "edges_N": [*EDGES_N, None],
        "studies": [
            {
                "study": study.name,
                "over_limit": study.summary["p_over_force"]["mean"],
                "over_limit_error": study.summary["p_over_force"]["standard_error"],
                "medians": study.medians,
                "mixture": study.mixture,
            }
            for study in studies
        ],
    }
    findings.picture(
        Picture(
            "workspace",
            "Histogram of the median peak force over random poses, highest between 30 and 50 N.",
            "Median peak force over random poses, in bins of 10 N (bars: polar angle even, 4.5 rad/s2; lines: "
            "expected counts of single collisions). The last bin holds all beyond 300 N and the undetected.",
            lambda figure: _draw(figure, studies),
        )
    )


def _mode(histogram: npt.NDArray[Any]) -> tuple[float, float]:
    """Ends of the fullest bin [N]; what lies beyond the last edge is no bin."""
    at = int(np.argmax(histogram[: EDGES_N.size - 1]))
    return float(EDGES_N[at]), float(EDGES_N[at + 1])


def _fullest(histogram: npt.NDArray[Any]) -> tuple[float, float]:
    """Poses in the fullest bin between the ends of the expected mode, and in the fullest other one."""
    inside = (EDGES_N[:-1] >= MOST_COMMON_N[0]) & (EDGES_N[1:] <= MOST_COMMON_N[1])
    counts = histogram[: inside.size]
    return float(counts[inside].max()), float(counts[~inside].max())


def _draw(figure: Figure, studies: list[Case]) -> None:
    panel = axes(figure)
    edges = [*EDGES_N, EDGES_N[-1] + BIN_N]
    panel.stairs(studies[0].medians, edges, fill=True, color=LAW, alpha=0.35)
    compared = [study for study in studies if study.compared]
    for study, style in zip(compared, ("-", "--", "-.", ":"), strict=True):
        panel.stairs(study.mixture, edges, color=INK, linestyle=style, linewidth=1.2, label=study.name)
    panel.axvline(LIMIT_N, color=LIMIT, linestyle="--", linewidth=1.2)
    panel.text(LIMIT_N + 3, panel.get_ylim()[1] * 0.4, "135 N", color=LIMIT)
    panel.set_xlabel("peak force [N]")
    panel.set_ylabel("poses")
    panel.set_title("Random poses")
    panel.legend(loc="upper right")
