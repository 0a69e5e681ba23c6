"""``bumpstop monitor``: a detector on the running arm."""

from __future__ import annotations

import gc
import json
import math
import signal
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bumpstop.cli.folders import check_inputs
from bumpstop.cli.identification.arm_recordings import recording_files
from bumpstop.cli.option_names import as_options
from bumpstop.errors import InputError

if TYPE_CHECKING:
    from bumpstop.live.loaded_detector import LoadedDetector
    from bumpstop.live.monitor import Monitor
    from bumpstop.live.output import Output

# A thread that writes or draws gives way to the next sample after so long [s].
_SWITCH_S = 0.0005
_ROTATE_S, _COMMAND_TIMEOUT_S = 600.0, 5.0


def monitor(
    source: Annotated[
        str,
        typer.Argument(
            help="A recording's file, plant:EXPERIMENT.toml, rtde://HOST[:PORT] or dds://TOPIC.", show_default=False
        ),
    ],
    detector: Annotated[
        Path, typer.Option("--detector", help="File that 'bumpstop detector' wrote.", show_default=False)
    ],
    speed: Annotated[
        str | None,
        typer.Option(help="Seconds of a recording or of the plant in a second, or max.", show_default="real time"),
    ] = None,
    columns: Annotated[Path | None, typer.Option(help="Column file of a recording (TOML).")] = None,
    topic: Annotated[str | None, typer.Option(help="Topic of a bag that has several with joint states.")] = None,
    duration_s: Annotated[float | None, typer.Option("--duration-s", help="End after so long [s].")] = None,
    stop_after_s: Annotated[
        float | None,
        typer.Option(
            "--stop-after-s",
            help="Without a sample for longer the source has stopped [s].",
            show_default="ten periods at --speed, at least 0.1, and 1 s before the first",
        ),
    ] = None,
    rearm_s: Annotated[
        float,
        typer.Option(
            "--rearm-s", help="An alarm ends once everything was below its thresholds so long [s]; inf: never."
        ),
    ] = 0.5,
    jsonl: Annotated[Path | None, typer.Option(help="Append states, alarms and events as JSON lines.")] = None,
    mcap: Annotated[Path | None, typer.Option(help="Record into NAME_0001.mcap, NAME_0002.mcap, ...")] = None,
    rotate_s: Annotated[
        float | None,
        typer.Option("--rotate-s", help="Begin another MCAP file after so long [s].", show_default=f"{_ROTATE_S}"),
    ] = None,
    answer: Annotated[
        str | None, typer.Option(help="Tell the robot at every alarm, where its samples come from: stop or reverse.")
    ] = None,
    publish: Annotated[
        str | None,
        typer.Option(help="Publish residual, state, alarm and wrench on topics of ROS 2 below this one: /bumpstop."),
    ] = None,
    on_collision: Annotated[
        str | None, typer.Option("--on-collision", metavar="COMMAND", help="Start this at every alarm.")
    ] = None,
    command_timeout_s: Annotated[
        float | None,
        typer.Option(
            "--command-timeout-s", help="Kill that command after so long [s].", show_default=f"{_COMMAND_TIMEOUT_S}"
        ),
    ] = None,
    shell: Annotated[bool, typer.Option("--shell", help="Let /bin/sh read that command.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object at the end and nothing else.")] = False,
) -> int:
    """Watch a running arm: residuals against thresholds, alarms with joint, force and direction."""
    from bumpstop.live.loaded_detector import LoadedDetector
    from bumpstop.live.monitor import Monitor, MonitorSettings
    from bumpstop.live.sources.names import SourceOptions, source_of
    from bumpstop.live.unbuffered_text import standard_output
    from bumpstop.live.view import MonitorView
    from bumpstop.terminal import terminal

    pace = _speed(speed)
    settings = MonitorSettings(
        duration_s=math.inf if duration_s is None else _above_zero(duration_s, "--duration-s"),
        stop_after_s=None if stop_after_s is None else _above_zero(stop_after_s, "--stop-after-s"),
        rearm_s=_above_zero(rearm_s, "--rearm-s", finite=False),
        speed=1.0 if pace is None else pace,
    )
    for option, useless, needed in (
        ("--shell", shell and on_collision is None, "--on-collision"),
        ("--command-timeout-s", command_timeout_s is not None and on_collision is None, "--on-collision"),
        ("--rotate-s", rotate_s is not None and mcap is None, "--mcap"),
    ):
        if useless:
            raise InputError(option, f"has no meaning without {needed}", "leave it out")
    read = [*recording_files([Path(source.removeprefix("plant:"))], columns), detector]
    check_inputs(jsonl, read, option="--jsonl")
    made = LoadedDetector.load(detector)
    asked = SourceOptions(
        speed=pace, columns=columns, topic=topic, answers=answer is not None, stop_after_s=settings.stop_after_s
    )
    stream = source_of(source, made, asked)
    for note in stream.notes:
        typer.echo(f"note: {note}", err=True)
    view = None if as_json else MonitorView(made, terminal(standard_output()), source)
    with ExitStack() as last, ExitStack() as stack:
        outputs: list[Output] = []
        if answer is not None:
            from bumpstop.live.answer import AnswerOutput

            outputs.append(AnswerOutput(stream, answer))
        if on_collision is not None:
            from bumpstop.live.outputs.command import CollisionCommand

            limit_s = _COMMAND_TIMEOUT_S if command_timeout_s is None else command_timeout_s
            outputs.append(CollisionCommand(on_collision, made, timeout_s=limit_s, shell=shell))
        if publish is not None:
            from bumpstop.live.dds.output import DdsOutput

            with as_options({"topic": "--publish"}):
                outputs.append(DdsOutput(made.joints, prefix=publish))
        outputs += _files(jsonl, mcap, _ROTATE_S if rotate_s is None else rotate_s, made)
        for output in outputs:
            stack.callback(output.close)
        watching = Monitor(made, stream, [*outputs, view] if view is not None else outputs, settings)
        # Before samples come: what begins takes a tenth of a second.
        stack.enter_context(_ending(watching))
        stack.enter_context(stream)
        if view is not None:
            last.enter_context(view)
        watching.run(None if view is None else view.every)
        stack.close()
        for output in outputs:
            watching.problems += output.problems()
        summary = watching.summary()
        if view is not None:
            view.conclude(summary.lines())
            view.problems()
    if as_json:
        more = {"source": source, "detector": str(detector), "signal": made.signal, "joints": list(made.joints)}
        typer.echo(json.dumps(more | summary.to_json(), allow_nan=False, indent=2))
    return summary.status


