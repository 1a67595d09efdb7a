"""The linear solve of the route `kkt`: what it returns where a rank is missing, and what it refuses."""

from __future__ import annotations

import numpy as np
import pytest

from stewart_crosscheck.crosscheck import loop_forces
from stewart_crosscheck.crosscheck.engine import EngineError
from stewart_crosscheck.crosscheck.layout import Layout

NA, NC = 3, 6
NV = NA + NC
ACTUATED = [0, 3, 6]
LAYOUT = Layout(np.array([[1], [4], [7]]), np.array(ACTUATED), np.array([2, 5, 8]))
S = np.eye(NV)[:, ACTUATED]
BOTH = np.array([False, True])
"""Sample 0 determines its forces, sample 1 does not."""


def loops(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Random loop Jacobians (2, nc, nv); the last row of sample 1 does what the others and the actuators do.

    Second: the combination of driving forces that sample 1 leaves free.
    """
    J = rng.normal(size=(2, NC, NV))
    free, others = rng.normal(size=NA), rng.normal(size=NC - 1)
    J[1, -1] = S @ free + others @ J[1, :-1]
    return J, free


@pytest.mark.parametrize("seed", range(3))
def test_an_undetermined_sample_has_the_shortest_forces(seed: int) -> None:
    """Not the shortest solution: multipliers count for nothing."""
    rng = np.random.default_rng(seed)
    J, free = loops(rng)
    tau = np.einsum("ij,tj->ti", S, rng.normal(size=(2, NA))) + np.einsum("tij,ti->tj", J, rng.normal(size=(2, NC)))
    F, held = loop_forces.solve("x", tau, J, LAYOUT, BOTH)
    residual = np.einsum("ij,tj->ti", S, F) + np.einsum("tij,ti->tj", J, held) - tau
    assert np.abs(residual).max() < 1e-12  # numbers of order 10, condition below 1e2
    assert abs(F[1] @ free) < 1e-12  # the shortest on a line stands across it
    K = np.hstack([S, J[1].T])
    least = (np.linalg.pinv(K) @ tau[1])[:NA]
    assert abs(least @ free) > 1e-3  # the shortest solution has other forces: the line above can fail


def test_one_rank_is_missing_and_no_other_number() -> None:
    rng = np.random.default_rng(0)
    J, _ = loops(rng)
    tau = np.zeros((2, NV))
    with pytest.raises(EngineError, match=r"^x: sample 0: got rank 9, expected 8 of 9$"):
        loop_forces.solve("x", tau[:1], J[:1], LAYOUT, BOTH[1:])
    J[1, 1] = J[1, -1] = J[1, 0]
    with pytest.raises(EngineError, match=r"^x: sample 1: got rank 7, expected 8 of 9$"):
        loop_forces.solve("x", tau, J, LAYOUT, BOTH)


def test_a_motion_that_no_forces_give_is_refused() -> None:
    """A right side off the column space by 1e-8 of itself; rounding is 1e-15 and passes."""
    rng = np.random.default_rng(0)
    J, _ = loops(rng)
    K = np.hstack([S, J[1].T])
    tau = np.array([np.zeros(NV), K @ rng.normal(size=NV)])
    loop_forces.solve("x", tau, J, LAYOUT, BOTH)
    across = np.linalg.svd(K)[0][:, -1]
    tau[1] += 1e-8 * np.linalg.norm(tau[1]) * across
    with pytest.raises(EngineError, match=r"^x: sample 1: no forces give this motion: residual .*e-08 \(N or N m\)$"):
        loop_forces.solve("x", tau, J, LAYOUT, BOTH)


@pytest.mark.parametrize("flags", [[False, False, False], [True, False, False]])
def test_a_singular_sample_that_nobody_expected_is_named(flags: list[bool]) -> None:
    J, _ = loops(np.random.default_rng(0))
    J[1, 2] = 0.0
    J = np.vstack([J, J[:1]])
    with pytest.raises(
        EngineError, match=r"^x: sample 1: the loops' matrix is singular where the platform stands still$"
    ):
        loop_forces.solve("x", np.ones((3, NV)), J, LAYOUT, np.array(flags))


def test_the_solve_refuses_what_it_cannot_do() -> None:
    tau, J, determined = np.ones((2, 4)), np.zeros((2, 3, 4)), np.zeros(2, dtype=bool)
    one, two = (Layout(np.array([[1, 2]]), np.arange(n), np.array([3])) for n in (1, 2))
    with pytest.raises(EngineError, match=r"nv = 4, expected na \+ nc = 2 \+ 3"):
        loop_forces.solve("x", tau, J, two, determined)
    with pytest.raises(EngineError, match="tau is not finite at sample 1"):
        loop_forces.solve("x", np.array([[1.0] * 4, [1, np.inf, 1, 1]]), J, one, determined)
