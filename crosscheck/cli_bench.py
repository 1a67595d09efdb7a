"""The command `bench`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..models import load_scene
from ..reports import print_bench, require_free, write_bench
from .engine import EngineError
from .run import ENGINE_FAILED
from .sweep import FULL, QUICK
from .terminal import Out, Scene, console, plain, say, steps


def bench(
    scene: Scene = "hexapod",
    engine: Annotated[
        list[str] | None,
        typer.Option(help="Engine to time; may be repeated. Default: all. The reference always runs."),
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="Fewer settings and rounds: under a minute.")] = False,
    out: Out = None,
) -> int:
    """Measure speed against error of every method of every engine on one scene.

    Times driving forces, all reactions, accelerations from forces and one second of motion, in turns, one at a time,
    one thread each. Writes speed_error.csv, scaling.csv, split.csv, plots, report.html and run.json. Exit status: 0 all
    measured, 1 an exact method is off by more than its tolerance, 2 unusable input, 3 an engine failed to run, 4 an
    internal error.
    """
    from .bench import bench as bench_scene  # with scipy: half a second, which no other command need wait for

    require_free(out or Path("runs", "RUN_ID"))
    loaded = load_scene(scene)
    progress = console(stderr=True)
    with steps(f"{loaded.name}: starting", progress) as done:
        try:
            report = bench_scene(loaded, engine or (), QUICK if quick else FULL, done)
        except EngineError as e:
            say(str(e))
            return ENGINE_FAILED
        folder = out or Path("runs") / report.info["run_id"]
        plain(progress, f"writing {folder}")
        write_bench(folder, report.speed_error, report.scaling, report.split, report.info)
    screen = console()
    print_bench(report.speed_error, report.split, report.info, screen)
    plain(screen, f"results: {folder}")
    return report.status