def _files(jsonl: Path | None, mcap: Path | None, rotate_s: float, detector: LoadedDetector) -> list[Output]:
    from bumpstop.live.outputs.json_lines import JsonLines

    found: list[Output] = []
    if jsonl is not None:
        found.append(JsonLines(jsonl, detector))
    if mcap is not None:
        from bumpstop.live.outputs.mcap_recording import McapRecording

        recording = McapRecording(mcap, detector, rotate_s=rotate_s)
        for name in recording.mended:
            typer.echo(f"note: {name} was left unfinished by a monitor that was killed; it is complete now", err=True)
        found.append(recording)
    return found


@contextmanager
def _ending(monitor: Monitor) -> Iterator[None]:
    """While it runs, SIGTERM, SIGINT and SIGHUP end it at its next sample, and threads give way to samples soon."""
    before = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGINT)}
    # Whoever starts it with nohup wants it to outlast the terminal.
    if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
        before[signal.SIGHUP] = signal.getsignal(signal.SIGHUP)
    switch = sys.getswitchinterval()
    try:
        for number in before:
            signal.signal(number, lambda *_: monitor.stop())
        sys.setswitchinterval(_SWITCH_S)
        gc.collect()
        # What there is now stays: looking through it for garbage would hold up samples.
        gc.freeze()
        yield
    finally:
        gc.unfreeze()
        sys.setswitchinterval(switch)
        for number, handler in before.items():
            signal.signal(number, handler)


def _speed(text: str | None) -> float | None:
    if text is None or text == "max":
        return None if text is None else math.inf
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0 < value < math.inf:
        raise InputError("--speed", f"is {text!r}", "wanted a number above zero, or max")
    return value


def _above_zero(value: float, option: str, *, finite: bool = True) -> float:
    if not value > 0 or (finite and math.isinf(value)):
        raise InputError(option, f"is {value:g}", "wanted more than zero")
    return value
