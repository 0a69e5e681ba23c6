"""The parameter study: planted laws, the source's relationships, derivatives, equal risk and the guide."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import polars as pl
import pytest

import bumpstop as bs
from bumpstop.study import run
from bumpstop.study.equal_risk import allowed_force
from bumpstop.study.fits import R2_WANTED, fit_laws
from bumpstop.study.parameters import SOURCE, ParameterStudy, _difference
from bumpstop.study.variable import Variable
from collision.cases import control_group, ur10e

# Of the control group over the lowest [1].
NOISE = [2.0, 1.0, 2.0, 2.0, 2.0, 2.0, 2.0]


@pytest.mark.parametrize(
    ("name", "parameters"),
    [
        ("linear", (3.0, -0.2)),
        ("quadratic", (17.0, 0.07, 0.0013)),
        ("power", (0.4, 1.3)),
        ("power", (44.0, 0.105)),
        ("constant plus power", (20.6, 17.0, -0.998)),
        ("constant plus power", (2.0, 0.3, 2.5)),
        ("constant plus power", (82.0, -3e-17, 12.5)),
        ("power", (3e10, -7.5)),
    ],
)
def test_a_planted_law_is_found_again(name: str, parameters: tuple[float, ...]) -> None:
    x = np.linspace(2.0, 30.0, 15)
    a, b, c = (*parameters, 0.0)[:3]
    y = {
        "linear": a + b * x,
        "quadratic": a + b * x + c * x**2,
        "power": a * x**b,
        "constant plus power": a + b * x**c,
    }[name]
    fit = next(fit for fit in fit_laws(x, y) if fit.name == name)
    assert fit.parameters == pytest.approx(parameters, rel=1e-5)
    assert fit.r2 == pytest.approx(1.0, abs=1e-9)
    assert fit.fitted == pytest.approx(y, rel=1e-6)


def test_no_other_exponent_fits_better() -> None:
    # Flat, and then it falls: the force against the noise, of which a fit with an exponent up to 4 explains 0.8.
    x = np.linspace(0.2, 3.0, 12)
    y = np.array([_mean(control_group(), detector__noise_sd_Nm=[v * s for s in NOISE]) for v in x])
    fits = {fit.name: fit for fit in fit_laws(x, y)}
    best = {"power": 0.0, "constant plus power": 0.0}
    for exponent in (*np.linspace(-30, 30, 600), *np.linspace(-0.2, 0.2, 400)):
        z = (x / x[-1]) ** exponent
        for name, columns in (("power", [z]), ("constant plus power", [np.ones_like(x), z])):
            matrix = np.column_stack(columns) / np.abs(z).max()
            fitted = matrix @ np.linalg.lstsq(matrix, y, rcond=None)[0]
            best[name] = max(best[name], 1 - np.sum((y - fitted) ** 2) / np.sum((y - y.mean()) ** 2))
    assert best["constant plus power"] > 0.99
    for name, r2 in best.items():
        assert r2 - 1e-9 <= fits[name].r2 <= r2 + 1e-3
        A, B, C = (*fits[name].parameters, 0.0)[:3]
        again = A * x**B if name == "power" else A + B * x**C
        assert fits[name].fitted == pytest.approx(again, rel=1e-9)


def test_too_few_points_and_negative_values_get_only_the_laws_they_allow() -> None:
    assert [fit.name for fit in fit_laws(np.array([1.0, 2.0, 3.0]), np.array([1.0, 2.0, 2.5]))] == ["linear", "power"]
    names = [fit.name for fit in fit_laws(np.linspace(-2, 2, 9), np.linspace(1, 3, 9) ** 2)]
    assert names == ["linear", "quadratic"]


@pytest.fixture(scope="module")
def control() -> tuple[bs.Scenario, pl.DataFrame, dict[str, Any]]:
    """The source's five parameters about its control group (table 5.2)."""
    scenario = control_group(contact__stiffness_N_m=5600.0)
    rows, summary = run(ParameterStudy.of(scenario), threads=2)
    return scenario, rows, summary


