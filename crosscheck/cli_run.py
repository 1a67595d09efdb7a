"""The command `run`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..models import load_scene
from ..reports import print_verdict, require_free, write_run
from .engine import DynamicsResult, Failure
from .options import count
from .run import require_determinate
from .run import run as run_scene
from .terminal import Out, Scene, console, plain
from .tolerance import EASY_CONDITION, EASY_REACH, EASY_SIN_Q_N
from .trajectory import SAMPLES, from_file, from_scene


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
    out: Out = None,
) -> int:
    """Compare engines on one scene along one trajectory.

    Writes agreement.csv, margins.csv, samples.csv and run.json. Exit status: 0 all agree, 1 a disagreement,
    2 unusable input, 3 an engine failed to run, 4 an internal error.
    """
    if trajectory is not None and samples is not None:
        raise typer.BadParameter(
            "got it together with --trajectory, expected one of them: a file has its own rows", param_hint="'--samples'"
        )
    require_free(out or Path("runs", "RUN_ID"))
    loaded = load_scene(scene)
    require_determinate(loaded)
    motion = from_file(loaded, trajectory) if trajectory else from_scene(loaded, samples or SAMPLES)
    progress = console(stderr=True)
    with progress.status(f"{loaded.name}: {len(motion.t)} samples"):

        def done(name: str, route: str, result: DynamicsResult | Failure) -> None:
            outcome = f"failed: {result.reason}" if isinstance(result, Failure) else f"done in {result.seconds:.2f} s"
            plain(progress, f"{name} {route} {outcome}" if route else f"{name} {outcome}")

        report = run_scene(loaded, motion, engine or (), done)
        folder = out or Path("runs") / report.info["run_id"]
        plain(progress, f"writing {folder}")
        write_run(folder, report.agreement, report.samples(), report.info)

    screen = console()
    facts, truth = report.info["trajectory"], report.info["truth"]
    screen.print(
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
        screen.print(f"floor of {', '.join(names)}: {floor}", highlight=False, style="yellow")
    if facts["undetermined"]:
        screen.print(facts["undetermined"], highlight=False, style="yellow")
    if facts["wider_samples"]:
        screen.print(
            f"the tolerance of forces and moments is wider at {facts['wider_samples']} of {facts['samples']} samples"
            f" (condition above {EASY_CONDITION:g}, sin q_n below {EASY_SIN_Q_N:g}, or pins more than {EASY_REACH:g}"
            " times the shortest length off the origin), up to"
            f" {facts['widest_tolerance']:.1e}",
            highlight=False,
            style="yellow",
        )
    if 0 < truth["samples"] < truth["of"]:
        screen.print(
            f"certified truth: {truth['samples']} of {truth['of']} samples (seed {truth['seed']}), the worst"
            " conditioned among them; errors are taken there, and samples.csv holds these; gaps of the loops and"
            " balance are checked at all",
            highlight=False,
        )
    print_verdict(report.agreement, screen)
    plain(screen, f"results: {folder}")
    return report.status
