"""What the exact answer keeps when the world, the units, the legs' names or the direction of time are others.

The certified reference keeps it within its balls wherever the changed inputs are exact; formulas and engines within
what `bounds.allowed` says of rounding in each of the cases compared; the formulas to the last bit where no operation
rounds otherwise.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import pytest
from conftest import ENGINES
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from strategies import Draw, hexapods, motion_of, numbers, scenes, show, vectors

from stewart_crosscheck.crosscheck import trajectory as trajectories
from stewart_crosscheck.crosscheck.bounds import allowed
from stewart_crosscheck.crosscheck.compare import certified
from stewart_crosscheck.crosscheck.engine import HULL, REFERENCE, DynamicsResult, load_engine, values
from stewart_crosscheck.crosscheck.scales import Scales, scales
from stewart_crosscheck.crosscheck.tolerance import LIMIT
from stewart_crosscheck.crosscheck.trajectory import Trajectory
from stewart_crosscheck.models import Scene

LENGTHS = {"L": "loop_pos", "dL": "loop_vel"}
"""A leg's length and its rate are as exact as the loop that it closes."""

Rows = dict[str, np.ndarray]
"""Platform's motion by the names of `Trajectory`."""

VECTORS = ("position", "velocity", "acceleration")
AXIAL = ("angular_velocity", "angular_acceleration")


def on_grid(x: Any) -> np.ndarray:
    """Multiples of 2^-30: sums of some of them are exact."""
    return np.round(np.asarray(x) * 2.0**30) / 2.0**30


@dataclass(frozen=True)
class Case:
    """A machine and its motion, and how its answer is seen from the first case.

    ``turn``: takes its vectors there, `legs`: which of its legs is the i-th there; its forces, lengths and rates are
    so many times those there.  ``exact``: its inputs are not rounded.  ``sign``: with which the answers add up to zero.
    ``other_branch``: legs with (q_o + pi, -q_n) in place of (q_o, q_n).
    """

    scene: Scene
    rows: Rows
    turn: np.ndarray = field(default_factory=lambda: np.eye(3))
    legs: Sequence[int] = ()
    force: float = 1.0
    length: float = 1.0
    rate: float = 1.0
    exact: bool = True
    sign: float = -1.0
    other_branch: Sequence[int] = ()

    @cached_property
    def trajectory(self) -> Trajectory:
        """A pose that is refused is a failure: the first case has been let in."""
        r = self.rows
        p = (r["position"], r["velocity"], r["acceleration"])
        w, dw = (r[name] for name in AXIAL)
        built = trajectories._build(self.scene, "rows", r["t"], p, r["quaternion"], w, dw)
        q, v, a = dict(built.q), dict(built.v), dict(built.a)
        for i in self.other_branch:
            o, n = f"o{i}", f"n{i}"
            q[o], q[n], v[n], a[n] = q[o] + math.pi, -q[n], -v[n], -a[n]
        return replace(built, q=q, v=v, a=a)

    @cached_property
    def truth(self) -> DynamicsResult:
        return load_engine(REFERENCE)(self.scene).inverse_dynamics(self.trajectory)

    @cached_property
    def size(self) -> Scales:
        return scales(self.scene, self.trajectory, self.truth)

    def unit(self, name: str) -> float:
        """What one of a quantity is in the first case."""
        if name in LENGTHS:
            return 1.0 / (self.length if name == "L" else self.rate)
        return 1.0 / (self.force * (self.length if name.startswith("M") else 1.0))

    def seen(self, name: str, x: np.ndarray) -> np.ndarray:
        """A quantity (nt, N, 1), (nt, N, 3) or, of the hull, (nt, 1, 3) as the first case has it."""
        if len(self.legs) and name not in HULL:
            x = x[:, list(self.legs)]
        if x.shape[2] == 3:
            axial = round(np.linalg.det(self.turn)) if name.startswith("M") else 1
            x = axial * (x @ self.turn.T)
        return self.sign * self.unit(name) * x

    def seen_radius(self, name: str, radius: np.ndarray) -> np.ndarray:
        return np.abs(replace(self, sign=1.0, turn=np.abs(self.turn)).seen(name, radius))


def of_result(case: Case, result: DynamicsResult, name: str) -> np.ndarray:
    return getattr(result, name)[..., None] if name in LENGTHS else values(case.scene, result, name)


