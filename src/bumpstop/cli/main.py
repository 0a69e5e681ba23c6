"""The ``bumpstop`` command."""

from __future__ import annotations

import gc
import io
import os
import sys
from collections.abc import Sequence
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

import typer

from bumpstop.cli import benchmark, bodies, program, robots, view
from bumpstop.cli.campaign import campaign
from bumpstop.cli.collision import evaluate, require, speed_limits, stopping, study
from bumpstop.cli.command_group import group
from bumpstop.cli.detection import detect, score, sensitivity, tune
from bumpstop.cli.identification import identify, plan, recording
from bumpstop.cli.live import monitor
from bumpstop.cli.measure import commands as measure
from bumpstop.cli.plant import commands as plant
from bumpstop.cli.register import new, report
from bumpstop.cli.schroeder2013 import experiment
from bumpstop.errors import BumpstopError, InputError

app = group("How hard will it hit before it stops?", name="bumpstop")
app.command("new")(new.command)
app.command("evaluate")(evaluate.command)
app.command("report")(report.command)
app.add_typer(robots.app, name="robots")
app.add_typer(recording.app, name="recording")
study.app.command("speed-limits")(speed_limits.speed_limits)
app.add_typer(study.app, name="study")
app.add_typer(campaign.app, name="campaign")
app.add_typer(plant.app, name="plant")
app.command("require")(require.require)
app.command("program")(program.command)
app.command("stopping")(stopping.command)
app.command("bodies")(bodies.bodies)
app.command("identify")(identify.identify)
app.command("validate")(identify.validate)
app.add_typer(plan.app, name="plan")
app.command("tune")(tune.command)
app.command("score")(score.command)
app.command("sensitivity")(sensitivity.command)
app.command("detect")(detect.detect)
app.command("experiment")(experiment.command)
app.command("detector")(detect.detector)
app.command("view")(view.command)
app.command("monitor")(monitor.monitor)
app.add_typer(measure.app, name="measure")
app.add_typer(benchmark.app, name="benchmark")

# Exit statuses are part of the contract: 0 done (and acceptable), 3 done and not acceptable, 4 done and no verdict can
# be given, 2 bad input, 1 our fault, 130 interrupted, as shells have it.
BAD_INPUT = 2
OWN_FAULT = 1
INTERRUPTED = 130  # what typer makes of Ctrl-C, too

_OBJECTS_BETWEEN_COLLECTIONS = 100_000
# Newer typer carries its own copy of click, so click's name for this cannot be relied on.
_USAGE_ERROR: Any = typer.BadParameter.__base__


def _version(wanted: bool) -> None:
    if wanted:
        import bumpstop

        typer.echo(f"bumpstop {bumpstop.__version__}")
        raise typer.Exit


@app.callback(invoke_without_command=True)
def _root(
    context: typer.Context,
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    """Tell how hard an industrial arm hits before it stops. An engineering tool, not a certified safety function."""
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


@cache
def _built() -> Any:
    """The command with all of its options, which take a while to be made: once, for programs that call it often."""
    return typer.main.get_command(app)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line; the last line on stderr of a failure is ``error: ...``."""
    status = 0
    if arguments is None:
        # What imports make stays for good: to look through it for garbage every 700 objects takes a tenth of a command.
        gc.set_threshold(_OBJECTS_BETWEEN_COLLECTIONS)
        _forget_unusable()
        # Without a stream for errors Python prints them among the results.
        if sys.stderr is None:
            sys.stderr = Path(os.devnull).open("w")  # noqa: SIM115
        # A name in letters that the terminal lacks is no fault of anybody's.
        if isinstance(sys.stdout, io.TextIOWrapper):
            sys.stdout.reconfigure(errors="backslashreplace")
    given = list(sys.argv[1:] if arguments is None else arguments)
    try:
        _refuse_empty_folder(given)
        result = _built()(args=given, standalone_mode=False)
        status = result if isinstance(result, int) else 0
        if status == INTERRUPTED:
            raise KeyboardInterrupt
    except BumpstopError as error:
        faults = getattr(error, "faults", ())
        for fault in faults if len(faults) > 1 else ():
            _print_line("fault", str(fault))
        # A column file to start from, which can be sent into a file as it is.
        draft = getattr(error, "draft", "")
        if draft and "--json" not in given:
            typer.echo(draft, nl=False)
        status = _fail(str(error).splitlines()[0] if faults else str(error), BAD_INPUT)
    except _USAGE_ERROR as error:
        status = _fail(_usage_message(error), BAD_INPUT)
    except (typer.Abort, KeyboardInterrupt):
        status = _fail("interrupted", INTERRUPTED)
    except BrokenPipeError:
        # The reader of the output has closed it: there is nothing left to print to.
        _drop_output()
        status = OWN_FAULT
    except OSError as error:
        _drop_output()
        status = _fail(f"{error.filename or 'output'}: {error.strerror or error}", OWN_FAULT)
    except MemoryError:
        status = _fail("out of memory: this needs more than the machine has", OWN_FAULT)
    except Exception as error:
        status = _fail(f"internal fault ({type(error).__name__}: {error}); please report it", OWN_FAULT)
    sys.exit(status)


def _forget_unusable() -> None:
    """Drop settings of whatever started this process that stop our libraries; those of a program stay its own.

    Jupyter names a backend of matplotlib that need not be installed here, and no page needs one. A console without a
    width says 0, and rich would print nothing.
    """
    os.environ.pop("MPLBACKEND", None)
    if not os.environ.get("COLUMNS", "").strip("0"):
        os.environ.pop("COLUMNS", None)


def _refuse_empty_folder(arguments: list[str]) -> None:
    """Of a path that is empty, as an unset variable of a shell is, Python makes the current folder."""
    if "--out=" in arguments or any(first in ("--out", "-o") and not then for first, then in pairwise(arguments)):
        raise InputError("--out", "is empty", "wanted a folder")


def _usage_message(error: Any) -> str:
    if isinstance(error, typer.BadParameter) and error.param is not None and error.message:
        # Numbers are read by pydantic, whose words leave out what was written.
        for complaint in getattr(error.__cause__, "errors", list)()[:1]:
            for kind, wanted in (("float", "a number"), ("int", "a whole number")):
                if complaint["type"].startswith(kind):
                    return f"{error.param.opts[0]}: {str(complaint['input'])[:80]!r} cannot be used; wanted {wanted}"
        return f"{error.param.opts[0]}: {error.message.removeprefix('Value error, ')}"
    # The outermost context is called after whatever started Python.
    command, context = "", error.ctx
    while context is not None and context.parent is not None:
        command, context = f" {context.info_name}{command}", context.parent
    return f"{str(error.format_message()).rstrip('.')}; see bumpstop{command} --help"


def _fail(message: str, status: int) -> int:
    _print_line("error", message)
    return status


def _print_line(what: str, message: str) -> None:
    line = " ".join(message.split())
    # What came from a file or a name must not steer the terminal.
    print(f"{what}: " + "".join(c if c.isprintable() else repr(c)[1:-1] for c in line), file=sys.stderr)


def _drop_output() -> None:
    """Send what is still buffered nowhere, or the interpreter would complain of it when it ends."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, sys.stdout.fileno())
    os.close(nowhere)
