"""The route `native`: an engine gets certified driving forces at a state and answers with its own loop solver.

No engine solves the hard system ``M a + h = tau + J^T lambda, J a + dJ v = 0``: one softens it, one iterates, one takes
a step in time.  What each of them solves differs from it by a known defect, and the response of the hard system to that
defect is the law of the engine's error: a vector for every sample, not a constant.  The defect is taken at the hard
system's own solution, so that an answer does not widen the law that it is held to.
"""

from __future__ import annotations

from abc import abstractmethod
from time import perf_counter
from typing import ClassVar, NamedTuple

import numpy as np

from ..analytic.solve import LIMIT
from .digits import require_hinges, require_legs
from .engine import DynamicsResult, EngineError, Law, engine_version, require_finite
from .kkt import KktEngine, State, Terms, in_blocks
from .layout import Layout
from .trajectory import Trajectory

CLOSED = 1e-9
"""Gap of a loop, over the leg, and its rate, over the speeds that add up in it, which is still a closed one: rounding
is below 1e-14, and a solver would pull a loop together that is open by more."""


SUSPECT = 1e10
"""Largest diagonal entry over the smallest pivot, which is no more than the condition, and less by a few hundreds."""


class Free(NamedTuple):
    """What the hard system is made of: M a + h = S F + J^T lambda, J a + drift = 0.

    ``M`` (nt, nv, nv): the engine's mass matrix.  ``h`` (nt, nv): its bias less the load.  ``J`` (nt, nc, nv) as in
    `Assembly`; ``drift`` (nt, nc): dJ v.
    """

    M: np.ndarray
    h: np.ndarray
    J: np.ndarray
    drift: np.ndarray


class Hard(NamedTuple):
    """The hard system's solution, from an engine's own matrices.

    ``M`` (nt, nv, nv): mass matrix.  ``A`` (nt, nc, nc): `mobility`, and its ``condition`` (nt,).  ``a`` (nt, nv):
    accelerations.  ``multipliers`` (nt, nc): forces on the rods' tips along `Scene.loop_axes`, loop by loop.
    """

    M: np.ndarray
    A: np.ndarray
    condition: np.ndarray
    a: np.ndarray
    multipliers: np.ndarray


class Answer(NamedTuple):
    """What an engine's solver answers, and what it is known to leave undone.

    ``a`` (nt, nv): accelerations.  ``loop_forces`` (nt, N, 3): on the rods' tips, world axes.  ``force_defect``
    (nt, nv), that is M a + h - tau - J^T lambda, and ``closure_defect`` (nt, nc), that is J a + dJ v: as far as the
    solver's method predicts them from the hard system, never from ``a`` and ``loop_forces``.  ``condition``: what
    rounding is multiplied by in the solver, beside the condition of `mobility`.  ``valid`` (nt,): where
    the defects are what they are said to be.
    """

    a: np.ndarray
    loop_forces: np.ndarray
    force_defect: np.ndarray
    closure_defect: np.ndarray
    condition: float = 1.0
    valid: np.ndarray | bool = True