def of_truth(case: Case, truth: DynamicsResult, name: str) -> tuple[np.ndarray, np.ndarray]:
    if name in LENGTHS:
        return getattr(truth, name)[..., None], truth.radius[name][..., None]
    return certified(case.scene, truth, name)


Answer = Callable[[Case], DynamicsResult]


def answer_of(name: str) -> Answer:
    """The route of inverse dynamics of an engine."""
    return lambda case: (
        case.truth if name == REFERENCE else load_engine(name)(case.scene).inverse_dynamics(case.trajectory)
    )


def require_kept(cases: Sequence[Case], name: str, answer: Answer, to_the_bit: bool = False) -> None:
    """The answers to the cases, as the first one sees them, add up to zero."""
    floor = getattr(load_engine(name), "inertia_floor", 0.0)
    results = [answer(case) for case in cases]
    for q in (*cases[0].scene.quantities, *HULL, *LENGTHS):
        if name == REFERENCE and all(case.exact for case in cases):
            balls = [of_truth(case, result, q) for case, result in zip(cases, results, strict=True)]
            seen = [case.seen(q, value) for case, (value, _) in zip(cases, balls, strict=True)]
            radii = [case.seen_radius(q, radius) for case, (_, radius) in zip(cases, balls, strict=True)]
            # Rounded once, and upwards: what is larger than the bound is not rounded to it.
            bound = np.nextafter(np.vectorize(math.fsum, signature="(n)->()")(np.stack(radii, axis=-1)), np.inf)
            error = np.abs(np.vectorize(math.fsum, signature="(n)->()")(np.stack(seen, axis=-1)))
            wrong = np.any(error > bound, axis=(1, 2))
        else:
            if name == REFERENCE:
                seen = [case.seen(q, of_truth(case, result, q)[0]) for case, result in zip(cases, results, strict=True)]
            else:
                seen = [case.seen(q, of_result(case, result, q)) for case, result in zip(cases, results, strict=True)]
            total = np.add.reduce(seen)
            if to_the_bit:
                assert not total.any(), f"{name}: {q} is off by {np.abs(total).max():.3g}, expected no other bit"
                continue
            bound, judged = np.zeros(len(total)), np.ones(len(total), dtype=bool)
            for case, result in zip(cases, results, strict=True):
                of = LENGTHS.get(q, q)
                rounded = replace(result)  # no ball: as any engine's answer
                may = allowed(case.scene, case.trajectory, rounded, case.truth, of, case.size, floor)[0]
                bound += abs(case.unit(q)) * case.size.of(of) * may
                judged &= may <= LIMIT
            error = np.linalg.norm(total, axis=2).max(axis=1)
            wrong = ~(error <= bound) & judged  # a NaN is wrong
        sample = int(np.argmax(wrong))
        assert not wrong.any(), (
            f"{name}: {q} of sample {sample} is off by {np.max(error[sample]):.3g},"
            f" expected at most {np.max(bound[sample]):.3g}"
        )


# --- Relations --------------------------------------------------------------------------------------------------------


def first_case(scene: Scene) -> Case:
    """The samples of the scene's own motion, on a grid, so that sums of offsets and loads are exact."""
    known = motion_of(scene)
    rows = {name: on_grid(getattr(known, name)) for name in (*VECTORS, *AXIAL, "quaternion")} | {"t": known.t}
    data = scene.model_dump(by_alias=True, exclude_none=True)
    del data["motion"]
    data["gravity"] = on_grid(data["gravity"]).tolist()
    data["load"] = {key: on_grid(x).tolist() for key, x in data.get("load", dict.fromkeys(PARTS, ZERO)).items()}
    return Case(Scene.model_validate(data), rows, sign=1.0)


PARTS, ZERO = ("force", "moment", "point"), (0.0, 0.0, 0.0)


def with_data(case: Case, rows: Rows, change: Callable[[dict], None], **how: Any) -> Case:
    """Another case: the first one's data changed."""
    data = case.scene.model_dump(by_alias=True, exclude_none=True)
    change(data)
    return replace(case, scene=Scene.model_validate(data), rows=rows, **{"sign": -1.0, **how})


