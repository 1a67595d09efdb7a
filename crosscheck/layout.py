"""Where an engine keeps its velocities, and what these move."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..analytic.solve import longest_lever, row_units
from ..models.scene import Scene


@dataclass(frozen=True)
class Layout:
    """Where an engine keeps its velocities: leg by leg the ``passive`` (N, 2 or 1) and the ``actuated`` (N,) ones.

    ``platform`` (p,): its own, linear ones first.  ``lever``: the longest one of a pin [m], which moments are over.
    """

    passive: np.ndarray
    actuated: np.ndarray
    platform: np.ndarray
    lever: float = 1.0

    @classmethod
    def of(cls, scene: Scene, index: Mapping[str, int], turns_first: bool = False) -> Layout:
        """From the velocity index of every coordinate of the legs; what is left is the platform's.

        ``turns_first``: of a free joint's six velocities the first three are angular.
        """
        by_leg = [[j for j in scene.joints if j.leg == i and not j.cut] for i in scene.legs]
        passive = [[index[c] for j in leg if not j.actuated for c in j.coordinates] for leg in by_leg]
        actuated = [index[c] for leg in by_leg for j in leg if j.actuated for c in j.coordinates]
        platform = np.array(sorted(set(range(scene.nv)) - set(index.values())))
        if turns_first and len(platform) == 6:
            platform = np.roll(platform, 3)
        return cls(np.array(passive), np.array(actuated), platform, longest_lever(scene.pins))

    @cached_property
    def chains(self) -> np.ndarray:
        """Velocities of each leg (N, 3 or 2), from the hull on."""
        return np.sort(np.column_stack([self.passive, self.actuated]), axis=1)

    @cached_property
    def units(self) -> np.ndarray:
        """What the platform's equations (p,) are over."""
        return row_units(len(self.platform), self.lever)

    @cached_property
    def pushes(self) -> tuple[np.ndarray, np.ndarray]:
        """Generalized forces of unit driving forces (nv, N), and of unit wrenches on the platform (nv, p)."""
        one = np.eye(self.passive.size + self.actuated.size + self.platform.size)
        return one[:, self.actuated], one[:, self.platform] * self.units

    def couples(self, J: np.ndarray) -> np.ndarray:
        """Whether a loop moves with a coordinate of another leg: (nt,), of Jacobians (nt, nc, nv)."""
        moves = np.logical_and(J, self._of_others)
        return np.any(moves, axis=(1, 2)) if moves.any() else np.zeros(len(J), dtype=bool)

    @cached_property
    def _of_others(self) -> np.ndarray:
        """Where in a Jacobian (nc, nv) a loop meets the coordinates of another leg."""
        (N, hinges), p = self.passive.shape, len(self.platform)
        own = np.zeros((N, N * (hinges + 1) + p), dtype=bool)
        own[:, self.platform] = True
        own[np.arange(N)[:, None], self.chains] = True
        return np.repeat(~own, hinges + 1, axis=0)
