"""The route `kkt`: an engine assembles its tree and its loops, one solve gives driving forces and loop multipliers.

The engine's own model file, mass matrix, bias, Jacobians and recursive Newton-Euler; ours is the linear solve alone.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from functools import cached_property
from time import perf_counter
from typing import ClassVar, NamedTuple

import numpy as np

from ..models.scene import Joint, Scene
from . import wrench
from .engine import LOOPS, DynamicsResult, EngineError, ModelFacts, engine_version, require_finite
from .layout import Layout
from .loop_forces import forces
from .trajectory import Trajectory

BLOCK = 200
"""Samples at a time: their matrices stay in the cache."""


class State(NamedTuple):
    """Generalized coordinates, velocities and accelerations in an engine's own order: (nt, nq), (nt, nv), (nt, nv)."""

    q: np.ndarray
    v: np.ndarray
    a: np.ndarray


class Assembly(NamedTuple):
    """What an engine assembles for the solve.

    ``tau`` (nt, nv): M a + h less the load, N or N m.  ``J`` (nt, nc, nv): loop Jacobian, rows (rod's tip) -
    (platform's pin) along `Scene.loop_axes`.  ``tree`` (nt, nl, 6): wrenches of `scene.joints` that are not cut, as if
    no loop held a force; ``lever`` (nt, nl, 3): from each one's point to its rod's tip, world axes.
    """

    tau: np.ndarray
    J: np.ndarray
    tree: np.ndarray = np.empty(0)
    lever: np.ndarray = np.empty(0)


class Loops(NamedTuple):
    """What an engine's own model says of the loops.

    ``gap, gap_acceleration`` (nt, N, 3): difference (rod's tip) - (platform's pin) of positions and of accelerations,
    world axes.  ``L, dL`` (nt, N): leg lengths and rates from the engine's positions and velocities.
    """

    gap: np.ndarray
    gap_acceleration: np.ndarray
    L: np.ndarray
    dL: np.ndarray

    @classmethod
    def empty(cls, nt: int, N: int) -> Loops:
        """Arrays to fill."""
        return cls(*(np.empty(shape) for shape in ((nt, N, 3), (nt, N, 3), (nt, N), (nt, N))))


class Terms(NamedTuple):
    """`Assembly` and `Loops` side by side."""

    tau: np.ndarray
    J: np.ndarray
    gap: np.ndarray
    gap_acceleration: np.ndarray
    L: np.ndarray
    dL: np.ndarray


