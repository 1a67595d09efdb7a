"""The formulas: back ends over batches, forms of the second problem, numbers of legs, integrators over their knob."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from scipy.interpolate import make_interp_spline

from ... import analytic
from ...analytic.backends import BACKENDS
from ...analytic.evaluate import DRIVING_FORCES, FORWARD_DYNAMICS, INVERSE_DYNAMICS
from ...analytic.forward import FORMS
from ...analytic.precision import KINDS, precise_driving_forces
from ...analytic.traced import traced
from ...models.scene import Scene
from ..engine import by_joint
from ..problem import Problem, Staged
from ..roofline import measure
from ..sweep import LEGS, MANY, Case, Inputs, Plan, Ready, parts

PROBLEMS = {"driving_forces": DRIVING_FORCES, "all_reactions": INVERSE_DYNAMICS, "forward_step": FORWARD_DYNAMICS}
SETTINGS = {"driving_forces": "(7)-(8)", "all_reactions": "(7)-(29)", "forward_step": "smallest form"}

LOOP = "ControlLoop"
IN_PLACE = ", in place"
"""Results in arrays that were there before."""

MOST_FLOATS = 1000
"""Samples at a time of the back end `float`, which takes them one by one."""

BITS = 128
"""Of balls."""

MACHINES = (6, 8, 12, 24, 48)
"""Legs of the machines that show how the work grows with them."""

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
        """Back ends, numbers of more digits, forms of the second problem, steps in time, numbers of legs."""
        case = partial(Case, engine="analytic", route="closed_form")
        for task, setting in SETTINGS.items():
            exact = partial(case, task, exact=True)
            for backend in BACKENDS:
                for batch in plan.batches:
                    if backend != "float" or batch <= MOST_FLOATS:
                        yield exact(backend=backend, setting=setting, batch=batch)
                    if backend != "float" and batch >= MANY and task != "forward_step":
                        yield exact(backend=backend, setting=setting + IN_PLACE, batch=batch)
        for task in SETTINGS:
            yield case(task, backend="compiled", setting=LOOP, exact=True)
        for kind in KINDS if scene.topology == "spatial" else ():  # no test for singular poses stands before them
            yield case(
                "driving_forces", backend=kind, setting=SETTINGS["driving_forces"], batch=plan.samples, exact=True
            )
        for form in FORMS:
            batch = min(MANY, plan.batches[-1])
            yield case("forward_step", backend="numpy", setting=f"form {form}", batch=batch, exact=True)
        for rtol in plan.some(TOLERANCES):
            yield case("simulate", backend="float", setting=f"DOP853, rtol {rtol:g}", knobs=(("rtol", rtol),))
        for steps in plan.some((1, 2, 4)):
            dt = f"dt {1e-2 / steps:.3g} s"
            yield case("simulate", backend="float", setting=f"RK4, {dt}", knobs=(("steps", steps),))
            for how in _DAE if scene.topology == "spatial" else ():
                knobs = (("steps", steps), ("dae", how))
                yield case("simulate", route="dae", backend="float", setting=f"{how}, {dt}", knobs=knobs)
        for legs in plan.some(MACHINES) if scene.topology == "spatial" else ():
            for what in ("forward_dynamics", "inverse_kinematics"):
                yield case(LEGS, backend="numpy", setting=what, batch=MANY, knobs=(("legs", legs),))

    def ready(self, case: Case, inputs: Inputs) -> Ready:
        """By the task."""
        if case.task == LEGS:
            return _legs(case, inputs)
        if case.setting == LOOP:
            return _loop(case, inputs)
        if case.task == "simulate":
            return _simulate(case, inputs)
        if case.task == "forward_step":
            return _forward(case, inputs)
        P, motion = inputs.scene.parameters, inputs.trajectory.motion
        index = parts(len(motion.C_p), case.batch)
        given = [(analytic.PlatformMotion(*(np.ascontiguousarray(x[i]) for x in motion)), None) for i in index]
        samples = sum(map(len, index))
        if case.task == "driving_forces":
            return Ready(*_driving_forces(case, P, given), _joined, samples)
        N = len(P.p)
        if case.setting.endswith(IN_PLACE):
            given = [(m, analytic.InverseDynamics.zeros(len(m.C_p), N)) for m, _ in given]

        def both(out: list[Any], pick: np.ndarray) -> Any:
            found = {n: np.concatenate([getattr(D, n) for D in out])[pick] for n in inputs.scene.quantities}
            return found["F"], by_joint(inputs.scene, found)

        return Ready(given, lambda part: analytic.inverse_dynamics(P, part[0], case.backend, part[1]), both, samples)


def roofline(scene: Scene) -> dict[str, Any]:
    """What one core can do, and the least time [µs per sample] of each task's operations. Raises NoCompiler."""
    limits, P = measure(), scene.parameters
    least = {}
    for task, problem in PROBLEMS.items():
        read, written = sum(problem.widths(P)), len(problem.rows(P))
        least[task] = 1e6 * limits.seconds(traced(P, problem).counts(), 8 * read, 8 * written)
    return {**limits._asdict(), "least_us": least}


