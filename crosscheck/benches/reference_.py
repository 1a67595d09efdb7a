"""The certified reference: what a proof costs."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from ...models.scene import Scene
from ..engine import load_engine
from ..sweep import Case, Inputs, Plan, Ready, parts


class ReferenceSweep:
    """All reactions in ball arithmetic, one sample at a time."""

    def cases(self, scene: Scene, plan: Plan) -> Iterator[Case]:
        """One."""
        yield Case("all_reactions", "reference", "certified", "balls", "128 bits and more")

    def ready(self, case: Case, inputs: Inputs) -> Ready:
        """It reads the trajectory itself."""
        engine, trajectory = load_engine(case.engine)(inputs.scene), inputs.trajectory

        def both(out: list[Any], pick: np.ndarray) -> Any:
            return tuple(np.concatenate([getattr(x, name) for x in out])[pick] for name in ("F", "reactions"))

        samples = [trajectory.at(i) for i in parts(len(trajectory.t), case.batch)]
        return Ready(samples, engine.inverse_dynamics, both, len(trajectory.t))


SWEEP = ReferenceSweep()
