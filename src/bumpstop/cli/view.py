"""``bumpstop view``: a scenario on a page in the browser."""

from __future__ import annotations

import threading
from typing import Annotated

import typer

_PORT = 8642


def command(
    source: Annotated[
        str | None,
        typer.Argument(
            metavar="[SOURCE]",
            help="Scenario (TOML), built-in robot or URDF. Default: the robot that bumpstop new starts with.",
            show_default=False,
        ),
    ] = None,
    host: Annotated[str, typer.Option(help="Address to serve on; others than loopback let others in.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="Port to serve on; 0: any that is free.")] = _PORT,
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the page in the browser.")] = True,
) -> None:
    """See the arm and its force distribution in the browser, computed anew while a control moves. Ctrl-C ends it."""
    from bumpstop.view.opened import open_source
    from bumpstop.view.page.server import ViewServer, is_loopback

    opened = open_source(source)
    server = ViewServer(opened, host=host, port=port)
    for note in opened.notes:
        typer.echo(f"note: {note}", err=True)
    if not is_loopback(host):
        typer.echo(
            f"warning: {host} is not loopback: whoever reaches this machine can read and change these pages", err=True
        )
    typer.echo(f"the page: {server.url}")
    if browser:
        import webbrowser

        webbrowser.open(server.url)
    try:
        threading.Event().wait()
    except KeyboardInterrupt:
        typer.echo("")
    finally:
        server.stop()
