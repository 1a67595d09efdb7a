"""The command `stress`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..reports import print_stress, require_free, write_stress
from .terminal import Out, console, plain, steps


def stress(
    family: Annotated[
        list[str] | None, typer.Option(help="Family of hard cases; may be repeated. Default: all.")
    ] = None,
    engine: Annotated[
        list[str] | None,
        typer.Option(help="Engine to ask; may be repeated. Default: all. The reference always runs."),
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="Fewer values of each parameter.")] = False,
    out: Out = None,
) -> int:
    """Ask every method of every engine at hard points, and see whether it says so where it is wrong.

    A case takes one parameter towards a hard place: a steep leg, a singular pose, extreme scales or speeds, coincident
    loops, long or stiff motions. Answers are judged by certified truth and by what half-ulp changes of the inputs make
    of it. Writes stress.csv, reasons.csv, outcomes.csv, plots, report.html and run.json. Exit status: 0 nothing of ours
    is silently wrong, 1 something of ours is, 2 unusable input, 3 an engine failed to run, 4 an internal error.
    """
    from .stress import FULL, QUICK  # with pandas: half a second, which no other command need wait for
    from .stress import stress as stress_engines

    require_free(out or Path("runs", "RUN_ID"))
    progress = console(stderr=True)
    with steps("starting", progress) as done:
        report = stress_engines(family or (), engine or (), QUICK if quick else FULL, done)
        folder = out or Path("runs") / report.info["run_id"]
        plain(progress, f"writing {folder}")
        write_stress(folder, report.table, report.info)
    screen = console()
    print_stress(report.table, report.info, screen)
    plain(screen, f"results: {folder}")
    return report.status
