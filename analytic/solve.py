"""The solve of (7), (8), of (32) or (35): arrays of samples with a condition test, or single numbers of any kind."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import numpy as np

from .stewart import Scalar, Vector

LIMIT = 1e12
"""Largest condition, and largest 1/s of a leg with spin inertia, that leaves digits in the answer.

Both multiply the rounding of float64 (1e-16): at 1e12 four digits are left.
"""


class SingularPose(ArithmeticError):
    """A pose whose driving forces cannot be computed: names sample and leg (from 1) and the number."""

    def __init__(self, sample: int, leg: int, name: str, value: float, limit: str) -> None:
        shown = value if abs(value) > 1e-100 else 0.0  # the formulas keep off zero by less than any float64 input
        super().__init__(f"sample {sample}, leg {leg}: {name} = {shown:.3g}, {limit}")
        self.sample, self.leg, self.name, self.value, self.limit = sample, leg, name, value, limit


class Infeasible(ArithmeticError):
    """A prescribed motion that no driving forces give: names the sample, the residual and its limit."""

    def __init__(self, sample: int, residual: float, limit: float) -> None:
        super().__init__(
            f"sample {sample}: the motion is infeasible: an equation of the platform holds no driving force, and what"
            f" it asks of the motion is missed by {residual:.6g} (N or N m), expected at most {limit:.2g}"
        )
        self.sample, self.residual, self.limit = sample, residual, limit


FEASIBLE = 1e-14
"""Largest residual of an equation without driving forces, over the weights and inertial forces that enter it.

Some ten roundings and their growth; a tenth of what comparisons of forces allow, so that it stays below their bar.
"""


def row_scaled(A: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Row lengths (nt, n) and 2-norm condition (nt,) of the matrices with rows of length 1."""
    length = np.linalg.norm(A, axis=2)
    length[length == 0.0] = 1.0
    return length, _condition(np.linalg.svd(A / length[..., None], compute_uv=False))


def _condition(sigma: np.ndarray) -> np.ndarray:
    with np.errstate(divide="ignore"):
        return sigma[:, 0] / np.abs(sigma[:, -1])  # LAPACK returns -0.0 too


def longest_lever(pins: Sequence[Vector]) -> float:
    """Largest distance of a pin from the platform's centre of mass [m]; 1 where all are in it, and no moment counts."""
    return max(math.hypot(*(float(x) for x in p)) for p in pins) or 1.0


def row_units(n: int, lever: float) -> np.ndarray:
    """What the platform's n equations are divided by: 1 for a force, the longest lever of a pin for a moment.

    One number for all moments: legs that meet in one point, or that are all square to an axis, leave whole rows small,
    and rows scaled one by one would hide that no force holds the platform there.
    """
    units = np.ones(n)
    units[3 if n == 6 else 2 :] = lever
    return units


