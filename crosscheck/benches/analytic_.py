"""The formulas: back ends over batches, forms of the second problem, numbers of legs, integrators over their knob."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from scipy.interpolate import make_interp_spline

from ... import analytic
from ...analytic.forward import accelerations
from ...analytic.orientation import rotation
from ...analytic.solve import solve_numbers
from ...analytic.stewart import first_problem
from ...models.scene import Scene
from ..engine import by_joint
from ..problem import Problem, Staged
from ..sweep import LEGS, Case, Inputs, Plan, Ready, parts

MACHINES = (6, 8, 12, 24, 48)
"""Legs of the machines that show how the work grows with them."""

MOST_FLOATS = 1000
"""Samples at a time of the back end `float`, which takes them one by one."""

BACKENDS = ("numpy",)
FORMS = ("compliance", "reduced", "paper")
TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11, 1e-12, 1e-13)
"""Of the adaptive solver, relative."""

_DAE: dict[str, dict[str, Any]] = {
    "RK4": {},
    "RK4 + Baumgarte 20 1/s": {"gain": 20.0},
    "RK4 + projection": {"projection": True},
}


class AnalyticSweep:
    """The formulas get the platform's motion alone; nothing of it is prepared."""

    def cases(self, scene: Scene, plan: Plan) -> Iterator[Case]:
        """The first problem on every back end; the second one in every form; steps in time."""
        case = partial(Case, engine="analytic", route="closed_form")
        for task, setting in (("driving_forces", "(7), (8)"), ("all_reactions", "(7)-(29)")):
            for backend in BACKENDS:
                for batch in plan.batches:
                    if backend != "float" or batch <= MOST_FLOATS:
                        yield case(task, backend=backend, setting=setting, batch=batch, exact=True)
        if scene.topology == "spatial":
            for number in NUMBERS:
                yield case("all_reactions", backend=number, setting="(7)-(29)", exact=True)
        for form in FORMS:
            yield case("forward_step", backend="float", setting=f"form {form}", knobs=(("form", form),), exact=True)
            for batch in plan.batches if form == FORMS[0] else (1000,):
                if batch <= 100_000:
                    yield case(
                        "forward_step", backend="numpy", setting=f"form {form}", batch=batch, knobs=(("form", form),),
                        exact=True,
                    )  # fmt: skip
        for rtol in plan.some(TOLERANCES):
            yield case("simulate", backend="float", setting=f"DOP853, rtol {rtol:g}", knobs=(("rtol", rtol),))
        for steps in plan.some((1, 2, 4)):
            setting = f"RK4, dt {1e-2 / steps:.3g} s"
            yield case("simulate", backend="float", setting=setting, knobs=(("steps", steps),))
            if scene.topology == "spatial":
                for how in _DAE:
                    setting = f"{how}, dt {1e-2 / steps:.3g} s"
                    yield case(
                        "simulate",
                        route="dae",
                        backend="float",
                        setting=setting,
                        knobs=(("steps", steps), ("dae", how)),
                    )
        if scene.topology == "spatial":
            for legs in plan.some(MACHINES):
                for what in ("forward_dynamics", "inverse_kinematics"):
                    yield case(LEGS, backend="numpy", setting=what, batch=1000, knobs=(("legs", legs),))

    def ready(self, case: Case, inputs: Inputs) -> Ready:
        """By the task."""
        if case.task == LEGS:
            return _legs(case, inputs)
        if case.task == "simulate":
            return _simulate(case, inputs)
        if case.task == "forward_step":
            return _forward(case, inputs)
        if case.backend in NUMBERS:
            return _precise(case, inputs)
        P, motion = inputs.scene.parameters, inputs.trajectory.motion
        index = parts(len(motion.C_p), case.batch)
        motions = [analytic.PlatformMotion(*(np.ascontiguousarray(x[i]) for x in motion)) for i in index]
        samples = sum(map(len, index))
        if case.task == "driving_forces":
            call = partial(analytic.driving_forces, P)
            return Ready(motions, call, lambda out, pick: np.concatenate(out)[pick], samples)

        def both(out: list[Any], pick: np.ndarray) -> Any:
            found = {n: np.concatenate([getattr(D, n) for D in out])[pick] for n in inputs.scene.quantities}
            return found["F"], by_joint(inputs.scene, found)

        return Ready(motions, partial(analytic.inverse_dynamics, P), both, samples)


