"""Pinocchio over its proximal parameter and iterations, mu × n; and the yardstick of all times.

The yardstick is `rnea` on the open tree.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from ...models.scene import Scene
from ..engine import load_engine
from ..kkt_sweep import KktSweep, Knob
from ..sweep import BASELINE, Case, Inputs, Plan, Ready

_PROXIMAL = ((1e-4, 1), (1e-6, 1), (1e-8, 1), (1e-10, 1), (1e-4, 2), (1e-4, 3), (1e-10, 5))


class PinocchioSweep(KktSweep):
    """Adds ``pin.rnea`` called from Python, once per sample: it knows no loops, so it answers nothing."""

    def cases(self, scene: Scene, plan: Plan) -> Iterator[Case]:
        """The yardstick first."""
        yield Case(BASELINE, self.engine, "tree", "", "pin.rnea, one call per sample")
        yield from super().cases(scene, plan)

    def ready(self, case: Case, inputs: Inputs) -> Ready:
        """Configurations, velocities, accelerations as arrays that Pinocchio takes as they are."""
        if case.task != BASELINE:
            return super().ready(case, inputs)
        import pinocchio as pin

        engine: Any = load_engine(self.engine)(inputs.scene, inputs.models)
        rnea, model, data = pin.rnea, engine.model, engine.data
        states = list(zip(*engine.state(inputs.trajectory), strict=True))
        return Ready(states, lambda part: rnea(model, data, *part), lambda out, pick: None, len(states))


SWEEP = PinocchioSweep(
    "pinocchio",
    solver=[Knob(f"constraintDynamics, mu {mu:g} × {n}", {"mu": mu, "iterations": n}) for mu, n in _PROXIMAL],
    own={"RK4": [Knob("constraintDynamics, mu 1e-10 × 5", {}, steps) for steps in (1, 2, 4)]},
)