def conditioned(A: np.ndarray, lever: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Platform's equations (nt, n, n) in `row_units`, their 2-norm condition (nt,), and the weakest leg (nt,).

    The weakest leg (from 1) has the largest share in the direction that no force holds.
    """
    scaled = A / row_units(A.shape[1], lever)[:, None]
    _, sigma, Vh = np.linalg.svd(scaled)
    return scaled, _condition(sigma), np.argmax(np.abs(Vh[:, -1]), axis=1) + 1


def without_vanishing_row(A: np.ndarray, condition: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Condition (nt,) of equations (nt, n, n) less a row of zeros, if there is one, and whether there is.

    A row vanishes exactly where the legs are exactly square to it, as two collinear ones are.  Two such rows leave
    more than one combination of driving forces free: their condition is infinite.
    """
    rank = (A != 0.0).any(axis=2).sum(axis=1)  # by the entries: a norm underflows
    short = rank == A.shape[1] - 1
    condition = condition.copy()
    if short.any():
        condition[short] = _condition(np.linalg.svd(A[short], compute_uv=False)[:, :-1])
    return condition, rank < A.shape[1]


def require_regular(condition: np.ndarray, leg: np.ndarray, first_sample: int = 0) -> None:
    """Raise SingularPose if a condition is above ``LIMIT``, or not a number."""
    worst = int(np.argmax(condition))
    if not condition[worst] <= LIMIT:
        limit = f"above {LIMIT:g}: the platform is in a parallel singularity"
        name = "condition of the platform's equations"
        raise SingularPose(first_sample + worst, int(leg[worst]), name, float(condition[worst]), limit)


def solve_samples(
    rows: Sequence[Sequence[np.ndarray]], right: Sequence[np.ndarray], lever: float, first_sample: int = 0
) -> tuple[list[np.ndarray], np.ndarray]:
    """Solve one 6 x 6 system per sample.

    Parameters
    ----------
    rows : six rows of six arrays, each (nt,): forces, then moments [m]
    right : six arrays, each (nt,)
    lever : longest lever of a pin on the platform [m], which moments are divided by.
    first_sample : number of the first sample, for the error message.

    Returns
    -------
    unknowns : six arrays (nt,)
    condition : ndarray, shape (nt,), of the matrix in `row_units`.

    Raises
    ------
    SingularPose
        Condition above ``LIMIT``.
    """
    A, condition, leg = conditioned(np.moveaxis(np.array(rows), -1, 0), lever)
    require_regular(condition, leg, first_sample)
    b = np.array(right).T / row_units(A.shape[1], lever)
    return list(_solve(A, b).T), condition


def _solve(A: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Solutions (nt, n) of regular systems, rows of length 1: the pivots that this gives leave less rounding."""
    length = np.linalg.norm(A, axis=2)
    return np.linalg.solve(A / length[..., None], (b / length)[..., None])[..., 0]


def solve_determined(
    rows: Sequence[Sequence[np.ndarray]],
    right: Sequence[np.ndarray],
    lever: float,
    size: np.ndarray,
    first_sample: int = 0,
) -> tuple[list[np.ndarray], np.ndarray, np.ndarray]:
    """As `solve_samples` for n rows of which one may vanish: the shortest vector that fulfils the others.

    ``size`` (nt,): weights and inertial forces of a sample [N], which rounding is measured by.

    Returns
    -------
    unknowns : n arrays (nt,)
    condition : ndarray, shape (nt,), of the rows that do not vanish.
    undetermined : ndarray of bool, shape (nt,)

    Raises
    ------
    SingularPose
        Condition above ``LIMIT``.
    Infeasible
        The right side of a row that vanishes is not zero.
    """
    A, condition, leg = conditioned(np.moveaxis(np.array(rows), -1, 0), lever)
    condition, undetermined = without_vanishing_row(A, condition)
    require_regular(condition, leg, first_sample)
    units = row_units(A.shape[1], lever)
    b = np.array(right).T / units
    residual = np.where((A == 0.0).all(axis=2), np.abs(b), 0.0)
    sample, row = (int(i) for i in np.unravel_index(int(np.argmax(residual - FEASIBLE * size[:, None])), b.shape))
    if residual[sample, row] > FEASIBLE * size[sample]:
        raise Infeasible(
            first_sample + sample,
            float(residual[sample, row] * units[row]),
            float(FEASIBLE * size[sample] * units[row]),
        )
    x = np.empty_like(b)
    x[~undetermined] = _solve(A[~undetermined], b[~undetermined])
    x[undetermined] = (np.linalg.pinv(A[undetermined]) @ b[undetermined, :, None])[..., 0]
    return list(x.T), condition, undetermined


Rows: TypeAlias = list[Any]
Ordered: TypeAlias = Callable[[int, Rows, Rows], tuple[Rows, Rows]]
"""``ordered(j, upper, lower)``: both rows, exchanged where the second has the larger number in column j."""


def ordered_numbers(j: int, upper: Rows, lower: Rows) -> tuple[Rows, Rows]:
    """`Ordered` of floats, or of balls by their midpoints."""
    return (lower, upper) if abs(float(lower[j])) > abs(float(upper[j])) else (upper, lower)


def ordered_arrays(j: int, upper: Rows, lower: Rows) -> tuple[Rows, Rows]:
    """`Ordered` of arrays, sample by sample, from column j on."""
    exchange = np.abs(lower[j]) > np.abs(upper[j])
    both = list(zip(upper[j:], lower[j:], strict=True))
    return [*upper[:j], *(np.where(exchange, b, a) for a, b in both)], [
        *lower[:j],
        *(np.where(exchange, a, b) for a, b in both),
    ]


def eliminate(
    rows: Sequence[Sequence[Scalar]], right: Sequence[Scalar], ordered: Ordered
) -> tuple[list[Scalar], Scalar]:
    """Gaussian elimination with partial pivoting for numbers of any kind: solution and, but for its sign, determinant.

    Raises
    ------
    ZeroDivisionError
        A pivot is zero (floats); arrays and balls return what is not finite instead.
    """
    M: list[Rows] = [[*row, b] for row, b in zip(rows, right, strict=True)]
    n = len(M)
    determinant: Any = 1.0
    for j in range(n):
        for i in range(j + 1, n):
            M[j], M[i] = ordered(j, M[j], M[i])
        determinant = determinant * M[j][j]
        for i in range(j + 1, n):
            factor = M[i][j] / M[j][j]
            M[i][j + 1 :] = [a - factor * b for a, b in zip(M[i][j + 1 :], M[j][j + 1 :], strict=True)]
    x: list[Any] = [None] * n
    for j in reversed(range(n)):
        b = M[j][n]
        for i in range(j + 1, n):
            b = b - M[j][i] * x[i]
        x[j] = b / M[j][j]
    return x, determinant


def eliminate_symmetric(rows: Sequence[Sequence[Scalar]], right: Sequence[Scalar]) -> tuple[list[Scalar], Scalar]:
    """Elimination without exchanges, of which a symmetric positive definite system needs none, for numbers of any kind.

    Entries above the diagonal are not read.  Returns the solution, and the determinant over the product of the
    diagonal: between 0 and 1, and small where rows are nearly dependent.
    """
    n = len(right)
    M, b = [list(row) for row in rows], list(right)
    share: Any = 1.0
    for j in range(n):
        share = share * (M[j][j] / rows[j][j])
        for i in range(j + 1, n):
            factor = M[i][j] / M[j][j]
            for k in range(j + 1, i + 1):
                M[i][k] = M[i][k] - factor * M[k][j]
            b[i] = b[i] - factor * b[j]
    x: list[Any] = [None] * n
    for j in reversed(range(n)):
        x[j] = b[j] / M[j][j]
        for i in range(j + 1, n):
            x[j] = x[j] - M[i][j] / M[j][j] * x[i]
    return x, share


def solve_numbers(rows: Sequence[Sequence[Scalar]], right: Sequence[Scalar]) -> list[Scalar]:
    """Solution of one system of floats or balls, by `eliminate`."""
    return eliminate(rows, right, ordered_numbers)[0]