def in_plane(case: Case, v: Sequence[float]) -> np.ndarray:
    """A vector that the machine may have: none across its plane."""
    return np.array(v) * ([1, 1, 1] if case.scene.topology == "spatial" else [1, 1, 0])


def moved(draw: Draw, case: Case) -> list[Case]:
    """The world's origin lies elsewhere."""
    by = in_plane(case, draw(vectors(64.0)))

    def change(data: dict) -> None:
        data["hull"]["pins"] = [(by + pin).tolist() for pin in data["hull"]["pins"]]

    return [case, with_data(case, case.rows | {"position": case.rows["position"] + by}, change)]


def _turned(case: Case, T: np.ndarray, quaternion: np.ndarray, exact: bool) -> list[Case]:
    """The world's axes are others by T, which may be improper."""
    det = round(np.linalg.det(T))

    def change(data: dict) -> None:
        data["gravity"] = (T @ data["gravity"]).tolist()
        data["load"] |= {"force": (T @ data["load"]["force"]).tolist()}
        data["load"] |= {"moment": (det * T @ data["load"]["moment"]).tolist()}
        data["hull"]["pins"] = [(T @ pin).tolist() for pin in data["hull"]["pins"]]

    rows = {name: case.rows[name] @ T.T for name in VECTORS} | {name: det * case.rows[name] @ T.T for name in AXIAL}
    return [case, with_data(case, case.rows | rows | {"quaternion": quaternion}, change, turn=T.T, exact=exact)]


def turned(draw: Draw, case: Case) -> list[Case]:
    """About y_r, in a plane about z_r: a point mass has no axes to turn with it."""
    axis = 1 if case.scene.topology == "spatial" else 2
    angle = draw(numbers(-3, 3))
    u = np.cos(angle / 2), np.sin(angle / 2)
    T = Rotation.from_rotvec(angle * np.eye(3)[axis]).as_matrix()
    T[axis] = T[:, axis] = np.eye(3)[axis]
    return _turned(case, T, _times(u, axis, case), exact=angle == 0.0)


def turned_squarely(draw: Draw, case: Case) -> list[Case]:
    """By right angles: every number is exact."""
    axis, quarters = 1 if case.scene.topology == "spatial" else 2, draw(st.integers(0, 3))
    u = [(1.0, 0.0), (1.0, 1.0), (0.0, 1.0), (-1.0, 1.0)][quarters]
    T = np.round(Rotation.from_rotvec(quarters * np.pi / 2 * np.eye(3)[axis]).as_matrix())
    return _turned(case, T, _times(u, axis, case), exact=True)


def _times(u: tuple[float, float], axis: int, case: Case) -> np.ndarray:
    """Quaternions after a turn u about an axis, of the length of u."""
    q = case.rows["quaternion"]
    if case.scene.freedom == "point":
        return q
    w, v = q[:, :1], q[:, 1:]
    e = np.eye(3)[axis]
    return np.hstack([u[0] * w - u[1] * v[:, [axis]], u[0] * v + u[1] * (w * e + np.cross(e, v))])


def mirrored(draw: Draw, case: Case) -> list[Case]:
    """In a mirror across x_r; the platform's own axes are mirrored with it."""
    T = np.diag([-1.0, 1.0, 1.0])
    first, after = _turned(case, T, case.rows["quaternion"] * [1, 1, -1, -1], exact=True)

    def change(data: dict) -> None:
        data["load"]["point"] = (T @ data["load"]["point"]).tolist()
        if "pins" in data["platform"]:
            data["platform"]["pins"] = [(T @ pin).tolist() for pin in data["platform"]["pins"]]
        if "inertia" in data["platform"]:
            data["platform"]["inertia"] = (T @ data["platform"]["inertia"] @ T).tolist()

    return [first, with_data(after, after.rows, change)]


def relabelled(draw: Draw, case: Case) -> list[Case]:
    """The legs have other numbers."""
    legs = draw(st.permutations(range(case.scene.N)))

    def change(data: dict) -> None:
        for part in (data["hull"], data["platform"]):
            if "pins" in part:
                part["pins"] = [part["pins"][i] for i in legs]

    return [case, with_data(case, case.rows, change, legs=np.argsort(legs).tolist())]


