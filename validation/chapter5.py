"""Shapes of the source's parameter study (its tables 5.3 and 5.4): mean peak force against five parameters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure
from scipy import optimize

import bumpstop as bs
from bumpstop.report.picture import FAINT, LAW, Picture
from collision.cases import control_group
from validation.facts import load
from validation.findings import Cell, Findings

TITLE = "Shapes of the parameter study (chapter 5 of the source)"
Floats = npt.NDArray[np.float64]
# What a fit must explain of the variance of the means.
R2_WANTED = 0.99


@dataclass(frozen=True)
class Parameter:
    """One parameter of the study.

    Attributes:
        name: as in the facts.
        label: for people, with unit.
        values: at which the law is worked out.
        control: value of the control group.
        change: the scenario for a value.
        derivative: the source's derivative of the mean force at a value, its own formula.
        unit: of the derivative.
    """

    name: str
    label: str
    values: Floats
    control: float
    change: Callable[[float], bs.Scenario]
    derivative: Callable[[float], float]
    unit: str


def _control(**changes: object) -> bs.Scenario:
    """Table 5.2: a spring of 5600 N/m instead of a body."""
    scenario: bs.Scenario = control_group(**{"contact__stiffness_N_m": 5600.0} | changes)
    return scenario


def _with_threshold(threshold: float) -> bs.Scenario:
    """Joint 2 at ``threshold`` and the others at twice that, noise in proportion as in table 5.2 [Nm]."""
    thresholds = [2 * threshold, threshold, *[2 * threshold] * 5]
    return _control(detector__thresholds_Nm=thresholds, detector__noise_sd_Nm=[t / 5.5 for t in thresholds])


PARAMETERS = (
    Parameter(
        "stiffness",
        "stiffness [N/m]",
        np.linspace(1400, 21000, 15),
        5600,
        lambda K: _control(contact__stiffness_N_m=K),
        lambda K: 0.0048,
        "N/(N/m)",
    ),
    Parameter(
        "speed",
        "speed [mm/s]",
        np.linspace(10, 200, 20),
        50,
        lambda v: _control(motion__velocity_mm_s=[0.0, 0.0, -v]),
        lambda v: 0.0176 * v - 0.101,
        "N/(mm/s)",
    ),
    Parameter(
        "threshold",
        "threshold of joint 2 [Nm]",
        np.linspace(2, 30, 15),
        10,
        _with_threshold,
        lambda t: 7.3526,
        "N/Nm",
    ),
    Parameter(
        "feedback_period",
        "feedback period [s]",
        np.array([1, 2, 3, 4, 5, 6, 8, 10, 12, 14, 16]) / 1e3,
        0.004,
        lambda dt: _control(detector__feedback_period_s=round(dt, 6)),
        lambda dt: 19.48 * dt**-0.8981,
        "N/s",
    ),
    Parameter(
        "acceleration",
        "joint acceleration [rad/s2]",
        np.array([1, 1.5, 2, 3, 4.5, 6, 8, 10, 14, 20]),
        4.5,
        lambda a: _control(reaction__joint_acceleration_rad_s2=float(a)),
        lambda a: -14.037 * a**-1.109,
        "N/(rad/s2)",
    ),
)


# --- Laws to fit ------------------------------------------------------------------------------------------------


def _linear(x: Floats, y: Floats) -> tuple[Floats, str]:
    """A + B x."""
    B, A = np.polyfit(x, y, 1)
    return A + B * x, f"{A:.4g} {B:+.4g} x"


def _quadratic(x: Floats, y: Floats) -> tuple[Floats, str]:
    """A + B x + C x^2."""
    C, B, A = np.polyfit(x, y, 2)
    return A + B * x + C * x**2, f"{A:.4g} {B:+.4g} x {C:+.4g} x^2"


def _power(x: Floats, y: Floats) -> tuple[Floats, str]:
    """A x^B, without a constant, as the source has it."""
    z = x / x[-1]  # of a size for the search
    (A, B), _ = optimize.curve_fit(lambda z, A, B: A * z**B, z, y, p0=(y[-1], 0.0))
    return A * z**B, f"{A / x[-1] ** B:.4g} x^{B:.4g}"


def _constant_plus_power(x: Floats, y: Floats) -> tuple[Floats, str]:
    """A + B x^C. For a given C the rest is linear, so only C is searched for."""

    def fit(C: float) -> tuple[float, float]:
        B, A = np.polyfit(x**C, y, 1)
        return float(A), float(B)

    def misfit(C: float) -> float:
        A, B = fit(C)
        return float(np.sum((y - A - B * x**C) ** 2))

    C = float(optimize.minimize_scalar(misfit, bounds=(-2.5, 2.5), method="bounded").x)
    A, B = fit(C)
    return A + B * x**C, f"{A:.4g} {B:+.4g} x^{C:.4g}"


FITS: dict[str, Callable[[Floats, Floats], tuple[Floats, str]]] = {
    "linear": _linear,
    "quadratic": _quadratic,
    "power": _power,
    "constant plus power": _constant_plus_power,
}


def r_squared(y: Floats, fitted: Floats) -> float:
    """Share of the variance that a fit explains."""
    return float(1 - np.sum((y - fitted) ** 2) / np.sum((y - y.mean()) ** 2))


# --- The study --------------------------------------------------------------------------------------------------


def compare(findings: Findings, *, quick: bool) -> None:
    """Vary one parameter after the other and fit the source's relationship."""
    study = load("dissertation")["parameter_study"]
    findings.say(
        "Mean peak force of the exact law in the standard pose, one parameter of table 5.2 varied at a time. What is "
        "tested is the shape of each dependence and its direction. Where the source's own law explains less than "
        f"{R2_WANTED:g} of the variance, the better one is named."
    )
    findings.say(
        "The absolute numbers are the source's own and do not follow from its published parameters: its charts have "
        "about 109 N at the control group, where table 5.2 in the standard pose gives about 24 N, and no single pose "
        "explains them (one slope needs a moment arm of 0.14 m, another more force per second than stiffness times "
        "speed). They stand beside ours for the record and nothing is tested on them."
    )
    rows: list[list[Cell]] = []
    curves: list[tuple[Parameter, Floats, Floats]] = []
    for parameter in PARAMETERS:
        x = parameter.values[:: 3 if quick else 1]
        laws = [bs.evaluate(parameter.change(float(value))).peak_force for value in x]
        mean, sd = np.array([law.mean for law in laws]), np.array([law.sd for law in laws])
        curves.append((parameter, x, mean))
        relationship, direction = study["relationship"][parameter.name], study["direction"][parameter.name]
        fitted = {name: fit(x, mean) for name, fit in FITS.items()}
        fits = {name: r_squared(mean, values) for name, (values, _) in fitted.items()}
        rivals = {name: value for name, value in fits.items() if name != relationship}
        better = max(rivals, key=lambda name: rivals[name])
        enough = fits[relationship] >= R2_WANTED
        detail = f"R2 {fits[relationship]:.5f} for {fitted[relationship][1]}"
        if not enough:
            detail += f"; the better law: {better}, R2 {fits[better]:.5f} for {fitted[better][1]}"
        findings.check(
            f"Mean force against {parameter.label}: {relationship}, or the better law is named",
            enough or fits[better] >= R2_WANTED,
            detail,
        )
        steps = np.diff(mean)
        findings.check(
            f"More {parameter.name.replace('_', ' ')}: force goes {direction}",
            bool((steps > 0).all() if direction == "up" else (steps < 0).all()),
            f"{mean[0]:.2f} N at {x[0]:g} to {mean[-1]:.2f} N at {x[-1]:g}",
        )
        rows.append(
            [
                parameter.label,
                f"{relationship}, {direction}",
                *fits.values(),
                _slope(parameter),
                parameter.derivative(parameter.control),
                parameter.unit,
            ]
        )
        findings.figures[parameter.name] = {"values": x, "mean_N": mean, "sd_N": sd}
    findings.table(
        "R2 of four laws, and derivatives of the mean peak force at the control group",
        ["Parameter", "The source", *(f"R2 {name}" for name in FITS), "dF/dx, ours", "dF/dx, source", "Unit"],
        ["", "", *([".5f"] * len(FITS)), ".4g", ".4g", ""],
        rows,
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
            "Mean peak force of the exact law against each parameter of the study; the line is the source's law "
            "fitted to our means.",
            lambda figure: _draw(figure, curves, study["relationship"]),
            height=5.6,
        )
    )


