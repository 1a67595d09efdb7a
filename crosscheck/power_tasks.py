"""Rows of the table of detection power, made in the process of an engine: a few faults at a time."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from .engine import load_engine, routes
from .power_faults import Nothing, Number, Term, coordinates, coordinates_and_forces, sizes
from .power_mistakes import Mistake
from .power_parameters import parameters
from .power_terms import Site, terms
from .power_work import FORMULAS, NOTHING, Seen, Smallest, place_of, seen, smallest

DETECTED, BLIND, NOT_RUN = "detected", "blind", "not run"
"""Verdicts: a fault is seen; none of at most 100 % is; nothing evaluates it, or its engine did not run."""

SIGN = -2.0
"""A fault of a term that changes its sign."""

COLUMNS = [
    "kind", "group", "fault", "where", "scene", "command", "engine", "route", "smallest", "missed", "share_of",
    "error_over_tolerance", "seen_by", "verdict", "reason",
]  # fmt: skip

NOWHERE = "evaluated by `stress`, or over time by `simulate`: not looked at here"

Row = dict[str, Any]


class Survey(NamedTuple):
    """What an engine's rows are without a fault, by route, and what the formulas work out on the scene.

    ``reached``: terms that the engine's answers come from, ``shared``: those of every engine's joint coordinates,
    ``zero``: those that are zero at every sample.
    """

    right: dict[str, Seen]
    reached: frozenset[int] = frozenset()
    shared: frozenset[int] = frozenset()
    zero: frozenset[int] = frozenset()


def row(kind: str, number: int, group: str, fault: str, **more: Any) -> Row:
    """A row of the table; what is not known of it is empty. ``number``: place of the fault among those of its kind."""
    found: Row = {name: math.nan if name in ("smallest", "missed", "error_over_tolerance") else "" for name in COLUMNS}
    return found | {"kind": kind, "number": number, "group": group, "fault": fault, "verdict": NOT_RUN} | more


def _bracket(found: Smallest) -> Row:
    """Columns that a search gives."""
    verdict = BLIND if math.isnan(found.detected) else DETECTED
    return {
        "smallest": found.detected, "missed": found.missed, "seen_by": found.seen_by, "verdict": verdict,
        "reason": found.reason,
    }  # fmt: skip


def _one(now: Seen, right: str) -> Row:
    """Columns of a fault of one size; ``right``: digest of the answer without it."""
    reason = now.refused
    if not now.detected:
        reason = NOTHING if now.digest == right else "within what is allowed"
    by = now.quantity if now.detected else ""
    share = math.nan if math.isinf(now.share) else now.share
    return {
        "error_over_tolerance": share, "seen_by": by, "verdict": DETECTED if now.detected else BLIND, "reason": reason,
    }  # fmt: skip


def survey(path: Path, engine: str) -> Survey:
    """What is right, and, of the formulas, which terms are worked out."""
    place = place_of(path)
    right = {route: seen(place, engine, route, Nothing(), 0.0) for route in routes(load_engine(engine))}
    if engine != FORMULAS:
        return Survey(right)
    values = sizes(place)
    zero = frozenset(k for k, largest in values.items() if largest == 0.0)
    return Survey(right, frozenset(coordinates_and_forces(place)), frozenset(coordinates(place)), zero)


def of_parameters(path: Path, engine: str, items: Sequence[int], right: Mapping[str, str]) -> list[Row]:
    """The smallest fault of each number, on each route of an engine; ``right``: digests as for `of_terms`."""
    place = place_of(path)
    every = parameters(place.scene)
    rows = []
    for number in items:
        item = every[number]
        for route in routes(load_engine(engine)):
            found = smallest(functools.partial(seen, place, engine, route, Number(item)), right[route])
            rows.append(
                row(
                    "parameter", number, item.group, item.name, scene=place.scene.name, command="run", engine=engine,
                    route=route, share_of=item.share_of, **_bracket(found),
                )
            )  # fmt: skip
    return rows


def where(site: Site) -> str:
    """Function, line and equation of a term."""
    return f"{site.function}:{site.line} {site.equation}".strip()


def of_terms(path: Path, engine: str, items: Sequence[int], right: str, zero: frozenset[int]) -> list[Row]:
    """The smallest fault of each term, and of its sign, in the rows of inverse dynamics of an engine.

    ``right``: digest of what it answers without a fault; ``zero``: terms that are zero throughout.
    """
    place, route = place_of(path), load_engine(engine).route
    more = {"scene": place.scene.name, "command": "run", "engine": engine, "route": route}
    rows = []
    for number in items:
        found = two_rows(number, functools.partial(seen, place, engine, route, Term(number)), right, more)
        if number in zero:
            found = [r | {"reason": "the term is zero in this scene"} if r["verdict"] == BLIND else r for r in found]
        rows += found
    return rows


def two_rows(number: int, look: Callable[[float], Seen], right: str, more: Row) -> list[Row]:
    """Rows of a term and of its sign."""
    site = terms()[number]
    more = more | {"where": where(site)}
    found = _bracket(smallest(look, right))
    other = _one(look(SIGN), right)
    if other["verdict"] == BLIND and found["verdict"] == DETECTED:
        other["reason"] = "its square alone counts"
    return [
        row("term", number, site.function, site.text, share_of="itself", **more, **found),
        row("sign", number, site.function, site.text, **more, **other),
    ]


def nobody(number: int) -> Row:
    """Row of a term that no command evaluates here."""
    site = terms()[number]
    return row("term", number, site.function, site.text, where=where(site), reason=NOWHERE)


def of_mistakes(path: Path, engine: str, items: Sequence[int], mistakes: Sequence[Mistake]) -> list[Row]:
    """Each mistake in the rows of inverse dynamics of an engine."""
    place, route = place_of(path), load_engine(engine).route
    right = seen(place, engine, route, Nothing(), 0.0).digest
    rows = []
    for k in items:
        m = mistakes[k]
        found = _one(seen(place, engine, route, m, 1.0), right)
        rows.append(
            row(
                "mistake", k, m.code, m.name, where=f"{m.function} {m.states}", scene=place.scene.name, command="run",
                engine=engine, route=route, **found,
            )
        )  # fmt: skip
    return rows