def _in_units(case: Case, length: float, mass: float, time: float, exact: bool) -> list[Case]:
    """A metre, a kilogram and a second are so many units."""
    force = mass * length / time**2

    def change(data: dict) -> None:
        leg, platform, load = data["leg"], data["platform"], data["load"]
        leg["a"] *= length
        leg["guide"]["com"] *= length
        for part in (leg.get("base", {}), leg["guide"], leg["rod"], platform):
            for key in part:
                if key == "mass":
                    part[key] *= mass
                elif key.startswith("J_"):
                    part[key] *= mass * length**2
                elif key == "inertia":
                    part[key] = (np.array(part[key]) * (mass * length**2)).tolist()
        for part in (platform, data["hull"]):
            if "pins" in part:
                part["pins"] = (np.array(part["pins"]) * length).tolist()
        data["gravity"] = (np.array(data["gravity"]) * (length / time**2)).tolist()
        for key, factor in (("force", force), ("moment", force * length), ("point", length)):
            load[key] = (np.array(load[key]) * factor).tolist()

    rows = case.rows | {"t": case.rows["t"] * time}
    for name, order in (("position", 0), ("velocity", 1), ("acceleration", 2)):
        rows[name] = rows[name] * (length / time**order)
    for order, name in enumerate(AXIAL, 1):
        rows[name] = rows[name] / time**order
    return [case, with_data(case, rows, change, force=force, length=length, rate=length / time, exact=exact)]


def in_binary_units(draw: Draw, case: Case) -> list[Case]:
    """Powers of two: nothing rounds otherwise."""
    return _in_units(case, *(2.0 ** draw(st.integers(-n, n)) for n in (10, 10, 5)), exact=True)


def in_decimal_units(draw: Draw, case: Case) -> list[Case]:
    """Millimetres, grams, milliseconds, and whatever else has a prefix."""
    return _in_units(case, *(10.0 ** draw(st.integers(-3, 3)) for _ in range(3)), exact=False)


def reversed_in_time(draw: Draw, case: Case) -> list[Case]:
    """The motion backwards: the same forces at the same places, lengths change the other way."""
    back = {name: -case.rows[name] for name in ("velocity", "angular_velocity")}
    return [case, replace(case, rows=case.rows | back, rate=-1.0, sign=-1.0)]


def on_the_other_branch(draw: Draw, case: Case) -> list[Case]:
    """Some bases turned by half a turn, and their guides the other way."""
    legs = draw(st.sets(st.sampled_from(list(case.scene.legs)), min_size=1))
    return [case, replace(case, other_branch=sorted(legs), sign=-1.0)]


def superposed(draw: Draw, case: Case) -> list[Case]:
    """Forces are affine in gravity, load and accelerations: f(x + y) - f(x) - f(y) + f(0) = 0."""
    load, plane = case.scene.load, in_plane(case, (1, 1, 1))
    turns = np.array({"spatial": [1, 1, 1], "planar": [0, 0, 1], "point": [0, 0, 0]}[case.scene.freedom])
    assert load
    linear = np.array(case.scene.gravity), np.array(load.force), case.rows["acceleration"]
    turning = np.array(load.moment), case.rows["angular_acceleration"]

    def other(kept: np.ndarray) -> np.ndarray:
        return np.array(draw(vectors(10.0))) * kept

    y_linear, y_turning = [other(plane) for _ in linear], [other(turns) for _ in turning]

    def made(x: float, y: float, sign: float) -> Case:
        gravity, force, a = (x * of_x + y * of_y for of_x, of_y in zip(linear, y_linear, strict=True))
        moment, dw = (x * of_x + y * of_y for of_x, of_y in zip(turning, y_turning, strict=True))

        def change(data: dict) -> None:
            data["gravity"] = gravity.tolist()
            data["load"] |= {"force": force.tolist(), "moment": moment.tolist()}

        return with_data(case, case.rows | {"acceleration": a, "angular_acceleration": dw}, change, sign=sign)

    return [made(1, 1, 1.0), made(1, 0, -1.0), made(0, 1, -1.0), made(0, 0, 1.0)]


Relation = Callable[[Draw, Case], list[Case]]
RELATIONS: dict[str, Relation] = {
    f.__name__: f
    for f in (
        moved, turned, turned_squarely, mirrored, relabelled, in_binary_units, in_decimal_units, reversed_in_time,
        superposed,
    )
}  # fmt: skip
TO_THE_BIT = {"in_binary_units", "reversed_in_time"}
"""Relations that the formulas keep to the last bit: each operation's result is that of the first case, scaled."""

