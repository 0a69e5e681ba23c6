"""Base parameters of a Staubli TX40 beside a published table, in one common basis."""

from __future__ import annotations

import csv
import re

import numpy as np

import bumpstop as bs
from bumpstop.identification import DynamicsFit, identify_dynamics
from bumpstop.identification.dynamics.regressor_columns import column_names
from bumpstop.recording import Recording
from identification.recorded import FILES, SHARED, TX40_COLUMNS
from validation.facts import MissingFacts
from validation.findings import Findings

TITLE = "Base parameters of a TX40 against a published table"
COUPLING = [[(4, 1.0), (5, 1.0)]]
# Names of the table that are not those of our columns.
_OTHERS = {"Ia": "rotor", "fv": "viscous", "fs": "coulomb", "off": "offset"}
_SHARED = {"Iam6": "rotor_shared_1", "fvm6": "viscous_shared_1", "fsm6": "coulomb_shared_1"}
# A published combination is one of ours when no more of it is left over than rounding of its printed factors.
_SAME = 0.02


def compare(findings: Findings, *, quick: bool) -> None:
    """Fit, express the published combinations by ours, and count those within three combined standard deviations."""
    if not (SHARED / FILES["tx40"]).exists():
        raise MissingFacts(f"{SHARED / FILES['tx40']} is absent: set BUMPSTOP_SHARED")
    robot = bs.Robot.from_urdf(SHARED / "staubli_tx40" / "tx40_mdh_modified.urdf")
    log = Recording.load(SHARED / FILES["tx40"], columns=TX40_COLUMNS, robot=robot)
    moving = log.between(float(log.t[0]), float(log.t[0]) + 7.5)
    fit = identify_dynamics(moving, robot, couplings=COUPLING, cutoff_hz=30.0 if quick else None)
    rows = beside(fit)
    near = [abs(z) <= 3 for *_, z in rows]
    far = ", ".join(name for name, near_enough in zip((row[0] for row in rows), near, strict=True) if not near_enough)
    findings.say(
        f"Cut-off {fit.model.cutoff_hz:g} Hz, {fit.rows_used} rows, {len(rows)} published combinations in our basis."
    )
    headings = ("parameter", "ours", "sd", "published", "sd", "difference, combined sd")
    findings.table("Base parameters", headings, ("", ".5g", ".2g", ".5g", ".2g", ".2f"), rows)
    share = float(np.mean(near))
    findings.check(
        "90 % lie within 3 combined standard deviations", share >= 0.9, f"{share:.3f}; outside: {far or 'none'}"
    )


def beside(fit: DynamicsFit) -> list[tuple[str, float, float, float, float, float]]:
    """Of every published combination that is one of ours: name, ours and sd, theirs and sd, difference in sds."""
    assert fit.covariance is not None
    names = column_names(fit.model.robot, fit.model.couplings, fit.model.top_speed, fit.model.loaded)
    base = np.zeros((len(fit.model.columns), len(names)))
    for row, name in enumerate(fit.names):
        base[row] = _combination(name, names)
    found = []
    with (SHARED / "staubli_tx40" / "TX40_bp_5.csv").open(encoding="utf-8") as file:
        for name, *_, value, percent in csv.reader(file):
            theirs = _combination(_renamed(name), names)
            mix = theirs[list(fit.model.columns)]
            if np.abs(theirs - mix @ base).max() > _SAME * np.abs(theirs).max():
                continue
            ours, own_sd = float(mix @ fit.model.values), float(np.sqrt(mix @ fit.covariance @ mix))
            their_sd = abs(float(value)) * float(percent) / 100
            found.append(
                (name, ours, own_sd, float(value), their_sd, (ours - float(value)) / np.hypot(own_sd, their_sd))
            )
    return found


def _combination(text: str, names: list[str]) -> np.ndarray:
    """Factors (columns,) of ``m_1 + 0.2 mx_2 - ...``."""
    factors = np.zeros(len(names))
    sign, factor = 1.0, 1.0
    for word in text.split():
        if word in "+-":
            sign = 1.0 if word == "+" else -1.0
        elif word[0].isdigit():
            factor = float(word)
        else:
            if word in names:  # what moves no joint of ours is no column either
                factors[names.index(word)] += sign * factor
            sign, factor = 1.0, 1.0
    return factors


def _renamed(text: str) -> str:
    def name(match: re.Match[str]) -> str:
        whole = match[0]
        return _SHARED.get(whole) or f"{_OTHERS.get(match[1], match[1])}_{match[2]}"

    return re.sub(r"([A-Za-z]+?)(\d+)\b", name, text.replace("*", " "))
