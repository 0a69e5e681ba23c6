"""``bumpstop view``: a scenario on a page in the browser."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bumpstop.cli.folders import check_folder, check_inputs
from bumpstop.errors import InputError

if TYPE_CHECKING:
    from bumpstop.detection.detection_run import DetectionRun
    from bumpstop.model import Robot
    from bumpstop.recording import Recording
    from bumpstop.view.opened import Watch

_PORT = 8642
_LOOK_S = 0.2


def command(
    source: Annotated[
        str | None,
        typer.Argument(
            metavar="[SOURCE]",
            help="Scenario, built-in robot, URDF, program, recording or study. Default: the robot of bumpstop new.",
            show_default=False,
        ),
    ] = None,
    robot: Annotated[str | None, typer.Option(help="Of a recording: a built-in robot, or a URDF.")] = None,
    base: Annotated[str | None, typer.Option(help="Link of the URDF where the chain begins.")] = None,
    tip: Annotated[str | None, typer.Option(help="Link of the URDF where the chain ends.")] = None,
    model: Annotated[
        str | None, typer.Option(help="Of a recording: joint model or fitted dynamics. Default: the robot's inertia.")
    ] = None,
    thresholds: Annotated[
        str | None, typer.Option(metavar="LIST|FILE", help="Thresholds [Nm], of a recording.")
    ] = None,
    columns: Annotated[Path | None, typer.Option(help="Of a recording: its column file (TOML).")] = None,
    topic: Annotated[str | None, typer.Option(help="Of a recording: topic of a bag that has several.")] = None,
    scenario: Annotated[Path | None, typer.Option(metavar="SCENARIO", help="Of a program: its cell (TOML).")] = None,
    record: Annotated[
        Path | None, typer.Option(help="Write view.png and view.gif into this folder and serve nothing.")
    ] = None,
    host: Annotated[str, typer.Option(help="Address to serve on; others than loopback let others in.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="Port to serve on, or one of the next; 0: any that is free.")] = _PORT,
    no_browser: Annotated[bool, typer.Option("--no-browser", help="Do not open the page in the browser.")] = False,
) -> None:
    """See the arm and its force distribution in the browser, computed anew while a control moves. Ctrl-C ends it."""
    from bumpstop.view.opened import open_source

    check_folder(record, "--record")
    read = [source, robot, model, thresholds, columns, scenario]
    check_inputs(record, read, "view.png", "view.gif", option="--record")
    opened = open_source(
        source,
        robot=robot,
        watch=_watch(model, thresholds),
        columns=columns,
        topic=topic,
        cell=scenario,
        base=base,
        tip=tip,
    )
    for note in opened.notes:
        typer.echo(f"note: {note}", err=True)
    if record is not None:
        from bumpstop.view.recorder import record as write

        try:
            for file in write(opened.scenario, record):
                typer.echo(str(file))
        finally:
            opened.discard()
        return
    from bumpstop.view.freed_memory import return_freed_memory
    from bumpstop.view.page.server import ViewServer, is_loopback

    return_freed_memory()
    try:
        server = ViewServer(opened, host=host, port=port)
    except BaseException:
        opened.discard()
        raise
    if not is_loopback(host):
        typer.echo(f"warning: {host} is not loopback: whoever reaches it can read and change these pages", err=True)
    try:
        typer.echo(f"the page: {server.url}")
        if not no_browser:
            import webbrowser

            webbrowser.open(server.url)
        # Polars has system calls go on after Ctrl-C: a wait without an end would never see it.
        ended = threading.Event()
        while not ended.wait(_LOOK_S):
            pass
    except KeyboardInterrupt:
        typer.echo("the page is closed")  # Ctrl-C is how it ends
    finally:
        server.stop()


def _watch(model: str | None, thresholds: str | None) -> Watch | None:
    """What runs a detector over a recording; None without thresholds."""
    if thresholds is None:
        if model is not None:
            raise InputError("--model", "has no meaning without --thresholds", "give both, or leave it out")
        return None

    def watch(recording: Recording, robot: Robot) -> DetectionRun:
        from bumpstop.cli.detection.residual_source import load_model, thresholds_of
        from bumpstop.detection import detect
        from bumpstop.identification import DynamicsModel
        from bumpstop.identification.arm_of_fit import check_arm_of_fit

        found = None if model is None else load_model(model, None, None, None)[0]
        if isinstance(found, DynamicsModel):
            check_arm_of_fit(found, robot, "--model")
        return detect(recording, robot, found, thresholds_of(thresholds, robot))

    return watch
