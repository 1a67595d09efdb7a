"""A night: units of work one after another, each in a process of its own, and what they say put into two tables."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..reports import (
    Night,
    OutputError,
    compare,
    earlier,
    junit,
    night_files,
    night_of,
    status,
    summary,
)
from ..reports.checks import CHECK_COLUMNS, CHECK_KEY, TIME_COLUMNS
from ..reports.history import KIND, require_tables
from .code import code
from .engine import Failure, engine_version
from .machine import machine
from .ranges import out_of_range
from .run import choose_engines, provenance, versions
from .supervise import CRASHED, ENDED, MEMORY, supervise
from .unfinished import Attempt, Plan, Record, ResumeError, Unfinished
from .unit import Key, Row, Unit, choose_units, missing

if TYPE_CHECKING:
    import pandas as pd

ATTEMPTS = 2
"""Of a unit whose process crashed, or in which an engine's did; anything else is done once."""

TAIL = 300
"""Letters of what a command printed last that a row repeats."""


def work(
    night: Unfinished,
    units: Mapping[str, Unit],
    starts: Callable[[str], None] = lambda name: None,
    done: Callable[[str], None] = lambda line: None,
) -> None:
    """Do every unit that has no record yet. Raises OutputError: what was done is kept.

    ``starts`` is called with the name of each unit, ``done`` with a line for people on each, new or known.
    """
    known = night.records()
    for name, unit in units.items():
        starts(name)
        folder = night.unit(name)
        try:
            if name not in known:
                shutil.rmtree(folder, ignore_errors=True)  # of an attempt that was interrupted
                folder.mkdir(parents=True)
                night.record(name, attempt(unit, folder))
        except (OSError, OutputError) as e:
            why = e.strerror or e if isinstance(e, OSError) else e
            raise OutputError(f"{folder}: {why}; what was done is kept: --resume finishes the rest") from None
        record = night.records()[name]
        again = " (done before)" if name in known else ""
        done(line(name, record, unit_rows(unit, folder, record)[0]) + again)


def attempt(unit: Unit, folder: Path) -> Record:
    """Run a unit's command, once more after a crash, and say how each attempt ended.

    Raises OutputError where there is no room for its results: that is no result of the unit.
    """
    attempts: list[Attempt] = []
    while len(attempts) < ATTEMPTS:
        place = folder / str(len(attempts) + 1)
        log = place.with_suffix(".log")
        outcome = supervise((*unit.arguments, "--out", str(place)), log, unit.seconds, MEMORY)
        if outcome.status and (said := _last_line(log)).startswith(NO_ROOM):
            raise OutputError(said.removeprefix(NO_ROOM).partition(": ")[2])
        crashed = [""] if outcome.how == CRASHED else _crashed(place)
        attempts.append(Attempt(**outcome._asdict(), crashed=crashed))
        if not crashed:
            break
    return Record(attempts=attempts)


NO_ROOM = "crosscheck: --out "
"""How a command begins that could not write: what it was to do is known to be right."""


def _last_line(log: Path) -> str:
    lines = log.read_text(encoding="utf-8", errors="replace").strip().splitlines()
    return lines[-1] if lines else ""


def _crashed(folder: Path) -> list[str]:
    """Engines whose process crashed, as the command's run.json names them."""
    try:
        found = json.loads((folder / "run.json").read_bytes())["crashed"]
    except (OSError, ValueError, LookupError, TypeError):
        return []
    return [str(name) for name in found]


def unit_rows(unit: Unit, folder: Path, record: Record) -> tuple[list[Row], list[Row]]:
    """Checks and times of a unit that has ended; what is missing is there, with the reason."""
    place = folder / str(len(record.attempts))
    checks: list[Row] = []
    times: list[Row] = []
    try:
        reason = _why_nothing(record.attempts[-1], place)
        if not reason:
            checks, times = list(unit.checks(place)), list(unit.times(place))
            frames = _frames([{**row, "unit": unit.name} for row in checks], times)
            require_tables(Path(unit.name), *frames)
    except (OSError, ValueError, LookupError, TypeError) as e:  # files that are not what the unit writes
        what = f"{type(e).__name__}: {e}"
        if isinstance(e, OSError) and e.filename:
            what = f"{Path(e.filename).name}: {e.strerror}"
        checks, times, reason = [], [], f"its results cannot be read: {what}"
    found = {tuple(row[name] for name in CHECK_KEY[1:]) for row in checks}
    reason = reason or "not among the results, though it was expected"
    checks += [missing(key, reason) for key in unit.expected() if tuple(_ordered(key)) not in found]
    before = _first_attempt(record.attempts)
    for row in checks:
        row["unit"], row["reproduce"] = unit.name, unit.reproduce(row["engine"])
        row["reason"] = "; ".join(part for part in (row["reason"], before) if part)
    return checks, times


def _frames(checks: list[Row], times: list[Row]) -> tuple[pd.DataFrame, pd.DataFrame]:
    import pandas as pd

    return pd.DataFrame(checks, columns=CHECK_COLUMNS), pd.DataFrame(times, columns=TIME_COLUMNS)


def _ordered(key: Key) -> Iterator[str]:
    return (getattr(key, name) for name in CHECK_KEY[1:])


