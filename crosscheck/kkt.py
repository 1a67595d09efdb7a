"""The route `kkt`: an engine assembles its tree and its loops, one solve gives driving forces and loop multipliers.

The engine's own model file, mass matrix, bias, Jacobians and recursive Newton-Euler; ours is the linear solve alone.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from time import perf_counter
from typing import ClassVar, NamedTuple

import numpy as np

from ..models.scene import Scene
from . import wrench
from .engine import LOOPS, DynamicsResult, EngineError, ModelFacts, engine_version, require_finite
from .trajectory import Trajectory

BLOCK = 2000
"""Samples at a time: one block of matrices takes some 30 MB."""


RANK = 1e-12
"""Singular values below this share of the largest count as zero: rounding of the matrix is 1e-16."""

FEASIBLE = 1e-10
"""Residual of a singular system, over its right side or the weight of all bodies, that is still rounding.

A trajectory's own motion is feasible to 1e-14; what is above this is another model.
"""


class State(NamedTuple):
    """Generalized coordinates, velocities and accelerations in an engine's own order: (nt, nq), (nt, nv), (nt, nv)."""

    q: np.ndarray
    v: np.ndarray
    a: np.ndarray


class Terms(NamedTuple):
    """What an engine assembles for every sample.

    ``tau`` (nt, nv): M a + h less the load, N or N m.  ``J`` (nt, nc, nv): loop Jacobian, rows (rod's tip) -
    (platform's pin) along `Scene.loop_axes`.  ``gap, gap_acceleration`` (nt, N, 3): the same difference of positions
    and of accelerations, world axes.
    ``L, dL`` (nt, N): leg lengths and rates from the engine's positions and velocities.
    """

    tau: np.ndarray
    J: np.ndarray
    gap: np.ndarray
    gap_acceleration: np.ndarray
    L: np.ndarray
    dL: np.ndarray

    @classmethod
    def empty(cls, nt: int, nv: int, scene: Scene) -> Terms:
        """Arrays to fill."""
        N = scene.N
        shapes = ((nt, nv), (nt, scene.nc, nv), (nt, N, 3), (nt, N, 3), (nt, N), (nt, N))
        return cls(*(np.empty(shape) for shape in shapes))


class KktEngine(ABC):
    """An engine of the route `kkt`; a subclass loads its model and says what its engine assembles."""

    name: ClassVar[str]
    package: ClassVar[str]
    setting: ClassVar[str]
    route: ClassVar[str] = "kkt"
    checks: ClassVar[tuple[str, ...]] = (*LOOPS, "balance")
    inertia_floor: ClassVar[float] = 0.0
    """Smallest moment of inertia that the model's format has [kg m^2]: smaller ones are raised to it."""

    scene: Scene

    @abstractmethod
    def __init__(self, scene: Scene, models: Mapping[str, str] | None = None) -> None:
        """Load the model file; raise EngineError if it is not the scene's mechanism."""

    @abstractmethod
    def facts(self) -> ModelFacts:
        """What the loaded model holds."""

    @abstractmethod
    def velocity_index(self, coordinate: str) -> int:
        """Index of a joint coordinate among the velocities."""

    @abstractmethod
    def state(self, trajectory: Trajectory) -> State:
        """State of every sample in the engine's conventions."""

    @abstractmethod
    def terms(self, state: State) -> Terms:
        """Assemble every sample."""

    @abstractmethod
    def reactions(self, state: State, multipliers: np.ndarray) -> np.ndarray:
        """Wrenches (nt, tree joints, 6) of `scene.joints` that are not cut, given the loop forces (nt, N, 3)."""

    def require_nv(self, nv: int) -> None:
        """Raise EngineError unless the model has as many velocities as the scene."""
        if nv != self.scene.nv:
            raise EngineError(f"{self.name}: the model has nv = {nv}, the scene {self.scene.nv}")

    def inverse_dynamics(self, trajectory: Trajectory) -> DynamicsResult:
        """Driving forces, joint reactions and loop residuals. Raises EngineError, never returns half an answer."""
        start = perf_counter()
        state = self.state(trajectory)
        nt = len(state.q)
        require_finite(self.name, q=state.q, v=state.v, a=state.a)
        blocks = []
        for first in range(0, nt, BLOCK):
            try:
                part = slice(first, first + BLOCK)
                blocks.append(self._block(State(*(x[part] for x in state)), trajectory.undetermined[part]))
            except EngineError as e:
                raise EngineError(f"{e} (counted from sample {first})" if first else str(e)) from None
        F, reactions, L, dL, *gaps = (np.concatenate(column) for column in zip(*blocks, strict=True))
        loops: dict[str, np.ndarray] = {}
        loops.update(zip(LOOPS, gaps, strict=True))
        return DynamicsResult(
            engine=self.name,
            version=engine_version(type(self)) or "",
            route=self.route,
            setting=self.setting,
            samples=np.arange(nt),
            F=F,
            reactions=reactions,
            L=L,
            dL=dL,
            loops=loops,
            model=self.facts(),
            seconds=perf_counter() - start,
        )

    def _block(self, state: State, undetermined: np.ndarray) -> tuple[np.ndarray, ...]:
        """F, reactions, L, dL and the gaps at position, velocity and acceleration level of some samples."""
        terms = self.terms(state)
        joints = self.scene.joints
        actuated = [self.velocity_index(c) for j in joints if j.actuated for c in j.coordinates]
        weight = sum(body.mass for body in self.scene.bodies) * float(np.linalg.norm(self.scene.gravity))
        F, held = solve(self.name, terms.tau, terms.J, actuated, undetermined, weight)
        axes = list(self.scene.loop_axes)
        multipliers, gap_velocity = np.zeros_like(terms.gap), np.zeros_like(terms.gap)
        multipliers[..., axes] = held.reshape(len(F), -1, len(axes))
        gap_velocity[..., axes] = np.einsum("tij,tj->ti", terms.J, state.v).reshape(len(F), -1, len(axes))
        cut = np.array([j.cut for j in joints])
        reactions = np.empty((len(F), len(cut), 6))
        reactions[:, ~cut] = self.reactions(state, multipliers)
        reactions[:, cut] = wrench.of_loop(multipliers)
        return F, reactions, terms.L, terms.dL, terms.gap, gap_velocity, terms.gap_acceleration