def _joined(out: list[Any], pick: np.ndarray) -> np.ndarray:
    return np.concatenate([np.array(F, dtype=float) for F in out])[pick]


def _driving_forces(case: Case, P: Any, given: list[Any]) -> tuple[Any, Any]:
    """Parts and the call on each of them."""
    if case.backend in KINDS:
        if case.backend == "ball":
            import flint  # the package may be missing

            flint.ctx.prec = BITS
        return given, lambda part: precise_driving_forces(P, part[0], case.backend)
    if case.setting.endswith(IN_PLACE):
        given = [(m, np.empty((len(P.p), len(m.C_p))).T) for m, _ in given]
    return given, lambda part: analytic.driving_forces(P, part[0], case.backend, part[1])


def _loop(case: Case, inputs: Inputs) -> Ready:
    """One state after another in arrays that stay: writing the state and reading the answer are a part of the time."""
    scene, motion, F = inputs.scene, inputs.trajectory.motion, inputs.F
    problem = PROBLEMS[case.task]
    loop = analytic.ControlLoop(scene.parameters, problem.name)
    columns = [x.reshape(len(F), -1) for x in (motion if case.task != "forward_step" else (*motion[:4], F))]
    states = list(np.hstack(columns))
    given, found, rows = loop.given, loop.found, problem.rows(scene.parameters)

    def one(state: np.ndarray) -> np.ndarray:
        given[:] = state
        loop()
        return found.copy()

    def read(out: list[np.ndarray], pick: np.ndarray) -> Any:
        numbers = np.array(out)[pick]
        if case.task == "driving_forces":
            return numbers
        if case.task == "forward_step":
            platform = np.zeros((len(numbers), 6))
            platform[:, rows] = numbers
            return platform
        D = analytic.InverseDynamics.zeros(len(numbers), scene.N)
        D.numbers[rows] = numbers.T
        return D.F, by_joint(scene, vars(D))

    return Ready(states, one, read, len(states))


def _forward(case: Case, inputs: Inputs) -> Ready:
    """Accelerations from certified forces; the motion's own are not there to be read."""
    P, F = inputs.scene.parameters, inputs.F
    motion = inputs.trajectory.without_accelerations().motion
    index = parts(len(F), case.batch)
    given = [(analytic.PlatformMotion(*(np.ascontiguousarray(x[i]) for x in motion)), F[i]) for i in index]
    form = case.setting.removeprefix("form ")
    how = {"form": form} if form in FORMS else {"backend": case.backend}

    def platform(out: list[Any], pick: np.ndarray) -> np.ndarray:
        return np.concatenate([np.hstack([a.ddC_p, a.dw_p]) for a in out])[pick]

    return Ready(given, lambda part: analytic.forward_dynamics(P, *part, **how), platform, sum(map(len, index)))


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