def _why_nothing(last: Attempt, place: Path) -> str:
    """Why an attempt left no results; empty if it did. Raises OSError without its log."""
    if last.how != ENDED:
        return last.reason
    if place.is_dir():
        return ""
    log = place.with_suffix(".log")
    if "MemoryError" in log.read_text(encoding="utf-8", errors="replace"):
        return f"out of memory: a process may have {MEMORY / 2**30:.3g} GiB"
    return f"exit status {last.status}: {_last_line(log)[-TAIL:]}"


def _first_attempt(attempts: Sequence[Attempt]) -> str:
    if len(attempts) == 1:
        return ""
    first = attempts[0]
    who = ", ".join(name for name in first.crashed if name)
    return f"second attempt: in the first {f'{who} crashed' if who else first.reason}"


def line(name: str, record: Record, checks: list[Row]) -> str:
    """How a unit ended, for people."""
    counts: dict[str, int] = {}
    for row in checks:
        counts[row["verdict"]] = counts.get(row["verdict"], 0) + 1
    again = f", attempt {len(record.attempts)}" if len(record.attempts) > 1 else ""
    said = ", ".join(f"{number} {verdict}" for verdict, number in counts.items())
    return f"{name}: {said or 'nothing'} in {record.seconds:.1f} s{again}"


def begin(final: Path, units: Mapping[str, Unit], started: datetime, run_id: str, baseline: Path) -> Unfinished:
    """A night that is to become a folder, and the baseline that it is to be compared with. Raises OutputError."""
    whole = list(units) == list(choose_units(()))
    plan = Plan(run_id=run_id, started=started, units=list(units), whole=whole, baseline=baseline.absolute(), **_same())
    return Unfinished.begin(final, plan)


def resume(final: Path | None, history: Path) -> Unfinished:
    """A night that was interrupted. Raises ResumeError if there is none, or if something has changed since."""
    night = Unfinished.resume(final, history)
    for what, now in _same().items():
        for name, value in now.items():
            if (was := getattr(night.plan, what).get(name)) != value:
                raise ResumeError(
                    f"--resume: {night.folder}: {what}: {name}: got {value!r}, expected {was!r} as in the evening:"
                    " start a new night, and remove this one"
                )
    return night


def _same() -> dict[str, dict[str, Any]]:
    """What must not change in the middle of a night."""
    return {"versions": versions(choose_engines([])), "code": code(), "machine": machine()}


def tables(night: Unfinished, units: Mapping[str, Unit]) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Checks and times of all units."""
    checks: list[Row] = []
    times: list[Row] = []
    for name, record in night.records().items():
        found = unit_rows(units[name], night.unit(name), record)
        checks += found[0]
        times += found[1]
    engines = {n: engine_version(e) or "" for n, e in choose_engines([]).items() if not isinstance(e, Failure)}
    both = _frames(checks, times)
    for table in both:
        table["run_id"] = night.plan.run_id
        table["engine_version"] = table["engine"].map(engines).fillna("")
    return both


@dataclass(frozen=True)
class NightReport:
    """What a night found, and what it was compared with."""

    before: Night
    night: Night
    findings: pd.DataFrame
    unreadable: list[str]

    @property
    def status(self) -> int:
        """1: something is wrong, or has become worse; 3: something did not run and the rest is well."""
        return status(self.findings)


def notes(night: Unfinished) -> list[str]:
    """Sentences on engines of other versions than this project is made for, and on units that were tried again."""
    engines = [engine for engine in choose_engines([]).values() if not isinstance(engine, Failure)]
    return [why for engine in engines if (why := out_of_range(engine))] + [
        f"{name}: {_first_attempt(record.attempts)}"
        for name, record in night.records().items()
        if len(record.attempts) > 1
    ]


def finish(night: Unfinished, units: Mapping[str, Unit], accepted: Night | None) -> NightReport:
    """Put together what the units left, compare it with the accepted baseline, and give the night its name.

    Raises OutputError; what was done is kept, and `resume` goes on from there.
    """
    checks, times = tables(night, units)
    past, unreadable = earlier(night.final.parent, night.plan.started.isoformat())
    info = {
        "kind": KIND,
        **provenance(night.plan.run_id, night.plan.started, None, choose_engines([])),
        "code": night.plan.code,
        "whole": night.plan.whole,
        "units": {
            name: {"seconds": record.seconds, "attempts": len(record.attempts)}
            for name, record in night.records().items()
        },
        "baseline": accepted.info["run_id"] if accepted else None,
        "history": {"nights": [n.info["run_id"] for n in past], "unreadable": unreadable},
    }
    read = night_of(night.final, night_files(checks, times, info, {}))
    before = accepted or read._replace(checks=read.checks.iloc[:0], times=read.times.iloc[:0])
    findings = compare(before, read, past)
    report = NightReport(before, read, findings, unreadable)
    more = {
        "regressions.csv": findings.to_csv(index=False, float_format="%.6g"),
        "junit.xml": junit(read, findings),
        "summary.md": summary(before, read, findings, unreadable, notes(night)),
    }
    try:
        night.publish(night_files(checks, times, info | {"status": report.status}, more))
    except OSError as e:
        raise OutputError(
            f"{night.folder}: {e.strerror or e}; what was done is kept there, and --resume goes on from it"
        ) from None
    return report