def test_the_relationships_of_table_5_3(control: Any) -> None:
    _, _, summary = control
    directions = {each["key"]: each["direction"] for each in summary["parameters"]}
    assert set(directions) == set(SOURCE)
    assert directions.pop("reaction.joint_acceleration_rad_s2") == "down"
    assert set(directions.values()) == {"up"}
    for each in summary["parameters"]:
        r2 = {fit["name"]: fit["r2"] for fit in each["fits"]}
        assert each["source_law"] == SOURCE[each["key"]][0]
        if each["key"] == "reaction.joint_acceleration_rad_s2":
            # Force at detection plus a part that falls with one over the acceleration.
            assert each["better_law"] == "constant plus power"
            assert r2["power"] < R2_WANTED < r2["constant plus power"]
        else:
            assert r2[each["source_law"]] >= R2_WANTED
            assert each["better_law"] is None


def test_rows_are_the_laws_of_their_scenarios(control: Any) -> None:
    scenario, rows, _ = control
    sweep = rows.filter((rows["kind"] == "sweep") & (rows["key"] == "motion.speed"))
    assert sweep.height == 20
    for row in sweep[::7].iter_rows(named=True):
        law = bs.evaluate(scenario.with_values({"motion.velocity_mm_s": [0, 0, -row["value"]]}))
        assert row["mean_N"] == law.peak_force.mean
        assert row["p999_N"] == law.peak_force.quantile(0.999)
        assert row["p_over_force"] == law.verdict.p_over_force


def test_derivatives_agree_with_differences_of_another_width(control: Any) -> None:
    scenario, _, summary = control

    def mean(**changes: Any) -> float:
        return bs.evaluate(
            scenario.with_values({key.replace("__", "."): v for key, v in changes.items()})
        ).peak_force.mean

    wanted = {
        "contact.stiffness": (mean(contact__stiffness_N_m=5630.0) - mean(contact__stiffness_N_m=5570.0)) / 60,
        "motion.speed": (mean(motion__velocity_mm_s=[0, 0, -50.3]) - mean(motion__velocity_mm_s=[0, 0, -49.7])) / 0.6,
        # A quantised key: across one whole step on either side.
        "detector.feedback_period_s": (
            mean(detector__feedback_period_s=0.005) - mean(detector__feedback_period_s=0.003)
        )
        / 0.002,
    }
    found = {each["key"]: each["derivative"] for each in summary["parameters"]}
    for key, slope in wanted.items():
        # Both differences are second order; a width of a per cent leaves far less than a hundredth.
        assert found[key]["mean"] == pytest.approx(slope, rel=5e-3)
    assert found["detector.feedback_period_s"]["mean"] == pytest.approx(wanted["detector.feedback_period_s"], rel=1e-9)
    assert found["detector.feedback_period_s"]["quantised"]


def _mean(scenario: bs.Scenario, **changes: Any) -> float:
    return bs.evaluate(scenario.with_values({key.replace("__", "."): v for key, v in changes.items()})).peak_force.mean


def _derivative(scenario: bs.Scenario, vary: str) -> dict[str, Any]:
    (found,) = run(ParameterStudy.of(scenario, vary=[vary]))[1]["parameters"]
    return {**found["derivative"], "control": found["control"]}


def test_at_the_end_of_what_a_key_takes_the_slope_is_no_secant() -> None:
    # Damping enters by its square, so that at 0 nothing depends on it; a secant says -0.3 N.
    damping = _derivative(control_group(), "motion.damping=0:0.02:3")
    assert abs(damping["mean"]) < 1e-3
    assert damping["error"] > 10 * abs(damping["mean"])
    # A body that touches, within the way to the first tick: the same slope as from closer by.
    touching = control_group(contact__offset_law="fixed", contact__offset_mm=0.0)
    found = _derivative(touching, "contact.offset_mm=0:0.2:3")
    near, nearer = ((_mean(touching, contact__offset_mm=h) - _mean(touching)) / h for h in (2e-3, 1e-3))
    assert found["mean"] == pytest.approx(2 * nearer - near, rel=2e-3)


def test_a_slope_with_one_point_missing_is_that_of_the_others() -> None:
    h = np.array([-0.5, 0.0, 0.5, 1.0])
    slope, error = _difference(h, 2.0 + 3.0 * h - 0.7 * h**2 + 0.4 * h**3)
    assert slope == pytest.approx(3.0, rel=1e-12)
    # Without the cubic the three nearest points are off by 0.4 h^2.
    assert error == pytest.approx(0.4 * 0.5**2, rel=1e-9)


