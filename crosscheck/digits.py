"""What float64 leaves of an answer: refusals by an engine's own matrices, which name sample, leg, number and limit."""

from __future__ import annotations

import numpy as np

from ..analytic.solve import LIMIT, SingularPose, conditioned
from .engine import EngineError
from .layout import Layout


def require_legs(engine: str, length: np.ndarray, layout: Layout, named: np.ndarray | None = None) -> None:
    """Raise EngineError if a leg has hardly any length, or is too steep.

    ``length`` (nt, nv): of columns of J. Tips turn about o by L sin q_n, about n by L.  ``named`` (nt,): numbers of the
    samples, by default from zero.
    """
    L = length[:, layout.passive[:, -1]] / layout.lever
    _require_share(engine, "length over the longest lever", L, named, "its direction has no digits")
    require_hinges(engine, "sin q_n", length, layout, named)


def require_hinges(engine: str, name: str, size: np.ndarray, layout: Layout, named: np.ndarray | None = None) -> None:
    """Raise EngineError if a leg is so steep that its base hinge is lost in the rounding of its guide's.

    ``size`` (nt, nv): something of every velocity, and the ``name`` of its ratio.
    """
    if layout.passive.shape[1] < 2:
        return
    o, n = size[:, layout.passive].transpose(2, 0, 1)
    share = np.divide(o, n, out=np.ones_like(o), where=n > 0.0)
    _require_share(engine, name, share, named, "the leg is vertical, and its base angle has no digits")


def _require_share(engine: str, name: str, share: np.ndarray, named: np.ndarray | None, why: str) -> None:
    """Raise EngineError if the least share (nt, N) of a leg is lost in rounding."""
    sample, leg = (int(i) for i in np.unravel_index(int(np.argmin(share)), share.shape))
    if not share[sample, leg] * LIMIT >= 1.0:
        limit = f"expected at least {1.0 / LIMIT:g}: {why}"
        raise _singular(engine, sample, leg, named, name, share[sample, leg], limit)


def require_held(engine: str, J: np.ndarray, layout: Layout, named: np.ndarray) -> None:
    """Raise EngineError if the platform's equations have a condition above `LIMIT`.

    ``J`` (nt, nc, nv): loop Jacobians of the samples ``named`` (nt,).
    """
    legs = np.setdiff1d(np.arange(J.shape[2]), layout.platform)
    try:  # the slides' rates as closed loops give them from the platform's velocity are -A^T
        rates = np.linalg.solve(J[..., legs], J[..., layout.platform])
    except np.linalg.LinAlgError:
        sample = named[np.argmax(np.linalg.slogdet(J[..., legs])[0] == 0.0)]
        raise EngineError(
            f"{engine}: sample {sample}: the loops' matrix is singular where the platform stands still"
        ) from None
    A = rates[:, np.searchsorted(legs, layout.actuated)].transpose(0, 2, 1)
    _, condition, leg = conditioned(A, layout.lever)
    worst = int(np.argmax(condition))
    if not condition[worst] <= LIMIT:
        limit = f"expected at most {LIMIT:g}: the platform is in a parallel singularity"
        name = "condition of the platform's equations"
        raise _singular(engine, worst, int(leg[worst]) - 1, named, name, condition[worst], limit)


def _singular(
    engine: str, sample: int, leg: int, named: np.ndarray | None, name: str, value: float, limit: str
) -> EngineError:
    number = sample if named is None else int(named[sample])
    return EngineError(f"{engine}: {SingularPose(number, leg + 1, name, float(value), limit)}")
