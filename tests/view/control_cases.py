"""What a test may do with every control of the explorer."""

from __future__ import annotations

from bumpstop.view.controls import Control, Shown
from view.cases import HAND


def needed(control: Control) -> dict[str, object]:
    """Keys without which a control has no meaning."""
    free = {"contact.kind": "free", "contact.body_mass_kg": 2.0}
    if control.key.startswith("arm.") and control.key != "arm.model":
        return {"arm.model": "elastic"}
    return {
        "contact.kind": free,
        "contact.arm": free,
        "contact.limits": {"contact.body": None, "contact.stiffness_N_m": 75000.0},
        "reaction.deceleration": {"reaction.deceleration": "ramp", "reaction.ramp_time_s": 0.05},
        "reaction.stop_category": {"reaction.kind": "stop"},
        "uncertainty.contact.body_mass_kg": free,
    }.get(control.key, {})


def other_value(control: Control) -> Shown:
    """Something else that a control may show."""
    now = control.read(HAND)
    if control.kind == "vector":
        return (0.0, 0.6, -0.8)
    if control.kind == "number":
        assert isinstance(now, float)
        return 1.25 * now or 0.0125
    if control.kind == "slider":
        assert isinstance(now, float)
        return now + 2 * control.step if now + 2 * control.step <= control.high else now - 2 * control.step
    if control.key in ("contact.kind", "reaction.deceleration"):
        return str(now)  # `needed` has changed it
    if control.key == "contact.link":
        return control.choices[-1]
    if control.kind == "choice":
        return next((name for name in control.choices[1:] if name not in (now, "fixed")), str(now))
    if control.panel == "Uncertainty":
        return "0.002 to 0.006" if control.key.endswith("latency_s") else "5 %"
    texts = {
        "verdict.confidence": "0.9",
        "motion.held_joints": "1",
        "contact.normal": "0, 0, -1",
        "detector.thresholds_Nm": "21, 11, 21, 21, 21, 21, 21",
        "reaction.stop_category": "1",
        "contact.stiffness_N_m": "30000",
        "contact.padding_N_m": "30000",
        "arm.gear_stiffness_Nm_rad": "9000",
    }
    return texts.get(
        control.key, "0.0005" if control.panel == "Verdict" else "1.5" if control.panel != "Arm" else "0.5"
    )
