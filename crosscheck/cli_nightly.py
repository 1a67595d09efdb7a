"""The command `nightly`."""

from __future__ import annotations

import shlex
from datetime import UTC, datetime
from importlib import resources
from pathlib import Path
from typing import Annotated

import typer

from ..reports import Night, load_night, print_regressions, write_baseline
from .nightly import begin, finish, notes, resume, work
from .run import DISAGREE, new_run_id
from .terminal import Out, console, one_by_one, plain
from .unfinished import Unfinished
from .unit import choose_units

RUNS = Path("runs")
BASELINE = Path(str(resources.files("stewart_crosscheck.crosscheck"))) / "baseline"


class Interrupted(Exception):
    """A night that was interrupted: what was done is kept. The message says how to go on."""


def nightly(
    unit: Annotated[
        list[str] | None, typer.Option(help="Unit of work, such as run-hexapod; may be repeated. Default: all.")
    ] = None,
    resumed: Annotated[
        bool, typer.Option("--resume", help="Finish the newest night that was interrupted, or that of --out.")
    ] = False,
    baseline: Annotated[
        Path | None, typer.Option(help="Folder of accepted results to compare with. Default: those of this project.")
    ] = None,
    update_baseline: Annotated[
        bool, typer.Option("--update-baseline", help="Accept this night's results as the baseline; ends with 1.")
    ] = False,
    out: Out = None,
) -> int:
    """Run every scene, engine and route, the audit, hard cases and timings, and compare with what was accepted.

    Each unit of work has a process of its own, a time limit, and one more attempt after a crash; what does not run is
    a row that says so. Writes checks.csv, times.csv, regressions.csv, junit.xml, summary.md, run.json and the results
    of each unit. Earlier nights in the folder that holds --out are its history. Exit status: 0 nothing became worse,
    1 a disagreement or a regression, or a new baseline, 2 unusable input, 3 something failed to run, 4 an internal
    error, 130 interrupted: what was done is kept, and --resume finishes the rest.
    """
    if resumed and (unit or baseline):
        raise typer.BadParameter(
            f"got it together with {'--unit' if unit else '--baseline'}, expected none: a night goes on as it began",
            param_hint="'--resume'",
        )
    night = None
    try:
        if resumed:
            night = resume(out, RUNS)
            units, base = choose_units(night.plan.units), night.plan.baseline
            accepted = _accepted(base, update_baseline)
        else:
            units, base = choose_units(unit or ()), baseline or BASELINE
            accepted = _accepted(base, update_baseline)  # before hours of work
            started = datetime.now(UTC)
            run_id = new_run_id("nightly", started)
            night = begin(out or RUNS / run_id, units, started, run_id, base)
        with one_by_one(len(units), console(stderr=True)) as (starts, done):
            work(night, units, starts, done)
        told = notes(night)
        report = finish(night, units, accepted)
    except KeyboardInterrupt:
        if night is None:
            raise
        raise Interrupted(_kept(night, out, update_baseline)) from None
    screen = console()
    print_regressions(report.before, report.night, report.findings, screen, report.unreadable, told)
    plain(screen, f"results: {night.final}")
    if not update_baseline:
        return report.status
    write_baseline(base, report.night)
    plain(screen, f"new baseline: {base}")
    return DISAGREE


def _accepted(baseline: Path, update: bool) -> Night | None:
    """The accepted results; none only for the very first ones. Raises HistoryError."""
    return None if update and not (baseline / "run.json").exists() else load_night(baseline)


def _kept(night: Unfinished, out: Path | None, update: bool) -> str:
    """What an interrupted night left, and how to go on."""
    if not night.folder.exists():
        return f"interrupted when all was done: {night.final}"
    more = [*(["--out", str(out)] if out else []), *(["--update-baseline"] if update else [])]
    command = shlex.join(["crosscheck", "nightly", "--resume", *more])
    done, of = len(night.records()), len(night.plan.units)
    return f"interrupted: {done} of {of} units are done and kept in {night.folder}; {command} finishes the rest"