class SolverEngine(KktEngine):
    """An engine that assembles loops and also solves them itself; a subclass sets up its solver and states its law."""

    forward_route: ClassVar[str] = "native"
    law: ClassVar[Law]

    @property
    @abstractmethod
    def forward_setting(self) -> str:
        """The solver's name and what it was set to."""

    @abstractmethod
    def answer(self, state: State, terms: Terms, F: np.ndarray, hard: Hard) -> Answer:
        """Solve every sample under driving forces (nt, na); `terms` are those of zero accelerations, as in `hard`."""

    @abstractmethod
    def own_solution(self, state: State, F: np.ndarray) -> np.ndarray:
        """Accelerations (nt, nv) by the engine's own solver alone; `solved` looks at both ends of it."""

    @abstractmethod
    def platform_acceleration(self, trajectory: Trajectory, a: np.ndarray) -> np.ndarray:
        """Acceleration and angular acceleration (nt, 6) of the platform, world axes, from accelerations (nt, nv)."""

    @abstractmethod
    def free(self, state: State) -> Free:
        """Assemble the hard system of every sample; accelerations are not read."""

    def solved(self, state: State, F: np.ndarray) -> np.ndarray:
        """Accelerations (nt, nv) under driving forces (nt, na) by the engine's own solver, as its knobs are set.

        Raises EngineError, also for an answer that is not finite.
        """
        a = self.own_solution(state, F)
        require_finite(self.name, a=a)
        return a

    def accelerate(self, state: State, F: np.ndarray) -> np.ndarray:
        """Accelerations (nt, nv) under driving forces (nt, na): hard loops. Raises EngineError where it has none."""
        a = in_blocks(lambda state, F: self._responded(self.free(state), F), state, F)[0]
        require_finite(self.name, a=a)
        return a

    def hard(self, state: State, F: np.ndarray) -> Hard:
        """Solution of the hard system under driving forces (nt, na). Raises EngineError where it has none."""
        free = self.free(state)
        a, multipliers, A = self._responded(free, F)
        return Hard(free.M, A, condition(A), a, multipliers)

    def _responded(self, free: Free, F: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Accelerations, multipliers and mobility."""
        self._require_turning(free)
        force = -free.h
        force[:, self.layout.actuated] += F
        try:
            inverse = np.linalg.solve(free.M, np.concatenate([free.J.transpose(0, 2, 1), force[..., None]], axis=2))
        except np.linalg.LinAlgError:
            sample = int(np.argmax(np.linalg.slogdet(free.M)[0] == 0.0))
            raise EngineError(f"{self.name}: sample {sample}: the mass matrix is singular") from None
        A = free.J @ inverse[..., :-1]
        singular = np.flatnonzero(~(nearly_singular(A) < 1.0 / np.finfo(float).eps))
        if len(singular):
            raise EngineError(
                f"{self.name}: sample {singular[0]}: the loops' matrix J M^-1 J^T is singular: masses or moments of"
                " inertia are too unequal for float64"
            )
        own = inverse[..., -1:]
        multipliers = np.linalg.solve(A, -free.drift[..., None] - free.J @ own)
        return (own + inverse[..., :-1] @ multipliers)[..., 0], multipliers[..., 0], A

    def _require_turning(self, free: Free) -> None:
        """Raise EngineError where a leg is so short or steep that what turns it about its base's axis is rounding."""
        squares, inertia = np.einsum("tij,tij->tj", free.J, free.J), np.einsum("tii->ti", free.M)
        if not squares.min() * LIMIT**2 >= squares.max():  # cheaper than to look at each leg
            require_finite(self.name, J=free.J)
            require_legs(self.name, np.sqrt(squares), self.layout)
        if not inertia.min() * LIMIT >= inertia.max():
            require_finite(self.name, M=free.M)
            require_hinges(self.name, "inertia about o over that about n", inertia, self.layout)

    def forward_dynamics(self, trajectory: Trajectory, F: np.ndarray) -> DynamicsResult:
        """Accelerations and joint reactions under driving forces (nt, N), and their law. Raises EngineError."""
        start = perf_counter()
        known = self.state(trajectory)
        state = State(known.q, known.v, np.zeros_like(known.a))  # accelerations are what is asked
        require_finite(self.name, q=state.q, v=state.v, F=F)
        terms = self.terms(state)
        require_closed(self.name, terms, state.v)
        hard = self.hard(state, F)
        answer = self.answer(state, terms, F, hard)
        require_finite(self.name, a=answer.a, loop_forces=answer.loop_forces)
        axes = list(self.scene.loop_axes)
        da, dl = response(hard.M, terms.J, hard.A, answer.force_defect, answer.closure_defect)
        loop_error = np.zeros_like(answer.loop_forces)
        loop_error[..., axes] = dl.reshape(len(dl), -1, len(axes))
        reactions = self.joint_reactions(state._replace(a=answer.a), answer.loop_forces)
        platform = self.platform_acceleration(trajectory, answer.a)
        return DynamicsResult(
            engine=self.name,
            version=engine_version(type(self)) or "",
            route=self.forward_route,
            setting=self.forward_setting,
            samples=np.arange(len(F)),
            F=F,
            reactions=reactions,
            L=terms.L,
            dL=terms.dL,
            platform=platform,
            law=self.law,
            amplification=answer.condition,
            valid=answer.valid,
            mobility=hard.condition,
            predicted={  # both are affine in what the solver answers
                "reactions": self.joint_reactions(state._replace(a=answer.a + da), answer.loop_forces + loop_error)
                - reactions,
                "platform": self.platform_acceleration(trajectory, answer.a + da) - platform,
            },
            seconds=perf_counter() - start,
        )


def growth_of_rounding(free: Free, v: np.ndarray, layout: Layout) -> np.ndarray:
    """What rounding of the mass matrices is multiplied by in accelerations, leg by leg (nt, N), at least 1.

    Inertia about the base's axis o is left over from turning that about n, and so is what q_o'^2 is multiplied by; the
    tip moves with o by sin q_n of what it moves with n. Measured against accelerations of 1 rad/s^2. A planar leg has
    no base.
    """
    if layout.passive.shape[1] < 2:
        return np.ones((len(v), len(layout.passive)))
    o, n = np.einsum("tii->ti", free.M)[:, layout.passive].transpose(2, 0, 1)
    by_o, by_n = np.einsum("tij,tij->tj", free.J, free.J)[:, layout.passive].transpose(2, 0, 1)
    with np.errstate(all="ignore"):
        return np.maximum(1.0, (1.0 + np.sqrt(by_o / by_n) * v[:, layout.passive[:, 0]] ** 2) * n / o)


def in_plane(a: np.ndarray) -> np.ndarray:
    """Acceleration and angular acceleration (nt, 6) of a platform with coordinates x, y and, unless a point, a turn."""
    out = np.zeros((len(a), 6))
    out[:, [0, 1, 5][: a.shape[1]]] = a
    return out


def require_closed(engine: str, terms: Terms, v: np.ndarray) -> None:
    """Raise EngineError unless every loop is closed, and stays so at these velocities."""
    gap = np.linalg.norm(terms.gap, axis=2)
    rate = np.abs(np.einsum("tij,tj->ti", terms.J, v)).reshape(*gap.shape, -1).max(axis=2)
    speeds = np.einsum("tij,tj->ti", np.abs(terms.J), np.abs(v)).max(axis=1, keepdims=True)
    for what, open_by, allowed in (("m", gap, CLOSED * terms.L), ("m/s", rate, CLOSED * speeds)):
        require_shut(engine, open_by, allowed, what)


def require_shut(engine: str, open_by: np.ndarray, allowed: np.ndarray, unit: str) -> None:
    """Raise EngineError that names sample and leg if a loop is open (nt, N) by more than allowed, or by a NaN."""
    wrong = np.argwhere(~(open_by <= allowed))
    if len(wrong):
        sample, leg = wrong[0].tolist()
        raise EngineError(
            f"{engine}: sample {sample}: the loop of leg {leg + 1} is open by {open_by[sample, leg]:.3g} {unit} in the"
            " engine's model, expected a closed one"
        )


def mobility(M: np.ndarray, J: np.ndarray) -> np.ndarray:
    """J M^-1 J^T (nt, nc, nc), 1/kg: accelerations of the loops' gaps per loop force."""
    return J @ np.linalg.solve(M, J.transpose(0, 2, 1))


def condition(A: np.ndarray) -> np.ndarray:
    """2-norm condition (nt,) of symmetric matrices (nt, n, n); infinite where a number is not finite."""
    finite = np.isfinite(A).all(axis=(1, 2))
    out = np.full(len(A), np.inf)
    if finite.any():
        out[finite] = np.linalg.cond(A[finite])
    return out


def nearly_singular(A: np.ndarray) -> np.ndarray:
    """Condition (nt,) where the pivots of Cholesky's factors let it be large, infinite without any, 1 elsewhere."""
    out = np.ones(len(A))
    try:
        pivots = np.einsum("tii->ti", np.linalg.cholesky(A)) ** 2
        suspect = ~(np.einsum("tii->ti", A).max(axis=1) < SUSPECT * pivots.min(axis=1))
    except np.linalg.LinAlgError:
        suspect = np.ones(len(A), dtype=bool)
    for k in np.flatnonzero(suspect):
        least, *_, largest = np.linalg.eigvalsh(A[k]) if np.isfinite(A[k]).all() else (0.0, 0.0)
        out[k] = largest / least if least > 0.0 else np.inf
    return out


def response(
    M: np.ndarray, J: np.ndarray, A: np.ndarray, force: np.ndarray, closure: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Change of accelerations (nt, nv) and multipliers (nt, nc) of the hard system by defects (nt, nv), (nt, nc).

    Solves ``M da = J^T dl + force`` and ``J da = closure``; A is the `mobility`.
    """
    free = np.linalg.solve(M, force[..., None])
    dl = np.linalg.solve(A, closure[..., None] - J @ free)
    da = free + np.linalg.solve(M, J.transpose(0, 2, 1) @ dl)
    return da[..., 0], dl[..., 0]
