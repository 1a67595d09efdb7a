"""The command line: run, simulate, audit, models, scenes, engines."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from ..models import SceneError, load_scene, scene_names, write_models
from ..reports import (
    OutputError,
    print_audit,
    print_simulation,
    print_verdict,
    require_free,
    write_files,
    write_run,
    write_simulation,
)
from . import audit as audit_of_text
from .engine import REFERENCE, DynamicsResult, EngineError, Failure, UnknownEngine, engine_version, routes
from .options import count, seconds, several
from .problem import pose
from .run import AGREE, DISAGREE, ENGINE_FAILED, choose_engines, new_run_id, require_determinate
from .run import run as run_scene
from .simulate import simulate as simulate_problem
from .tolerance import EASY_CONDITION, EASY_REACH, EASY_SIN_Q_N
from .trajectory import SAMPLES, TrajectoryError, from_file, from_scene

UNUSABLE, INTERNAL, INTERRUPTED = 2, 4, 130

app = typer.Typer(
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    help="Check the closed-form dynamics of a Stewart platform against MuJoCo, Pinocchio, DART and certified truth.",
)

Scene = Annotated[str, typer.Argument(help="A built-in scene (see `crosscheck scenes`) or the path of a TOML file.")]


class _Console(Console):
    def on_broken_pipe(self) -> None:
        """Whoever read has gone (`| head`): be quiet from here on, the exit status stays that of the command."""
        self.quiet = True
        os.dup2(os.open(os.devnull, os.O_WRONLY), self.file.fileno())


def _console(stderr: bool = False) -> Console:
    """Terminal output; a pipe gets lines of a width that tables fit."""
    console = _Console(stderr=stderr)
    return console if console.is_terminal else _Console(stderr=stderr, width=140)


@app.command(epilog="Example: crosscheck run hexapod --engine mujoco --engine pinocchio --samples 51 --out results")
def run(
    scene: Scene = "hexapod",
    engine: Annotated[
        list[str] | None, typer.Option(help="Engine to run; may be repeated. Default: all. The reference always runs.")
    ] = None,
    trajectory: Annotated[
        Path | None, typer.Option(help="CSV file: poses, twists and accelerations, or poses alone (rates by splines).")
    ] = None,
    samples: Annotated[
        int | None,
        typer.Option(parser=count, metavar="<int>", help=f"Samples of the scene's own motion. Default: {SAMPLES}."),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for the results. Default: runs/RUN_ID.")] = None,
) -> int:
    """Compare engines on one scene along one trajectory.

    Writes agreement.csv, samples.csv and run.json. Exit status: 0 all agree, 1 a disagreement, 2 unusable input,
    3 an engine failed to run, 4 an internal error.
    """
    if trajectory is not None and samples is not None:
        raise typer.BadParameter(
            "got it together with --trajectory, expected one of them: a file has its own rows", param_hint="'--samples'"
        )
    require_free(out or Path("runs", "RUN_ID"))
    loaded = load_scene(scene)
    require_determinate(loaded)
    motion = from_file(loaded, trajectory) if trajectory else from_scene(loaded, samples or SAMPLES)
    progress = _console(stderr=True)
    with progress.status(f"{loaded.name}: {len(motion.t)} samples"):

        def done(name: str, route: str, result: DynamicsResult | Failure) -> None:
            outcome = f"failed: {result.reason}" if isinstance(result, Failure) else f"done in {result.seconds:.2f} s"
            progress.print(
                f"{name} {route} {outcome}" if route else f"{name} {outcome}",
                highlight=False,
                markup=False,
                soft_wrap=True,
            )

        report = run_scene(loaded, motion, engine or (), done)
        folder = out or Path("runs") / report.info["run_id"]
        progress.print(f"writing {folder}", highlight=False, markup=False, soft_wrap=True)
        write_run(folder, report.agreement, report.samples(), report.info)

    console = _console()
    facts, truth = report.info["trajectory"], report.info["truth"]
    console.print(
        f"{loaded.name}: {len(loaded.bodies)} moving bodies, nv = {loaded.nv} = {loaded.na} + {loaded.nc};"
        f" {motion.source}, {facts['samples']} samples\ncondition up to {facts['max_condition']:.3g}, sin q_n down to"
        f" {facts['min_sin_q_n']:.3g}, accelerations up to {facts['max_acceleration']:.3g} m/s^2 and"
        f" {facts['max_angular_acceleration']:.3g} rad/s^2",
        highlight=False,
        markup=False,
    )
    floors: dict[str, list[str]] = {}
    for name, model in report.info["models"].items():
        for floor in model["floors"]:
            floors.setdefault(floor, []).append(name)
    for floor, names in floors.items():
        console.print(f"floor of {', '.join(names)}: {floor}", highlight=False, style="yellow")
    if facts["undetermined"]:
        console.print(facts["undetermined"], highlight=False, style="yellow")
    if facts["wider_samples"]:
        console.print(
            f"the tolerance of forces and moments is wider at {facts['wider_samples']} of {facts['samples']} samples"
            f" (condition above {EASY_CONDITION:g}, sin q_n below {EASY_SIN_Q_N:g}, or pins more than {EASY_REACH:g}"
            " times the shortest length off the origin), up to"
            f" {facts['widest_tolerance']:.1e}",
            highlight=False,
            style="yellow",
        )
    if 0 < truth["samples"] < truth["of"]:
        console.print(
            f"certified truth: {truth['samples']} of {truth['of']} samples (seed {truth['seed']}), the worst"
            " conditioned among them; errors are taken there, and samples.csv holds these; gaps of the loops and"
            " balance are checked at all",
            highlight=False,
        )
    print_verdict(report.agreement, console)
    console.print(f"results: {folder}", highlight=False, markup=False, soft_wrap=True)
    return report.status


@app.command(
    epilog="Example: crosscheck simulate hexapod --engine mujoco --engine pinocchio --duration 1 --out results"
)
def simulate(
    scene: Scene = "hexapod",
    engine: Annotated[
        list[str] | None,
        typer.Option(help="Engine to run; may be repeated. Default: all. The analytic solution always runs."),
    ] = None,
    duration: Annotated[
        float | None,
        typer.Option(parser=seconds, metavar="<s>", help="Seconds. Default: those of the motion, or 1 without one."),
    ] = None,
    samples: Annotated[
        int | None,
        typer.Option(parser=several, metavar="<int>", help=f"Output times, both ends included. Default: {SAMPLES}."),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for the results. Default: runs/RUN_ID.")] = None,
) -> int:
    """Simulate a scene in every engine under the same driving forces.

    Forces are the scene's, or those of its motion; the start is [initial], or the motion's. Writes states.csv,
    simulation.csv and run.json. Exit status: 0 all agree, 1 a disagreement, 2 unusable input, 3 an engine failed to
    run, 4 an internal error.
    """
    require_free(out or Path("runs", "RUN_ID"))
    loaded = load_scene(scene)
    if loaded.forces is None:
        require_determinate(loaded)
    problem = pose(loaded, duration, samples or SAMPLES)
    progress = _console(stderr=True)
    with progress.status(f"{loaded.name}: {problem.duration:g} s"):
        report = simulate_problem(
            problem,
            engine or (),
            lambda line: progress.print(line, highlight=False, markup=False, soft_wrap=True),
        )
        folder = out or Path("runs") / report.info["run_id"]
        progress.print(f"writing {folder}", highlight=False, markup=False, soft_wrap=True)
        write_simulation(folder, report.simulation, report.states(), report.info)
    console = _console()
    console.print(
        f"{loaded.name}: {problem.duration:g} s from {problem.start.source}; forces: {report.info['forces']}",
        highlight=False,
        markup=False,
        soft_wrap=True,
    )
    print_simulation(report.simulation, problem.duration, console)
    for name in report.info["without_simulation"]:
        certified = report.info["certified_samples"]
        served = (
            f": its forces at {certified} samples serve the accelerations" if name == REFERENCE and certified else ""
        )
        console.print(f"{name}: no simulation{served}", highlight=False, markup=False, style="dim", soft_wrap=True)
    console.print(f"results: {folder}", highlight=False, markup=False, soft_wrap=True)
    return report.status


@app.command(epilog="Example: crosscheck audit --out results")
def audit(
    out: Annotated[Path | None, typer.Option(help="Folder for the table. Default: runs/RUN_ID.")] = None,
) -> int:
    """Measure every equation of the paper, and every misprint, against certified truth.

    Writes audit.csv. Exit status: 0 every equation holds and every misprint shows, 1 one does not, 2 unusable input,
    3 the reference failed to run, 4 an internal error.
    """
    require_free(out or Path("runs", "RUN_ID"))
    try:
        table = audit_of_text.audit()
    except EngineError as e:
        _say(str(e))
        return ENGINE_FAILED
    folder = out or Path("runs") / new_run_id("audit")
    write_files(folder, {"audit.csv": table.to_csv(index=False)})
    console = _console()
    print_audit(table, console)
    console.print(f"results: {folder}", highlight=False, markup=False, soft_wrap=True)
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
        _console().print(str(out / name), highlight=False, markup=False, soft_wrap=True)
    return 0


@app.command(epilog="Example: crosscheck scenes")
def scenes() -> int:
    """List the built-in scenes."""
    table = Table("scene", "bodies", "nv = na + nc", "quantities")
    for name in scene_names():
        s = load_scene(name)
        table.add_row(name, str(len(s.bodies)), f"{s.nv} = {s.na} + {s.nc}", ", ".join(s.quantities))
    _console().print(table)
    return 0


@app.command(epilog="Example: crosscheck engines")
def engines() -> int:
    """List the engines, their routes and installed versions."""
    table = Table("engine", "route", "package", "version")
    for name, e in choose_engines([]).items():
        if isinstance(e, Failure):
            table.add_row(name, "-", "-", f"[red]{escape(e.reason)}[/]")
        else:
            table.add_row(name, ", ".join(routes(e)), e.package, engine_version(e) or "[red]missing[/]")
    _console().print(table)
    return 0


def _say(message: str) -> None:
    with contextlib.suppress(OSError):  # stderr may be closed or full: the exit status still tells
        print(f"crosscheck: {message}", file=sys.stderr, flush=True)


def main() -> None:
    """Entry point: runs a command and turns errors into exit statuses."""
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.default_int_handler)  # clean up as after Ctrl-C
    try:
        status = app(args=sys.argv[1:] or ["--help"], standalone_mode=False)
        if status == INTERRUPTED:
            _say("interrupted; nothing was written")
    except (SceneError, TrajectoryError, UnknownEngine, OutputError) as e:
        _say(str(e))
        status = UNUSABLE
    except typer.TyperException as e:
        _say(f"{e.format_message()} (see --help)")
        status = UNUSABLE
    except OSError as e:
        _say(f"cannot write to the terminal: {e.strerror or e}")
        status = INTERNAL
    except Exception:
        _say("internal error, please report it with the lines below")
        Console(stderr=True).print_exception()
        status = INTERNAL
    sys.exit(status)
