"""The command `simulate`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..models import load_scene
from ..reports import print_simulation, require_free, write_simulation
from .engine import REFERENCE
from .options import seconds, several
from .problem import pose
from .run import require_determinate
from .simulate import simulate as simulate_problem
from .terminal import Out, Scene, console, plain
from .trajectory import SAMPLES


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
    out: Out = None,
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
    progress = console(stderr=True)
    with progress.status(f"{loaded.name}: {problem.duration:g} s"):
        report = simulate_problem(
            problem,
            engine or (),
            lambda line: plain(progress, line),
        )
        folder = out or Path("runs") / report.info["run_id"]
        plain(progress, f"writing {folder}")
        write_simulation(folder, report.simulation, report.states(), report.info)
    screen = console()
    plain(screen, f"{loaded.name}: {problem.duration:g} s from {problem.start.source}; forces: {report.info['forces']}")
    print_simulation(report.simulation, problem.duration, screen)
    for name in report.info["without_simulation"]:
        certified = report.info["certified_samples"]
        served = (
            f": its forces at {certified} samples serve the accelerations" if name == REFERENCE and certified else ""
        )
        screen.print(f"{name}: no simulation{served}", highlight=False, markup=False, style="dim", soft_wrap=True)
    plain(screen, f"results: {folder}")
    return report.status