class KktEngine(ABC):
    """An engine of the route `kkt`; a subclass loads its model and says what its engine assembles."""

    name: ClassVar[str]
    package: ClassVar[str]
    setting: ClassVar[str]
    route: ClassVar[str] = "kkt"
    checks: ClassVar[tuple[str, ...]] = (*LOOPS, "balance")
    inertia_floor: ClassVar[float] = 0.0
    """Smallest moment of inertia that the model's format has [kg m^2]: smaller ones are raised to it."""
    turns_first: ClassVar[bool] = False
    """Whether the angular velocities of a free joint stand before the linear ones."""

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
    def assemble(self, state: State, with_tree: bool = False) -> Assembly:
        """What the solve needs of every sample, and the wrenches of the open tree if they are asked for."""

    @abstractmethod
    def gaps(self, state: State) -> Loops:
        """Gaps of the loops and lengths of the legs of every sample."""

    def terms(self, state: State) -> Terms:
        """Both, without the wrenches."""
        tau, J, *_ = self.assemble(state)
        return Terms(tau, J, *self.gaps(state))

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
        F, reactions, L, dL, *gaps = in_blocks(self._block, state, trajectory.undetermined)
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

    def driving_forces(self, state: State, undetermined: np.ndarray | None = None) -> np.ndarray:
        """F (nt, na) [N] and nothing else. `undetermined` (nt,): as in `solve`, by default no sample is."""

        def answer(state: State, undetermined: np.ndarray) -> tuple[np.ndarray, ...]:
            return self._held(self.assemble(state), undetermined)

        return in_blocks(answer, state, _flags(state, undetermined))[0]

    def all_reactions(self, state: State, undetermined: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """F (nt, na) and the wrenches (nt, nj, 6) of `scene.joints`, likewise."""

        def answer(state: State, undetermined: np.ndarray) -> tuple[np.ndarray, ...]:
            assembly = self.assemble(state, with_tree=True)
            F, loop_forces = self._held(assembly, undetermined)
            return F, self._carried(assembly, loop_forces)

        F, reactions = in_blocks(answer, state, _flags(state, undetermined))
        return F, reactions

    def joint_reactions(self, state: State, loop_forces: np.ndarray) -> np.ndarray:
        """Wrenches (nt, nj, 6) of `scene.joints` at given accelerations and loop forces (nt, N, 3)."""
        return self._carried(self.assemble(state, with_tree=True), loop_forces)

    @cached_property
    def layout(self) -> Layout:
        """Whose velocity is which."""
        index = {name: self.velocity_index(name) for name in self.scene.coordinates}
        return Layout.of(self.scene, index, self.turns_first)

    @cached_property
    def tree_joints(self) -> list[Joint]:
        """Joints that are not cut."""
        return [j for j in self.scene.joints if not j.cut]

    @cached_property
    def tree_legs(self) -> list[int]:
        """Leg of each of them, from 0."""
        return [j.leg - 1 for j in self.tree_joints]

    @cached_property
    def _cut(self) -> np.ndarray:
        """Which joints are cut."""
        return np.array([j.cut for j in self.scene.joints])

    @cached_property
    def _weight(self) -> float:
        """Of all bodies [N]."""
        return sum(body.mass for body in self.scene.bodies) * float(np.linalg.norm(self.scene.gravity))

    def _held(self, assembly: Assembly, undetermined: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """F (nt, na) and loop forces (nt, N, 3)."""
        scene, nt = self.scene, len(assembly.tau)
        F, multipliers = forces(self.name, assembly.tau, assembly.J, self.layout, undetermined, self._weight)
        loop_forces = np.zeros((nt, scene.N, 3))
        loop_forces[..., : len(scene.loop_axes)] = multipliers.reshape(nt, scene.N, -1)
        return F, loop_forces

    def _carried(self, assembly: Assembly, loop_forces: np.ndarray) -> np.ndarray:
        """Wrenches (nt, nj, 6): a loop's force on the tip is taken from every joint of its leg."""
        cut = self._cut
        out = np.empty((len(loop_forces), len(cut), 6))
        out[:, ~cut] = wrench.less_force(assembly.tree, loop_forces[:, self.tree_legs], assembly.lever)
        out[:, cut] = wrench.of_loop(loop_forces)
        return out

    def _block(self, state: State, undetermined: np.ndarray) -> tuple[np.ndarray, ...]:
        """F, reactions, L, dL and the gaps at position, velocity and acceleration level of some samples."""
        assembly, loops = self.assemble(state, with_tree=True), self.gaps(state)
        F, loop_forces = self._held(assembly, undetermined)
        gap_velocity = np.zeros_like(loops.gap)
        rates = np.einsum("tij,tj->ti", assembly.J, state.v)
        gap_velocity[..., : len(self.scene.loop_axes)] = rates.reshape(len(F), self.scene.N, -1)
        reactions = self._carried(assembly, loop_forces)
        return F, reactions, loops.L, loops.dL, loops.gap, gap_velocity, loops.gap_acceleration


def _flags(state: State, undetermined: np.ndarray | None) -> np.ndarray:
    return np.zeros(len(state.q), dtype=bool) if undetermined is None else undetermined


def in_blocks(
    answer: Callable[[State, np.ndarray], tuple[np.ndarray, ...]], state: State, other: np.ndarray
) -> list[np.ndarray]:
    """What `answer` says of a state and another array (nt, ...), block by block, put together.

    EngineError says from which sample it counts.
    """
    blocks = []
    for first in range(0, len(other), BLOCK):
        part = slice(first, first + BLOCK)
        try:
            blocks.append(answer(State(*(x[part] for x in state)), other[part]))
        except EngineError as e:
            raise EngineError(f"{e} (counted from sample {first})" if first else str(e)) from None
    return [np.concatenate(column) for column in zip(*blocks, strict=True)]


def tree_facts(masses: Mapping[str, float], velocities: int, rows: int) -> ModelFacts:
    """Facts of a model read from the URDF: mass [kg] by the name of the body, or of its joint."""
    massless = [name for name, mass in masses.items() if mass == 0.0]
    floor = (f"links of zero mass, which URDF wants between two joints: {len(massless)}",) if massless else ()
    return ModelFacts(len(masses) - len(massless), len(massless), velocities, rows, sum(masses.values()), floor)