every_route = pytest.mark.parametrize("engine_name", [REFERENCE, "analytic", *ENGINES], indirect=True)


@every_route
@pytest.mark.parametrize("relation", RELATIONS)
@given(scene=scenes(), data=st.data())
def test_the_answer_keeps(relation: str, engine_name: str, scene: Scene, data: st.DataObject) -> None:
    show(scene)
    cases = RELATIONS[relation](data.draw, first_case(scene))
    to_the_bit = engine_name == "analytic" and relation in TO_THE_BIT
    require_kept(cases, engine_name, answer_of(engine_name), to_the_bit)


@given(scene=hexapods(), data=st.data())
def test_reactions_of_the_route_kkt_do_not_depend_on_the_branch(
    engine_name: str, scene: Scene, data: st.DataObject
) -> None:
    show(scene)
    require_kept(on_the_other_branch(data.draw, first_case(scene)), engine_name, answer_of(engine_name))


# --- Broken -----------------------------------------------------------------------------------------------------------


def _tilted(case: Case, answer: DynamicsResult, by: float) -> dict[str, np.ndarray]:
    """Every force leans along one axis of the world."""
    reactions = answer.reactions.copy()
    reactions[..., 3] += by * np.linalg.norm(reactions[..., 3:], axis=2)
    return {"reactions": reactions}


def _handed(case: Case, answer: DynamicsResult, by: float) -> dict[str, np.ndarray]:
    """Forces in moments, which a mirror turns the other way."""
    reactions = answer.reactions.copy()
    reactions[..., :3] += by * case.size.length * reactions[..., 3:]
    return {"reactions": reactions}


def _first_leg(case: Case, answer: DynamicsResult, by: float) -> dict[str, np.ndarray]:
    return {"F": answer.F * (1.0 + by * np.eye(case.scene.N)[0])}


def _times_forces(factor: Callable[[Case, DynamicsResult], np.ndarray]) -> Callable[..., dict[str, np.ndarray]]:
    return lambda case, answer, by: {"F": answer.F * (1.0 + by * factor(case, answer))}


SPOILED: dict[str, Callable[[Case, DynamicsResult, float], dict[str, np.ndarray]]] = {
    "moved": _times_forces(lambda case, answer: np.sum(case.rows["position"], axis=1, keepdims=True)),
    "turned": _tilted,
    "turned_squarely": _tilted,
    "mirrored": _handed,
    "relabelled": _first_leg,
    "in_binary_units": _times_forces(lambda case, answer: answer.L),
    "in_decimal_units": _times_forces(lambda case, answer: answer.L),
    "reversed_in_time": _times_forces(lambda case, answer: np.sign(answer.dL)),
    "superposed": _times_forces(lambda case, answer: np.abs(answer.F) / case.size.force),
    "on_the_other_branch": _times_forces(lambda case, answer: np.sin(case.trajectory.q["n1"])[:, None]),
}
BROKEN = [(relation, "analytic", 1e-9) for relation in RELATIONS]
BROKEN += [(relation, REFERENCE, 1e-14) for relation in RELATIONS if relation not in ("turned", "in_decimal_units")]
BROKEN += [(relation, "analytic", 4e-16) for relation in sorted(TO_THE_BIT)]
BROKEN += [("on_the_other_branch", "mujoco", 1e-9)]


@pytest.mark.parametrize(("relation", "engine_name", "by"), BROKEN, indirect=["engine_name"])
def test_an_answer_that_keeps_it_not_is_seen(relation: str, engine_name: str, by: float) -> None:
    honest, change = answer_of(engine_name), (RELATIONS | {"on_the_other_branch": on_the_other_branch})[relation]

    def spoiled(case: Case) -> DynamicsResult:
        answer = honest(case)
        return replace(answer, **SPOILED[relation](case, answer, by))

    @settings(phases=[Phase.generate])
    @given(scene=hexapods(), data=st.data())
    def property_(scene: Scene, data: st.DataObject) -> None:
        cases = change(data.draw, first_case(scene))
        require_kept(cases, engine_name, spoiled, to_the_bit=by < 1e-15)

    with pytest.raises(AssertionError, match=f"^{engine_name}: "):
        property_()
