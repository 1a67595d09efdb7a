"""A page of everything that `bench` measured, in one file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import pandas as pd
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from .plots import Plot


class Shown(NamedTuple):
    """A table: its title, its columns, and rows of text by column."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Mapping[str, str]]


def page(
    best: Sequence[Shown],
    speed_error: pd.DataFrame,
    split: pd.DataFrame,
    plots: Mapping[str, Plot],
    info: Mapping[str, Any],
    equal: str,
    summary: Sequence[str],
) -> str:
    """The page as text.

    ``best``: what is best of each task; ``equal``: what the ratio to the fastest means; ``summary``: sentences.
    """
    environment = Environment(
        loader=PackageLoader(__package__ or "", "templates"), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    return environment.get_template("bench.html").render(
        best=[shown for shown in best if shown.rows],
        speed_error=[speed_error.columns.tolist(), *speed_error.map(_text).to_numpy().tolist()],
        split=split.to_dict("records"),
        plots={name: Markup(plot.svg) for name, plot in plots.items()},  # ours, and made of escaped text
        info=info,
        fastest=speed_error[speed_error["engine"] == "analytic"]
        .groupby("task")["us_per_sample"]
        .min()
        .dropna()
        .to_dict(),
        equal=equal,
        summary=summary,
    )


def _text(value: object) -> str:
    if isinstance(value, float):
        return "" if pd.isna(value) else f"{value:.3g}"
    return str(value)
