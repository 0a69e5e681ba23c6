"""Recordings of real arms with torques: their fits run in a loop, and see a collision that was planted."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.cli.main import main
from bumpstop.detection import Detector, DetectorSettings, Thresholds, detect
from bumpstop.identification import DynamicsFit, identify_dynamics
from bumpstop.identification.segments.motion import UniformMotion
from bumpstop.recording import Recording
from bumpstop.signal import causal_derivatives
from identification.recorded import FILES, SHARED, there

# When something pushes [s], how hard [N], and the window of the loop [s].
ARMS = {"ur10": (20.0, 120.0, 0.07), "panda": (20.0, 60.0, 0.2)}


@pytest.mark.parametrize("name", ARMS)
def test_a_push_on_a_real_arm_is_found(name: str) -> None:
    """Thresholds above all that the recording has; a push on the tip is found by either residual, and sized."""
    if not there(name):
        pytest.skip(f"{FILES[name]} is absent: set BUMPSTOP_SHARED")
    push_at, force_N, window = ARMS[name]
    robot, log = bs.Robot.load(name), replace(Recording.load(SHARED / FILES[name]), joint_names=())
    model = identify_dynamics(log, robot, cutoff_hz=2.0).model
    assert log.tau is not None
    push_at += float(log.t[0])
    tau = log.tau.copy()
    for row in np.flatnonzero((log.t >= push_at) & (log.t < push_at + 0.5)):
        tau[row] += robot.jacobian(log.q[row])[:3].T @ np.array([0.0, 0.0, -force_N])
    for residual in ("direct", "observer"):
        settings = DetectorSettings(
            residual=residual, observer_gain_1_s=20.0, window_s=window, causal=True, frozen_s=np.inf  # type: ignore[arg-type]
        )  # fmt: skip
        free = detect(log, robot, model, np.full(robot.dof, 1e6), settings)
        limits = Thresholds(1.2 * np.nanmax(np.abs(free.residual), axis=0))
        run = detect(replace(log, tau=tau), robot, model, limits, settings)
        event = run.events[0]
        assert push_at <= event.t < push_at + 0.25
        # Two or three samples behind the push an observer shows a part of it.
        assert (0.3 if residual == "direct" else 0.1) * force_N < event.force_along < 1.5 * force_N
        if residual == "direct":
            # Another route: the fit's own torques at the derivatives of the signal room.
            samples = settings.window_samples(float(np.median(np.diff(log.t))))
            qd, qdd = causal_derivatives(log.t, log.q, window=samples)
            # Friction builds up from where the loop begins to see.
            seen = slice(int(np.argmax(~free.no_data)), None)
            assert not free.no_data[seen].any()
            motion = UniformMotion(log.t[seen], log.q[seen], qd[seen], qdd[seen], log.rate_hz, model.gravity)
            wanted = log.tau[seen] - model.torque(motion)
            np.testing.assert_allclose(free.residual[seen], wanted, atol=1e-9 * np.abs(log.tau).max())


def test_from_a_bag_to_a_detector_of_a_loop(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Tuned by the commands with what a loop has; looking ahead is warned of, and refused by nobody."""
    if not there("ur10"):
        pytest.skip(f"{FILES['ur10']} is absent: set BUMPSTOP_SHARED")
    bag, robot = SHARED / FILES["ur10"], bs.Robot.load("ur10")
    log = Recording.load(bag).between(0.0, 14.0)
    identify_dynamics(log, robot, cutoff_hz=2.0).save(tmp_path / "arm.toml")
    assert DynamicsFit.load(tmp_path / "arm.toml").model.gains is None

    def run(*words: str) -> str:
        with pytest.raises(SystemExit) as ended:
            main([str(word) for word in words])
        assert ended.value.code == 0, capsys.readouterr()
        return "".join(capsys.readouterr())

    of = ["--model", str(tmp_path / "arm.toml")]
    limits, made = tmp_path / "limits.toml", tmp_path / "arm.detector"
    Thresholds(np.full(6, 20.0), period_s=log.dt, causal=False).save(limits)
    assert "causal = true (tuned with false)" in run("detector", str(made), *of, "--thresholds", str(limits))
    run("tune", str(bag), *of, "--causal", "--until", "10", "--per-hour", "30", "--save", str(limits))
    assert Thresholds.load(limits).causal is True
    # Without settings they are those of the thresholds, as of the command.
    model = DynamicsFit.load(tmp_path / "arm.toml").model
    told = json.loads(run("detect", str(bag), *of, "--thresholds", str(limits), "--json"))
    found = detect(Recording.load(bag), robot, model, Thresholds.load(limits))
    assert [event.t for event in found.events] == [event["t"] for event in told["events"]]
    assert dict(found.settings) == told["settings"]
    assert "tuned with" not in run("detector", str(made), *of, "--thresholds", str(limits))
    assert "fitted_link all" in made.read_text()
    settings = DetectorSettings(causal=True, period_s=log.dt)
    wanted = Detector(robot, DynamicsFit.load(tmp_path / "arm.toml").model, np.full(6, 1e6), settings).run(log)
    from bumpstop.live.loaded_detector import LoadedDetector

    assert log.tau is not None
    residual = LoadedDetector.load(made).kernel().run(log.t, log.q, log.tau, None, 0.5)[0]
    np.testing.assert_array_equal(residual, wanted.residual)