def _slope(parameter: Parameter) -> float:
    """Derivative of the mean peak force at the control group, by a central difference over whole grid steps."""
    step = 0.001 if parameter.name == "feedback_period" else 0.1 * parameter.control
    low, high = (bs.evaluate(parameter.change(parameter.control + sign * step)).peak_force.mean for sign in (-1.0, 1.0))
    return (high - low) / (2 * step)


def _absolute(findings: Findings) -> None:
    """Forces the source states in newtons beside ours."""
    facts = load("dissertation")["simulator_validation"]
    plexiglas = bs.evaluate(
        _control(
            contact__stiffness_N_m=float(facts["plexiglas_stiffness_N_per_m"]),
            motion__velocity_mm_s=[0.0, 0.0, -float(facts["speed_mm_s"])],
        )
    ).peak_force
    control = bs.evaluate(_control()).peak_force
    findings.table(
        "Absolute forces, for the record",
        ["Case", "Ours, mean [N]", "Ours, sd [N]", "The source [N]"],
        ["", ".1f", ".1f", ".1f"],
        [
            # 128.8 a^-0.109 is the integral of the source's derivative in table 5.4, without a constant.
            ["control group (table 5.2)", control.mean, control.sd, 14.037 / 0.109 * 4.5**-0.109],
            ["Plexiglas, 50 mm/s (section 5.2)", plexiglas.mean, plexiglas.sd, float(facts["maximum_force_N"])],
        ],
    )


def _draw(figure: Figure, curves: list[tuple[Parameter, Floats, Floats]], relationship: dict[str, str]) -> None:
    figure.subplots_adjust(left=0.11, right=0.97, bottom=0.09, top=0.97, hspace=0.45, wspace=0.3)
    for i, (parameter, x, mean) in enumerate(curves, start=1):
        panel = figure.add_subplot(3, 2, i)
        panel.plot(x, FITS[relationship[parameter.name]](x, mean)[0], color=FAINT, linestyle="--")
        panel.plot(x, mean, "o", color=LAW, markersize=3.5)
        panel.set_xlabel(parameter.label)
        panel.set_ylabel("force [N]")
        panel.set_ylim(bottom=0)
