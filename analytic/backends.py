"""Back ends: the one text of the formulas on arrays, on plain floats, or compiled.  Each fills the same rows."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Protocol

import numpy as np

from .compiled import Compiled
from .evaluate import REGULAR, Mechanism, lever_unit, regular_numbers, rows, slots
from .registers import NumPy
from .samples import PlatformMotion
from .solve import ordered_numbers


class BackEnd(Protocol):
    """Inverse dynamics of a machine."""

    size: int
    """Most samples at a time."""

    def fill(self, motion: PlatformMotion, numbers: np.ndarray) -> bool:
        """Write `slots` of n samples into their rows of ``numbers`` (rows, n); whether all are beyond doubt.

        ``motion``: arrays (n, 3) and (n, 3, 3).  What is not finite makes doubt, and so does what is not regular.
        """
        ...


class Floats:
    """Plain floats, sample by sample: the fastest for one, and without any library."""

    size = 1

    def __init__(self, P: Mechanism, every: bool) -> None:
        self.P, self.every, self.unit = P, every, lever_unit(P)
        self.rows = rows(slots(P, every), len(P.p))

    def fill(self, motion: PlatformMotion, numbers: np.ndarray) -> bool:
        """One sample."""
        one = PlatformMotion(*(a[0].tolist() for a in motion))
        try:
            out, regularity = regular_numbers(self.P, one, math.sqrt, ordered_numbers, self.unit, self.every)
        except (ZeroDivisionError, OverflowError):
            return False
        numbers[self.rows, 0] = out
        return regularity >= REGULAR and all(map(math.isfinite, out))


BACKENDS: dict[str, Callable[[Mechanism, bool], BackEnd]] = {"numpy": NumPy, "float": Floats, "compiled": Compiled}


@functools.lru_cache(maxsize=64)
def back_end(name: str, P: Mechanism, every: bool) -> BackEnd:
    """A back end by its name, for a machine. Raises ValueError."""
    if name not in BACKENDS:
        raise ValueError(f"backend: got {name!r}, expected one of {', '.join(BACKENDS)}")
    return BACKENDS[name](P, every)
