"""The command line: run, simulate, bench, stress, power, audit, nightly, compare, models, scenes, engines."""

from __future__ import annotations

import errno
import signal
import sys
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from ..models import SceneError, load_scene, scene_names, write_models
from ..reports import HistoryError, OutputError, print_audit, require_free, write_files
from . import audit as audit_of_text
from .cli_bench import bench
from .cli_compare import compare
from .cli_nightly import Interrupted, nightly
from .cli_power import power
from .cli_run import run
from .cli_simulate import simulate
from .cli_stress import stress
from .engine import EngineError, Failure, UnknownEngine, engine_version, routes
from .hard import UnknownFamily
from .ranges import out_of_range
from .run import AGREE, DISAGREE, ENGINE_FAILED, choose_engines, new_run_id
from .terminal import Out, Scene, console, plain, say
from .trajectory import TrajectoryError
from .unfinished import ResumeError
from .unit import UnknownUnit

UNUSABLE, INTERNAL, INTERRUPTED = 2, 4, 130

UNUSABLE_INPUT = (
    SceneError, TrajectoryError, UnknownEngine, UnknownFamily, UnknownUnit, OutputError, HistoryError, ResumeError,
)  # fmt: skip

app = typer.Typer(
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    help="Check the closed-form dynamics of a Stewart platform against MuJoCo, Pinocchio, DART and certified truth.",
)

app.command(epilog="Example: crosscheck run hexapod --engine mujoco --engine pinocchio --samples 51 --out results")(run)
app.command(
    epilog="Example: crosscheck simulate hexapod --engine mujoco --engine pinocchio --duration 1 --out results"
)(simulate)
app.command(epilog="Example: crosscheck bench hexapod --quick --out results")(bench)
app.command(epilog="Example: crosscheck stress --family steep --engine mujoco --quick --out results")(stress)
app.command(epilog="Example: crosscheck nightly --unit run-hexapod --unit audit")(nightly)
app.command(epilog="Example: crosscheck compare runs/RUN_A runs/RUN_B --out results")(compare)
app.command(epilog="Example: crosscheck power hexapod --engine mujoco --out results")(power)


@app.command(epilog="Example: crosscheck audit --out results")
def audit(
    out: Out = None,
) -> int:
    """Measure every equation of the paper, and every misprint, against certified truth.

    Writes audit.csv. Exit status: 0 every equation holds and every misprint shows, 1 one does not, 2 unusable input,
    3 the reference failed to run, 4 an internal error.
    """
    require_free(out or Path("runs", "RUN_ID"))
    try:
        table = audit_of_text.audit()
    except EngineError as e:
        say(str(e))
        return ENGINE_FAILED
    folder = out or Path("runs") / new_run_id("audit")
    write_files(folder, {"audit.csv": table.to_csv(index=False)})
    screen = console()
    print_audit(table, screen)
    plain(screen, f"results: {folder}")
    return DISAGREE if (table["verdict"] == audit_of_text.FAILS).any() else AGREE


@app.command(epilog="Example: crosscheck models hexapod --out my_models")
def models(
    scene: Scene,
    out: Annotated[Path, typer.Option(help="Folder for NAME.xml, NAME.urdf and NAME.loops.json.")],
) -> int:
    """Write the MJCF, the URDF and the loop list of a scene."""
    loaded = load_scene(scene)
    files = write_models(loaded)
    write_files(out, files)
    for name in files:
        plain(console(), str(out / name))
    return 0


@app.command(epilog="Example: crosscheck scenes")
def scenes() -> int:
    """List the built-in scenes."""
    table = Table("scene", "bodies", "nv = na + nc", "quantities")
    for name in scene_names():
        s = load_scene(name)
        table.add_row(name, str(len(s.bodies)), f"{s.nv} = {s.na} + {s.nc}", ", ".join(s.quantities))
    console().print(table)
    return 0


@app.command(epilog="Example: crosscheck engines")
def engines() -> int:
    """List the engines, their routes and installed versions."""
    table = Table("engine", "route", "package", "version")
    for name, e in choose_engines([]).items():
        if isinstance(e, Failure):
            table.add_row(name, "-", "-", f"[red]{escape(e.reason)}[/]")
        else:
            wrong = out_of_range(e) if engine_version(e) else "missing"
            table.add_row(name, ", ".join(routes(e)), e.package, f"[red]{wrong}[/]" if wrong else engine_version(e))
    console().print(table)
    return 0


def main() -> None:
    """Entry point: runs a command and turns errors into exit statuses."""
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.default_int_handler)  # clean up as after Ctrl-C
    try:
        status = app(args=sys.argv[1:] or ["--help"], standalone_mode=False)
        if status == INTERRUPTED:
            say("interrupted; nothing was written")
    except Interrupted as e:
        say(str(e))
        status = INTERRUPTED
    except UNUSABLE_INPUT as e:
        say(str(e))
        status = UNUSABLE
    except typer.TyperException as e:
        say(f"{e.format_message()} (see --help)")
        status = UNUSABLE
    except OSError as e:
        short = e.errno in (errno.EMFILE, errno.ENFILE, errno.EAGAIN, errno.ENOMEM)
        say(f"cannot {'go on' if short else 'write to the terminal'}: {e.strerror or e}")
        status = INTERNAL
    except Exception:
        say("internal error, please report it with the lines below")
        Console(stderr=True).print_exception()
        status = INTERNAL
    sys.exit(status)
