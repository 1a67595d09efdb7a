"""A night for people: the same words as Markdown and on a terminal."""

from __future__ import annotations

import re
from collections.abc import Sequence
from math import isnan
from typing import TYPE_CHECKING, NamedTuple

from rich.console import Console
from rich.markup import escape

from .checks import CHECK_KEY
from .findings import NOT_RUN
from .history import Night, name_of, printable
from .regressions import counts, status

if TYPE_CHECKING:
    import pandas as pd

MOST = 30
"""Lines of a list; the rest is in regressions.csv."""

VERDICTS = {0: "green", 1: "RED", 3: "INCOMPLETE"}
_CHANGED = ("version changed", "code changed")
_TOGETHER = ["what", "unit", "engine", "route", "since", "suspect"]


class Section(NamedTuple):
    """A list with a title: cells by column, and how many rows of the table were left out."""

    title: str
    rows: list[dict[str, str]]
    left: int = 0


class Story(NamedTuple):
    """All that is told of a night."""

    title: str
    verdict: str
    good: bool
    notes: list[str]
    sections: list[Section]


def story(
    before: Night, after: Night, findings: pd.DataFrame, unreadable: Sequence[str], notes: Sequence[str]
) -> Story:
    """What is red first; lists without rows are left out."""
    severity, what = findings["severity"], findings["what"]
    state = status(findings)
    found = counts(findings)
    fails = ", ".join(f"{name} {n}" for (level, name), n in found.items() if level == "fail") or "nothing worse"
    warnings = sum(n for (level, _), n in found.items() if level == "warn")
    told = [f"{name}: {n} rows" for (level, name), n in found.items() if name in ("better", "faster")]
    about_times = findings[(severity == "info") & ~what.isin([*_CHANGED, "better", "faster"])]
    changed = findings[what.isin(_CHANGED)]
    same = before.info["run_id"] == after.info["run_id"]
    against = "nothing: no night was accepted before" if same else before.name
    sections = [
        _section("Red", findings[severity == "fail"]),
        _section("Warnings", findings[(severity == "warn") & (what != "new")]),
        Section(
            "Changed", [{"what": row["quantity"], "from → to": row["reason"]} for row in changed.to_dict("records")]
        ),
        Section("New rows", _new(findings[what == "new"])),
        Section("Times", [{"what": row["what"], "why": row["reason"]} for row in about_times.to_dict("records")]),
        Section("Not read from the history", [{"entry": message} for message in _some(unreadable)]),
        Section("Units", _units(after)),
    ]
    return Story(
        f"Night {after.name}",
        f"{VERDICTS[state]}: {fails}; warnings {warnings}; checks {len(after.checks)}; against {against}",
        state == 0,
        [*notes, *told],
        [section for section in sections if section.rows],
    )


def summary(
    before: Night, after: Night, findings: pd.DataFrame, unreadable: Sequence[str] = (), notes: Sequence[str] = ()
) -> str:
    """A night as Markdown.

    ``findings``: of `compare`; ``unreadable``: of `earlier`; ``notes``: further sentences.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(  # HTML is escaped by `markdown`, with everything else
        loader=PackageLoader(__package__ or "", "templates"), autoescape=False, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True,
    )  # fmt: skip
    environment.filters |= {"markdown": markdown, "code": code}
    told = story(before, after, findings, unreadable, notes)
    return environment.get_template("summary.md").render(told._asdict())


def print_regressions(
    before: Night,
    after: Night,
    findings: pd.DataFrame,
    console: Console,
    unreadable: Sequence[str] = (),
    notes: Sequence[str] = (),
) -> None:
    """Print a night: the verdict comes last, where a terminal shows it."""
    told = story(before, after, findings, unreadable, notes)
    for section in told.sections:
        console.print(section.title, highlight=False, style="italic")
        for row in section.rows:
            head, *rest = row.items()
            text = ", ".join([head[1], *(f"{name} {cell}" for name, cell in rest if cell)])
            console.print(f"  {escape(printable(text))}", highlight=False, soft_wrap=True)
        if section.left:
            console.print(f"  {section.left} more in regressions.csv", highlight=False)
    for note in told.notes:
        console.print(escape(printable(note)), highlight=False, soft_wrap=True)
    style = "bold green" if told.good else "bold red"
    console.print(f"[{style}]{escape(printable(told.verdict))}[/]", highlight=False, soft_wrap=True)


def markdown(text: str) -> str:
    """The text as it is, wherever it stands in Markdown."""
    return re.sub(r"([\\`*\[\]<>#|~&]|(?<![^\W_])_|_(?![^\W_]))", r"\\\1", printable(text))


def code(text: str) -> str:
    """A span of code, also within a table."""
    text = printable(text).replace("|", r"\|")
    longest = max(map(len, re.findall("`+", text)), default=0)
    fence, space = "`" * (longest + 1), " " if longest else ""
    return f"{fence}{space}{text}{space}{fence}" if text else ""


def _section(title: str, findings: pd.DataFrame) -> Section:
    """A line for all rows of one method that are told the same of: the worst is named. Crashes go by their reasons."""
    rows, left = [], 0
    crashes = findings["reason"].where(findings["what"] == NOT_RUN, "")
    for _, group in findings.groupby([*_TOGETHER, crashes], sort=False):
        if len(rows) == MOST:
            left += len(group)
            continue
        worst = group.iloc[0]
        numbers = worst["what"] != NOT_RUN
        both = not isnan(worst["margin_before"] + worst["margin"])  # one alone reads like a change for the better
        rows.append(
            {
                "what": worst["what"],
                "rows": str(len(group)),
                "worst row": name_of(worst, CHECK_KEY),
                "error": _pair(worst["error_before"], worst["error"]) if numbers else "",
                "margin": _pair(worst["margin_before"], worst["margin"]) if numbers and both else "",
                "since": worst["since"],
                "first suspect": worst["suspect"],
                "why": worst["reason"],
                "reproduce": worst["reproduce"],
            }
        )
    return Section(title, rows, left)


def _some(lines: Sequence[str]) -> list[str]:
    """The first of many, and how many more there are."""
    more = len(lines) - MOST
    return [*lines[:MOST], f"{more} more"] if more > 0 else list(lines)


def _new(findings: pd.DataFrame) -> list[dict[str, str]]:
    """A line for each unit."""
    groups = findings.groupby("unit", sort=False)
    return [{"unit": str(u), "rows": str(len(g)), "the first": name_of(g.iloc[0], CHECK_KEY[1:])} for u, g in groups]


def _pair(before: float, after: float) -> str:
    if isnan(before) and isnan(after):
        return ""
    return " → ".join("none" if isnan(x) else f"{x:.2g}" for x in (before, after))


def _units(night: Night) -> list[dict[str, str]]:
    units = night.info["units"]
    rows = []
    for name in units:
        facts = units[name] if isinstance(units, dict) else {}
        verdicts = night.checks.loc[night.checks["unit"] == name, "verdict"].value_counts()
        seconds = facts.get("seconds")
        rows.append(
            {
                "unit": str(name),
                "checks": ", ".join(f"{n} {verdict}" for verdict, n in verdicts.items()),
                "times": str((night.times["unit"] == name).sum() or ""),
                "seconds": "" if seconds is None else f"{seconds:.1f}",
                "attempts": str(facts.get("attempts", "")),
            }
        )
    return rows
