"""Pages of everything that a command measured, each in one file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import pandas as pd
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from .drawing import Plot
from .stress import OUTCOMES, PROBLEMS, counts, groups, verdict


class Shown(NamedTuple):
    """A table: its title, its columns, and rows of text by column."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Mapping[str, str]]


def _page(template: str, plots: Mapping[str, Plot], info: Mapping[str, Any], **parts: Any) -> str:
    environment = Environment(
        loader=PackageLoader(__package__ or "", "templates"), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    drawings = {name: Markup(plot.svg) for name, plot in plots.items()}  # ours, and made of escaped text
    return environment.get_template(template).render(plots=drawings, info=info, **parts)


def bench_page(
    best: Sequence[Shown],
    speed_error: pd.DataFrame,
    split: pd.DataFrame,
    plots: Mapping[str, Plot],
    info: Mapping[str, Any],
    equal: str,
    summary: Sequence[str],
) -> str:
    """The page of `bench` as text.

    ``best``: what is best of each task; ``equal``: what the ratio to the fastest means; ``summary``: sentences.
    """
    ours = speed_error[speed_error["engine"] == "analytic"]
    return _page(
        "bench.html",
        plots,
        info,
        best=[shown for shown in best if shown.rows],
        speed_error=[speed_error.columns.tolist(), *speed_error.map(_text).to_numpy().tolist()],
        split=split.to_dict("records"),
        fastest=ours.groupby("task")["us_per_sample"].min().dropna().to_dict(),
        equal=equal,
        summary=summary,
    )


def stress_page(found: pd.DataFrame, plots: Mapping[str, Plot], info: Mapping[str, Any]) -> str:
    """The page of `stress` as text. ``found``: one row per method and point."""
    good, sentence = verdict(found, info)
    tables = counts(found).groupby("problem", sort=False)
    families = found.drop_duplicates("case").groupby("family", sort=False)["case"]
    return _page(
        "stress.html",
        plots,
        info,
        good=good,
        verdict=sentence,
        outcomes=OUTCOMES,
        counts=[(PROBLEMS[str(problem)], rows.to_dict("records")) for problem, rows in tables],
        reasons=[
            (name, [group._asdict() for group in groups(found, name)]) for name in ("silent", "degraded", "refused")
        ],
        families=[(family, cases.tolist()) for family, cases in families],
    )


def _text(value: object) -> str:
    if isinstance(value, float):
        return "" if pd.isna(value) else f"{value:.3g}"
    return str(value)
