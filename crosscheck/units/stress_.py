"""Hard cases: of each method in each case the worst outcome, and how far it is from what rounded inputs allow."""

from __future__ import annotations

import json
from collections.abc import Iterable
from functools import partial
from pathlib import Path

import numpy as np

from ...reports.checks import RANK
from ..engine import PLATFORM, REFERENCE, Failure
from ..hard import FORWARD, INVERSE, TimeCase, family_names, load_family
from ..outcome import ACCURATE, NEAR_SENSITIVITY, REFUSED, SILENT, quantities
from ..run import choose_engines
from ..stress import NATIVE, QUICK
from ..stress_time import QUANTITIES as IN_TIME
from ..stress_time import labels
from ..stress_work import methods
from ..unit import Key, Row, Unit, missing, read, row

ORDER = 3
SECONDS = 360.0
"""Six times what the longest family takes on two idle cores."""

ROUNDING = 10.0
"""Input sensitivities: exact methods were measured at a third of one in the median, and at 35 at most."""

ERROR, REFUSALS = "error / sensitivity", "refusals"
"""The error over the input sensitivity of the worst answer, and at how many values there was none."""

HALF = 0.5
"""Of a refusal: a first one counts as twice as many."""


def units() -> list[Unit]:
    """One for each family."""
    return [
        Unit(f"stress-{name}", ("stress", "--quick", "--family", name), SECONDS, partial(expected, name), checks)
        for name in family_names()
    ]


def _kind(quantity: str) -> str:
    if quantity in PLATFORM:
        return "accelerations"
    return "motion" if quantity in IN_TIME else "forces"


def _problem(route: str, kind: str) -> str:
    """Of the hard cases: what a route is asked for that answers with such quantities."""
    if kind == "motion":
        return "in time"
    return FORWARD if kind == "accelerations" or route.startswith(NATIVE) else INVERSE


def expected(family: str) -> Iterable[Key]:
    """Every method of every engine in every case, for each kind of quantity that it answers."""
    engines = {name: e for name, e in choose_engines([]).items() if name != REFERENCE and not isinstance(e, Failure)}
    for case in load_family(family):
        for name, engine in engines.items():  # methods of one that can not be imported are not known: `run` has rows
            if isinstance(case, TimeCase):
                found = [(route, "motion") for route in sorted(labels(case, name, engine, QUICK.every))]
            else:
                scene = case.at(case.values[-1]).scene
                found = [(m.route, _kind(quantity)) for m in methods(engine) for quantity in quantities(scene, m)]
            for route, kind in dict.fromkeys(found):
                yield Key(case.name, name, route, kind, ERROR)
                yield Key(case.name, name, route, kind, REFUSALS)


def checks(folder: Path) -> Iterable[Row]:
    """Rows for each method, case and kind of quantity: the worst of its answers, and how many it refused.

    The silence of an engine's own solver is its own; ours is a failure.  What an engine that failed never answered did
    not run.
    """
    failed = json.loads((folder / "run.json").read_text(encoding="utf-8"))["failed"]
    found, reasons = read(folder / "stress.csv"), read(folder / "reasons.csv")
    about = ["case", "value", "engine", "route", "problem"]
    why = reasons.drop_duplicates(about).set_index(about)["reason"].to_dict()
    found["rank"] = found["outcome"].map(RANK)
    found["off"] = found["max_rel_error"] / found["input_sensitivity"]
    found["kind"] = found["quantity"].map(_kind)
    found["problem"] = [_problem(*which) for which in zip(found["route"], found["kind"], strict=True)]
    by = ["case", "engine", "route", "kind"]
    for _, rows in found.groupby(by, sort=False):
        refused = rows["outcome"] == REFUSED
        answered = rows if refused.all() else rows[~refused]
        ranked = answered.sort_values(["rank", "off"], na_position="first", kind="stable")
        worst = ranked.iloc[0 if refused.all() else -1]  # the first value, at which most is expected of it
        outcome, case, engine, route, kind = (str(worst[name]) for name in ("outcome", *by))
        key = partial(Key, case, engine, route, kind)
        reason = why.get(tuple(worst[name] for name in about), "")
        if refused.all() and engine in failed:
            yield from (missing(key(quantity), reason) for quantity in (ERROR, REFUSALS))
            continue
        ours = not route.startswith(NATIVE)
        yield row(
            key(ERROR),
            float(worst["off"]),
            NEAR_SENSITIVITY if outcome == ACCURATE else np.nan,
            ROUNDING,
            "fail" if outcome == SILENT and ours else outcome,
            reason=reason,
            where=f"{worst['quantity']}, {worst['parameter']} = {worst['value']:g}",
        )
        yield row(key(REFUSALS), rows.loc[refused, "value"].nunique(), np.nan, HALF, "pass")