def test_a_latency_between_steps_is_that_of_the_law() -> None:
    # 6.2 ms are rounded up to 7 ms, which is where the slope, and its share of the force, are wanted.
    scenario = control_group(reaction__latency_s=0.0062)
    found = _derivative(scenario, "reaction.latency_s=0:0.01:3")
    slope = (_mean(scenario, reaction__latency_s=0.008) - _mean(scenario, reaction__latency_s=0.006)) / 0.002
    assert found["control"] == 0.007
    assert found["mean"] == pytest.approx(slope, rel=1e-9)
    assert found["elasticity"] == pytest.approx(slope * 0.007 / _mean(scenario), rel=1e-9)


# Four keys of two arms that reverse or stop, obliquely, by other offset laws.
SLOPES = [
    (
        control_group(motion__velocity_mm_s=[20.0, -15.0, -45.0], reaction__kind="stop", reaction__latency_s=0.012),
        ["detector.thresholds_Nm[2]=5:15", "detector.noise_sd_Nm=0.5:3", "reaction.latency_s=0.002:0.02"],
    ),
    (
        control_group(contact__offset_law="uniform", motion__damping=0.02, motion__velocity_mm_s=[0.0, 30.0, -30.0]),
        ["detector.thresholds=5:15", "motion.damping=0.01:0.1"],
    ),
    (
        control_group(detector__noise_correlation=0.6, detector__residual="observer"),
        ["detector.observer_gain_1_s=20:100", "detector.noise_correlation=0.2:0.8", "contact.offset_sd_s=0.05:0.2"],
    ),
]


@pytest.mark.parametrize(("scenario", "keys"), SLOPES)
def test_slopes_are_those_of_laws_much_closer_together(scenario: bs.Scenario, keys: list[str]) -> None:
    study = ParameterStudy.of(scenario, vary=[f"{key}:2" for key in keys])
    for each in run(study)[1]["parameters"]:
        name, here = each["key"], each["control"]
        step = 0.001 if each["derivative"]["quantised"] else 1e-3 * here
        item = name.partition("[")[2]

        def mean(value: float, name: str = name, here: float = here, item: str = item) -> float:
            key = {"detector.thresholds": "detector.thresholds_Nm"}.get(name, name.partition("[")[0])
            own: Any = scenario.to_dict()[key.partition(".")[0]][key.partition(".")[2]]
            if item:
                own[int(item[:-1]) - 1] = value
            else:
                own = [x * value / here for x in own] if isinstance(own, list) else value
            return bs.evaluate(scenario.with_values({key: own})).peak_force.mean

        slope = (mean(here + step) - mean(here - step)) / (2 * step)
        assert each["derivative"]["mean"] == pytest.approx(slope, rel=5e-3), name


PAIR = ("motion.speed=20:80:5", "reaction.joint_acceleration_rad_s2=3:18:5")


@pytest.fixture(scope="module")
def priced() -> tuple[bs.Scenario, dict[str, Any]]:
    """A collision over its limit, with prices for slower and for stopping harder."""
    scenario = control_group(motion__velocity_mm_s=[0.0, 0.0, -80.0], contact__area_cm2=2.0)
    study = ParameterStudy.of(
        scenario,
        vary=[*PAIR, "detector.feedback_period_s=0.003:0.004"],
        pairs=["motion.speed,reaction.joint_acceleration_rad_s2"],
        prices=["motion.speed=1", "reaction.joint_acceleration_rad_s2=4", "detector.feedback_period_s=3000"],
    )
    return scenario, run(study, threads=2)[1]


