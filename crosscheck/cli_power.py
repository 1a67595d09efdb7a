"""The command `power`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..models import load_scene
from ..reports import require_free
from .terminal import Out, Scene, console, plain, steps


def power(
    scene: Scene = "hexapod",
    engine: Annotated[
        list[str] | None,
        typer.Option(help="Engine to plant faults in; may be repeated. Default: all. The formulas always run."),
    ] = None,
    out: Out = None,
) -> int:
    """Plant faults, one by one, and find the smallest that `run` detects, in every engine.

    Every number of the scene, every term and sign of the formulas, and the mistakes found in public hand-written codes.
    Writes power.csv, a plot (SVG and PNG) and run.json. Exit status: 0 each of these mistakes is caught, 1 one is not,
    2 unusable input, 3 an engine failed to run, 4 an internal error.
    """
    from ..reports.power import print_power, write_power
    from .power import power as plant  # with pandas: half a second, which no other command need wait for

    require_free(out or Path("runs", "RUN_ID"))
    loaded = load_scene(scene)
    progress = console(stderr=True)
    with steps("starting", progress) as done:
        report = plant(loaded, engine or (), done=done)
        folder = out or Path("runs") / report.info["run_id"]
        plain(progress, f"writing {folder}")
        write_power(folder, report.table, report.info)
    screen = console()
    print_power(report.table, report.info, screen)
    plain(screen, f"results: {folder}")
    return report.status