def tree_facts(masses: Mapping[str, float], velocities: int, rows: int) -> ModelFacts:
    """Facts of a model read from the URDF: mass [kg] by the name of the body, or of its joint."""
    massless = [name for name, mass in masses.items() if mass == 0.0]
    floor = (f"links of zero mass, which URDF wants between two joints: {len(massless)}",) if massless else ()
    return ModelFacts(len(masses) - len(massless), len(massless), velocities, rows, sum(masses.values()), floor)


def solve(
    engine: str, tau: np.ndarray, J: np.ndarray, actuated: list[int], undetermined: np.ndarray, weight: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Solve [S J^T] [F; lambda] = tau for every sample.

    Parameters
    ----------
    engine : name, for errors.
    tau, J : ndarray, shapes (nt, nv), (nt, nc, nv)
        As in `Terms`.
    actuated : velocity index of each actuated joint.
    undetermined : ndarray of bool, shape (nt,)
        Samples whose matrix is expected to lack one rank: F is the shortest that the equations allow.
    weight : of all bodies [N], which may cancel in tau.

    Returns
    -------
    F : ndarray, shape (nt, na)
    multipliers : ndarray, shape (nt, nc)

    Raises
    ------
    EngineError
        nv is not na + nc, a term is not finite, the matrix is singular, or not as singular as expected, or no forces
        give the motion.
    """
    nt, nc, nv = J.shape
    na = len(actuated)
    if nv != na + nc:
        raise EngineError(f"{engine}: the model has nv = {nv}, expected na + nc = {na} + {nc}")
    require_finite(engine, tau=tau, J=J)
    K = np.zeros((nt, nv, nv))
    K[:, actuated, range(na)] = 1.0
    K[:, :, na:] = J.transpose(0, 2, 1)
    length = np.linalg.norm(K, axis=2, keepdims=True)  # rows of hinges are moments, rows of slides are forces
    length[length == 0.0] = 1.0
    K, b = K / length, tau / length[..., 0]
    x = np.empty_like(b)
    try:
        x[~undetermined] = np.linalg.solve(K[~undetermined], b[~undetermined, :, None])[..., 0]
    except np.linalg.LinAlgError:
        sign, _ = np.linalg.slogdet(K[~undetermined])  # the same factors: a pivot is zero
        sample = np.flatnonzero(~undetermined)[np.argmax(sign == 0.0)]
        raise EngineError(
            f"{engine}: sample {sample}: the {nv} x {nv} matrix of actuators and loops is singular"
        ) from None
    for k in np.flatnonzero(undetermined):
        x[k] = _shortest(engine, int(k), K[k], b[k], na, weight)
    require_finite(engine, forces=x)
    return x[:, :na], x[:, na:]


def _shortest(engine: str, sample: int, K: np.ndarray, b: np.ndarray, na: int, weight: float) -> np.ndarray:
    """Solution of a system of one rank too few with the shortest F. Raises EngineError."""
    U, sigma, Vh = np.linalg.svd(K)
    rank = int((sigma > RANK * sigma[0]).sum())
    if rank != len(b) - 1:
        raise EngineError(f"{engine}: sample {sample}: got rank {rank}, expected {len(b) - 1} of {len(b)}")
    x = Vh[:rank].T @ ((U.T @ b)[:rank] / sigma[:rank])
    residual = float(np.abs(K @ x - b).max())
    if residual > FEASIBLE * max(np.abs(b).max(), weight):
        raise EngineError(f"{engine}: sample {sample}: no forces give this motion: residual {residual:.6g} (N or N m)")
    free = Vh[rank]
    return x - free * (free[:na] @ x[:na]) / (free[:na] @ free[:na])