def _check_curves(scenario: bs.Scenario, pair: dict[str, Any]) -> int:
    """Laws of points of all curves have their risk, and nowhere more; the number of points."""
    seen = 0
    for curve in pair["curves"]:
        for line in curve["lines"]:
            for values in line[:: max(1, len(line) // 6)]:
                there = scenario
                for key, value in zip(pair["keys"], values, strict=True):
                    variable = Variable(key)
                    assert value == variable.quantised(scenario, value)
                    there = variable.apply(there, value)
                law = bs.evaluate(there)
                allowed = allowed_force(law.problem)
                assert (1 - 2e-4) * allowed <= law.peak_force.quantile(1 - curve["risk"]) <= (1 + 1e-9) * allowed
                over = max(law.verdict.p_over_force or 0.0, law.verdict.p_over_pressure or 0.0)
                assert 0.97 * curve["risk"] <= over <= (1 + 1e-6) * curve["risk"]
                seen += 1
    return seen


def test_along_a_curve_of_equal_risk_the_risk_is_equal(priced: Any) -> None:
    scenario, summary = priced
    (pair,) = summary["equal_risk"]
    assert len(pair["curves"]) == 4
    assert _check_curves(scenario, pair) >= 20


@pytest.mark.parametrize(
    ("scenario", "ranges"),
    [
        # Three rows a side, of which straight lines are off by a tenth of the force, and whole steps.
        (
            ur10e(reaction__kind="stop", reaction__latency_s=0.006, motion__velocity_mm_s=[80.0, 40.0, -80.0]),
            ("detector.feedback_period_s=0.001:0.009:3", "contact.area_cm2=0.5:4:3"),
        ),
        # Some of the rows have a force without bound.
        (
            control_group(contact__area_cm2=2.0, motion__velocity_mm_s=[15.0, -10.0, -40.0]),
            ("motion.speed=20:80:7", "detector.thresholds=5:600:7:log"),
        ),
    ],
)
def test_curves_of_equal_risk_are_no_coarser_than_laws(scenario: bs.Scenario, ranges: tuple[str, str]) -> None:
    keys = [text.partition("=")[0] for text in ranges]
    study = ParameterStudy.of(scenario, vary=list(ranges), pairs=[",".join(keys)])
    (pair,) = run(study)[1]["equal_risk"]
    assert pair["keys"] == keys
    assert _check_curves(scenario, pair) >= 8


def test_the_guide_meets_the_limits_at_the_least_cost_of_a_grid(priced: Any) -> None:
    scenario, summary = priced
    guide = summary["guide"]
    plan = guide["together"]
    assert not guide["now"]["meets"]
    assert plan["meets"]
    assert plan["cost"] <= min(alone["cost"] for alone in guide["alone"].values() if alone) + 1e-9

    def acceptable(speed: float, acceleration: float, period: float) -> bool:
        changes = {
            "motion.velocity_mm_s": [0.0, 0.0, -speed],
            "reaction.joint_acceleration_rad_s2": acceleration,
            "detector.feedback_period_s": period,
        }
        return bool(bs.evaluate(scenario.with_values(changes)).verdict.acceptable)

    best = plan["values"]
    at = best["motion.speed"], best["reaction.joint_acceleration_rad_s2"], best["detector.feedback_period_s"]
    assert acceptable(*at)
    for speed, acceleration, period in itertools.product(
        np.linspace(50, 80, 4), np.linspace(4.5, 12, 4), (0.003, 0.004)
    ):
        cost = (80 - speed) + 4 * (acceleration - 4.5) + 3000 * (0.004 - period)
        if cost < 0.99 * plan["cost"]:
            assert not acceptable(speed, acceleration, period), "a cheaper plan was overlooked"


# A threshold is to be low for the force and high for false alarms: at either end of these ranges one of the two is
# missed. And far too high a threshold hides that a lower speed would help.
TWO_SIDED = {
    "too high": (
        {"motion__velocity_mm_s": [0.0, 0.0, -60.0], "contact__area_cm2": 2.0},
        {"detector.thresholds": (4.0, 10.0)},
    ),
    "too low": (
        {"detector__thresholds_Nm": [12.0, 6.0, 12.0, 12.0, 12.0, 12.0, 12.0], "contact__area_cm2": 2.0},
        {"detector.thresholds": (4.0, 30.0)},
    ),
    "deaf": (
        {
            "motion__velocity_mm_s": [0.0, 0.0, -100.0],
            "detector__thresholds_Nm": [2000.0] * 7,
            "contact__area_cm2": 2.0,
        },
        {"motion.speed": (20.0, 100.0), "detector.thresholds": (8.0, 2000.0)},
    ),
}


@pytest.mark.parametrize("name", TWO_SIDED)
def test_the_guide_finds_what_meets_limits_and_false_alarms_at_once(name: str) -> None:
    changes, ends = TWO_SIDED[name]
    scenario = control_group(**changes)
    study = ParameterStudy.of(
        scenario,
        vary=[f"{key}={low}:{high}:2" for key, (low, high) in ends.items()],
        prices=[f"{key}=1" for key in ends],
    )
    guide = run(study)[1]["guide"]
    assert guide["together"] is not None, guide["reason"]
    start, best = guide["now"]["values"], guide["together"]["values"]

    def acceptable(values: dict[str, float]) -> bool:
        here = scenario
        for key, value in values.items():
            here = Variable(key).apply(here, value)
        return bool(bs.evaluate(here).verdict.acceptable)

    assert acceptable(best)
    # All values somewhat nearer to the present ones, in steps of a twentieth of what is changed or of the best value.
    nearer = [
        best[key] + (start[key] - best[key]) * np.linspace(0, min(1, best[key] / abs(start[key] - best[key])), 21)
        for key in ends
    ]
    for values in itertools.product(*nearer):
        cost = sum(abs(value - start[key]) for key, value in zip(ends, values, strict=True))
        if cost < guide["together"]["cost"] * (1 - 1e-4):
            assert not acceptable(dict(zip(ends, values, strict=True))), "a cheaper plan was overlooked"


def test_a_value_that_has_no_law_is_named() -> None:
    study = ParameterStudy.of(control_group(), vary=["pose_deg[2]=-100:100:3"])
    with pytest.raises(bs.InputError, match=r"^pose_deg: with pose_deg\[2\] = 0: is singular"):
        run(study)


def test_a_key_that_changes_nothing_has_no_law() -> None:
    study = ParameterStudy.of(control_group(), vary=["verdict.risk=0.1:0.9:4"])
    (found,) = run(study)[1]["parameters"]
    assert found["fits"] == []
    assert found["direction"] == "neither"
    assert found["derivative"]["mean"] == 0


def test_a_guide_that_finds_nothing_says_why() -> None:
    scenario = control_group(motion__velocity_mm_s=[0.0, 0.0, -100.0])
    study = ParameterStudy.of(scenario, vary=["motion.speed=90:100:2"], prices=["motion.speed=1"])
    guide = run(study)[1]["guide"]
    assert guide["together"] is None
    assert guide["alone"] == {"motion.speed": None}
    assert "Nothing in these ranges is enough" in guide["reason"]


@pytest.mark.parametrize(
    ("vary", "more", "problem"),
    [
        (["motion.speed=10:20", "motion.speed=20:30"], {}, "names 'motion.speed' twice"),
        (["contact.padding=1e3:1e4"], {}, "'contact.padding' has no value in the scenario"),
        (["motion.speed=10:20"], {"pairs": ["motion.speed"]}, "KEY,KEY"),
        (
            ["motion.speed=10:20", "contact.area_cm2=1:2"],
            {"pairs": ["motion.speed,contact.area_cm2", "motion.speed, contact.area_cm2"]},
            "twice",
        ),
        (["motion.speed=10:20"], {"pairs": ["motion.speed,contact.area_cm2"]}, "is not varied"),
        (["motion.speed=10:20"], {"prices": ["motion.speed=-1"]}, "is no price"),
        (["motion.speed=10:20"], {"prices": ["motion.speed"]}, "is no price"),
        (["motion.speed=10:20"], {"prices": ["contact.area_cm2=1"]}, "is not varied"),
    ],
)
def test_bad_pairs_and_prices_are_refused(vary: list[str], more: dict[str, Any], problem: str) -> None:
    with pytest.raises(bs.InputError, match=problem):
        ParameterStudy.of(control_group(), vary=vary, **more)


def test_without_limits_there_is_nothing_to_guide_to() -> None:
    data = control_group(contact__stiffness_N_m=5600.0).to_dict()
    del data["contact"]["body"]
    scenario = bs.Scenario.from_dict(data)
    with pytest.raises(bs.InputError, match=r"contact\.body"):
        ParameterStudy.of(scenario, vary=["motion.speed=10:20"], prices=["motion.speed=1"])
    rows, _ = run(ParameterStudy.of(scenario, vary=["motion.speed=10:20:3"]))
    assert rows["p_over_force"].null_count() == rows.height


def test_what_is_wrong_without_any_change_is_told_before_any_work() -> None:
    scenario = control_group()
    wrong = scenario.model_copy(update={"contact": scenario.contact.model_copy(update={"body": "hand_back"})})
    with pytest.raises(bs.InputError) as refused:
        ParameterStudy.of(wrong, vary=["reaction.latency_s=0:0.02:3"])
    assert "with " not in refused.value.problem
