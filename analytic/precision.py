"""The same text on numbers of more digits: long double, and balls of any precision."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, is_dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from .evaluate import DRIVING_FORCES, Mechanism
from .samples import checked
from .solve import Ordered, ordered_arrays, ordered_numbers
from .stewart import PlatformMotion, Scalar, Sqrt


class Kind(NamedTuple):
    """A kind of number: made from a float or an array, its square root, its order; whether samples go one by one."""

    made: Callable[[Any], Scalar]
    sqrt: Sqrt
    ordered: Ordered
    single: bool


def _ball(x: float) -> Any:
    from flint import arb

    return arb(x)


KINDS = {
    "long double": Kind(np.longdouble, np.sqrt, ordered_arrays, single=False),
    "ball": Kind(_ball, lambda x: x.sqrt(), ordered_numbers, single=True),
}
"""Kinds by name; balls have the precision of python-flint's context."""


def _of_kind(made: Callable[[Any], Any], x: Any) -> Any:
    """Every number in nested tuples and parameters."""
    if isinstance(x, tuple):
        values = [_of_kind(made, v) for v in x]
        return type(x)(*values) if hasattr(x, "_fields") else tuple(values)
    if is_dataclass(x) and not isinstance(x, type):
        return replace(x, **{f.name: _of_kind(made, getattr(x, f.name)) for f in fields(x)})
    return x if x is None else made(x)


def precise_driving_forces(P: Mechanism, motion: PlatformMotion, kind: str) -> np.ndarray:
    """Driving forces in numbers of one of `KINDS`, without a test for singular poses.

    Returns (nt, N) of that kind, in N, + extends the leg; balls as an array of objects.
    """
    made, sqrt, ordered, single = KINDS[kind]
    Q = _of_kind(made, P)
    columns = np.hstack([np.reshape(a, (len(a), -1)) for a in checked(motion)])
    if not single:
        return np.array(DRIVING_FORCES.evaluate(Q, list(made(columns.T)), sqrt, ordered)[0]).T
    rows = [[made(float(x)) for x in row] for row in columns]
    return np.array([DRIVING_FORCES.evaluate(Q, row, sqrt, ordered)[0] for row in rows], dtype=object)