def _precise(case: Case, inputs: Inputs) -> Ready:
    """The same text on other numbers, one sample at a time; the pose is given in them too."""
    scene, trajectory = inputs.scene, inputs.trajectory
    P, motion = scene.parameters, trajectory.motion
    assert isinstance(P, analytic.Parameters)
    number, sqrt = NUMBERS[case.backend]()
    samples = []
    for k, q in enumerate(trajectory.quaternion):
        vectors = {n: tuple(map(number, getattr(motion, n)[k].tolist())) for n in motion._fields if n != "R"}
        samples.append(analytic.PlatformMotion(R=rotation([number(x) for x in q.tolist()]), **vectors))

    def both(out: list[Any], _: np.ndarray) -> Any:
        found: dict[str, list[Any]] = {name: [] for name in scene.quantities}
        for one in out:
            found["F"].append(one.F)
            for kind in (one.forces, one.moments):
                for name in found.keys() & set(kind[0]._fields):
                    found[name].append([getattr(leg, name) for leg in kind])
        values = {name: np.array(np.array(x, dtype=object), dtype=float) for name, x in found.items()}
        return values["F"], by_joint(scene, values)

    return Ready(samples, lambda m: first_problem(P, m, sqrt, solve_numbers), both, len(samples))


def _long_doubles() -> tuple[Any, Any]:
    return np.longdouble, np.sqrt


def _balls() -> tuple[Any, Any]:
    from flint import arb, ctx  # its package may be missing

    ctx.prec = 128
    return arb, arb.sqrt


NUMBERS = {"long double": _long_doubles, "balls": _balls}
"""Numbers beyond float64: 64 bits of 80, and intervals of 128 bits around a midpoint."""


def _forward(case: Case, inputs: Inputs) -> Ready:
    """Accelerations from certified forces; the motion's own are not there to be read."""
    P, F = inputs.scene.parameters, inputs.F
    motion = inputs.trajectory.without_accelerations().motion
    form = dict(case.knobs)["form"]
    index = parts(len(F), case.batch)
    if case.backend == "float":
        numbers = [(analytic.PlatformMotion(*(x[k].tolist() for x in motion)), F[k].tolist()) for k in range(len(F))]

        def read(out: list[Any], _: np.ndarray) -> np.ndarray:
            return np.array([[*one.ddC_p, *one.dw_p] for one in out])

        return Ready(numbers, lambda part: accelerations(P, part[0], part[1], form), read, len(F))
    given = [(analytic.PlatformMotion(*(x[i] for x in motion)), F[i]) for i in index]

    def platform(out: list[Any], pick: np.ndarray) -> np.ndarray:
        return np.concatenate([np.hstack([a.ddC_p, a.dw_p]) for a in out])[pick]

    return Ready(
        given, lambda part: analytic.forward_dynamics(P, part[0], part[1], form), platform, sum(map(len, index))
    )


def _simulate(case: Case, inputs: Inputs) -> Ready:
    """One second; forces from a table, or from a spline through it where the solver chooses its own times."""
    P, problem = inputs.scene.parameters, inputs.problem
    first, knobs = problem.start, dict(case.knobs)
    start = analytic.State(first.position[0], first.unit_quaternion[0], first.velocity[0], first.angular_velocity[0])
    if case.route == "dae":
        F = Staged(problem, knobs["steps"])
        run = partial(analytic.simulate_constrained, P, start, t=problem.t, dt=F.dt, **_DAE[knobs["dae"]])
    elif "steps" in knobs:
        F = Staged(problem, knobs["steps"])
        run = partial(analytic.simulate, P, start, t=problem.t, dt=F.dt)
    else:
        F = _splined(problem)
        run = partial(analytic.simulate, P, start, t=problem.t, rtol=knobs["rtol"])
    return Ready([F], lambda F: run(F=F), lambda out, _: (out[0].position, out[0].quaternion))


def _splined(problem: Problem) -> Any:
    """Driving forces at any time, to rounding: a quintic through two thousand of them."""
    t = np.linspace(0.0, problem.duration, 2001)
    return make_interp_spline(t, problem.forces(t), k=5)


def _legs(case: Case, inputs: Inputs) -> Ready:
    """A machine of any number of legs: the scene's own pins again and again, each turn moved on the circle a bit."""
    P = inputs.scene.parameters
    assert isinstance(P, analytic.Parameters)
    N = dict(case.knobs)["legs"]
    turn = np.arange(N) // len(P.p) * (np.pi / 24.0)
    machine = replace(P, p=_turned(P.p, turn), O=_turned(P.O, turn))
    motion = inputs.trajectory.motion
    index = parts(len(motion.C_p), case.batch)[0]
    motion = analytic.PlatformMotion(*(x[index] for x in motion))
    if case.setting == "inverse_kinematics":
        return Ready([motion], partial(analytic.inverse_kinematics, machine), lambda out, pick: None, case.batch)
    F = np.ones((case.batch, N))
    run = partial(analytic.forward_dynamics, machine, F=F)
    return Ready([motion], run, lambda out, pick: None, case.batch)


def _turned(pins: Any, turn: np.ndarray) -> tuple:
    """Pins (N, 3), repeated, each turned about y_r by its angle (n,)."""
    x, y, z = np.array(pins, dtype=float)[np.arange(len(turn)) % len(pins)].T
    c, s = np.cos(turn), np.sin(turn)
    return tuple(map(tuple, np.column_stack([c * x + s * z, y, c * z - s * x]).tolist()))


SWEEP = AnalyticSweep()
