"""Shapes of Schroeder's parameter study (its tables 5.3 and 5.4): mean peak force against five parameters."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure

import bumpstop as bs
from bumpstop.report.picture import FAINT, LAW, Picture
from bumpstop.study import run
from bumpstop.study.parameters.fits import R2_WANTED, fit_models
from bumpstop.study.parameters.parameters import SOURCE, ParameterStudy
from bumpstop.study.range import Range
from collision.cases import control_group
from validation.facts import load
from validation.findings import Cell, Findings

TITLE = "Shapes of the parameter study (Schroeder 2013, chapter 5)"
Floats = npt.NDArray[np.float64]
# What Schroeder (2013) calls the keys that the library varies by default.
NAMES = {
    "contact.stiffness": "stiffness",
    "motion.speed": "speed",
    "detector.thresholds_and_noise": "threshold",
    "detector.feedback_period_s": "feedback_period",
    "reaction.joint_acceleration_rad_s2": "acceleration",
}
LAWS = ("linear", "quadratic", "power", "constant plus power")


def _control(**changes: object) -> bs.Scenario:
    """Table 5.2: a spring of 5600 N/m instead of a body."""
    scenario: bs.Scenario = control_group(**{"contact__stiffness_N_m": 5600.0} | changes)
    return scenario


def compare(findings: Findings, *, quick: bool) -> None:
    """Vary one parameter after the other and fit Schroeder's relationship."""
    facts = load("dissertation")["parameter_study"]
    findings.say(
        "Mean peak force of the integrated distribution in the standard pose, one parameter of table 5.2 varied at a "
        "time, by bumpstop study parameters. What is tested is the shape of each dependence and its direction. Where "
        f"the source's own law explains less than {R2_WANTED:g} of the variance, the better one is named."
    )
    findings.say(
        "The absolute numbers are Schroeder's own and do not follow from its published parameters: its charts have "
        "about 109 N at the control group, where table 5.2 in the standard pose gives about 24 N, and no single pose "
        "explains them (one slope needs a moment arm of 0.14 m, another more force per second than stiffness times "
        "speed). They stand beside ours for the record and nothing is tested on them."
    )
    study = ParameterStudy.of(_control())
    if quick:
        thinned = tuple(Range(each.variable, each.values[::3]) for each in study.ranges)
        study = ParameterStudy(study.scenario, thinned)
    rows, summary = run(study, threads=2)
    sweep = rows.filter(rows["kind"] == "sweep")
    table: list[list[Cell]] = []
    curves: list[tuple[str, str, Floats, Floats]] = []
    for about in summary["parameters"]:
        name = NAMES[about["key"]]
        relationship, direction = facts["relationship"][name], facts["direction"][name]
        own = sweep.filter(sweep["key"] == about["key"])
        x, mean = own["value"].to_numpy(), own["mean_N"].to_numpy()
        label = f"{name.replace('_', ' ')} [{about['unit']}]"
        curves.append((label, relationship, x, mean))
        fits = {fit["name"]: fit for fit in about["fits"]}
        better = about["better_law"] or relationship
        detail = f"R2 {fits[relationship]['r2']:.5f} for {fits[relationship]['formula']}"
        if better != relationship:
            detail += f"; the better law: {better}, R2 {fits[better]['r2']:.5f} for {fits[better]['formula']}"
        findings.check(
            f"Mean force against {label}: {relationship}, or the better law is named",
            fits[better]["r2"] >= R2_WANTED,
            detail,
        )
        findings.check(
            f"More {name.replace('_', ' ')}: force goes {direction}",
            about["direction"] == direction,
            f"{mean[0]:.2f} N at {x[0]:g} to {mean[-1]:.2f} N at {x[-1]:g}",
        )
        slope, unit = about["derivative"]["mean"], f"N/({about['unit']})"
        r2 = [fits[result]["r2"] if result in fits else None for result in LAWS]
        table.append([label, f"{relationship}, {direction}", *r2, slope, SOURCE[about["key"]][1], unit])
        findings.figures[name] = {"values": x, "mean_N": mean, "sd_N": own["sd_N"].to_numpy()}
    findings.table(
        "R2 of four laws, and derivatives of the mean peak force at the control group",
        ["Parameter", "Schroeder (2013)", *(f"R2 {name}" for name in LAWS), "dF/dx, ours", "dF/dx, Schroeder", "Unit"],
        ["", "", *([".5f"] * len(LAWS)), ".4g", ".4g", ""],
        table,
    )
    findings.say(
        "On the way to stop the point travels as far as its speed squared over twice its deceleration, so the peak "
        "is the force at detection, which no reaction can change, plus a part that falls with one over the joint "
        "acceleration. A power law without a constant fits that badly over a wide range, and well over a narrow one."
    )
    _absolute(findings)
    findings.picture(
        Picture(
            "parameter-study",
            "Five panels: mean peak force against stiffness, speed, threshold, feedback period and joint acceleration.",
            "Mean peak force of the integrated distribution against each parameter of the study; the line is "
            "Schroeder's law fitted to our means.",
            lambda figure: _draw(figure, curves),
            height=5.6,
        )
    )


def _absolute(findings: Findings) -> None:
    """Forces Schroeder (2013) states in newtons beside ours."""
    facts: dict[str, Any] = load("dissertation")["simulator_validation"]
    plexiglas = bs.evaluate(
        _control(
            contact__stiffness_N_m=float(facts["plexiglas_stiffness_N_per_m"]),
            motion__velocity_mm_s=[0.0, 0.0, -float(facts["speed_mm_s"])],
        )
    ).peak_force
    control = bs.evaluate(_control()).peak_force
    findings.table(
        "Absolute forces, for the record",
        ["Case", "Ours, mean [N]", "Ours, sd [N]", "Schroeder (2013) [N]"],
        ["", ".1f", ".1f", ".1f"],
        [
            # 128.8 a^-0.109 is the integral of Schroeder's derivative in table 5.4, without a constant.
            ["control group (table 5.2)", control.mean, control.sd, 14.037 / 0.109 * 4.5**-0.109],
            ["Plexiglas, 50 mm/s (section 5.2)", plexiglas.mean, plexiglas.sd, float(facts["maximum_force_N"])],
        ],
    )


def _draw(figure: Figure, curves: list[tuple[str, str, Floats, Floats]]) -> None:
    figure.subplots_adjust(left=0.11, right=0.97, bottom=0.09, top=0.97, hspace=0.45, wspace=0.3)
    for i, (label, relationship, x, mean) in enumerate(curves, start=1):
        panel = figure.add_subplot(3, 2, i)
        fitted = next(fit.fitted for fit in fit_models(x, mean) if fit.name == relationship)
        panel.plot(x, fitted, color=FAINT, linestyle="--")
        panel.plot(x, mean, "o", color=LAW, markersize=3.5)
        panel.set_xlabel(label)
        panel.set_ylabel("force [N]")
        panel.set_ylim(bottom=0)
