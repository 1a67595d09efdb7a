"""The certified reference: radii, power balance, and two independent ways to the same numbers."""

from __future__ import annotations

import dataclasses
from typing import Any

import flint
import numpy as np
import pytest
from conftest import parameters
from flint import arb, arb_mat
from machines import dense_newton_euler, random_scene

from stewart_crosscheck.analytic import PlatformMotion, stewart
from stewart_crosscheck.crosscheck import newton_euler
from stewart_crosscheck.crosscheck.chosen import chosen_samples
from stewart_crosscheck.crosscheck.engine import DynamicsResult, load_engine, quantity
from stewart_crosscheck.crosscheck.engines import reference_
from stewart_crosscheck.crosscheck.engines.reference_ import NotCertified, certified
from stewart_crosscheck.crosscheck.trajectory import Trajectory, from_scene
from stewart_crosscheck.models import Scene

ROW = ("position", "quaternion", "velocity", "angular_velocity", "acceleration", "angular_acceleration")
VECTORS = ("F_r", "F_s", "F_n", "F_o", "M_s", "M_n", "M_o")


def row_of(trajectory: Trajectory, k: int) -> dict[str, list[float]]:
    return {name: getattr(trajectory, name)[k].tolist() for name in ROW}


def formulas_in_balls(scene: Scene, row: dict[str, list[float]], bits: int) -> dict[str, list]:
    """The closed-form text on arb balls, from the same exact float64 inputs."""
    before, flint.ctx.prec = flint.ctx.prec, bits
    try:
        exact = {name: [arb(v) for v in values] for name, values in row.items()}
        w, x, y, z = exact["quaternion"]
        n = w * w + x * x + y * y + z * z
        R = [
            [(w * w + x * x - y * y - z * z) / n, 2 * (x * y - w * z) / n, 2 * (x * z + w * y) / n],
            [2 * (x * y + w * z) / n, (w * w - x * x + y * y - z * z) / n, 2 * (y * z - w * x) / n],
            [2 * (x * z - w * y) / n, 2 * (y * z + w * x) / n, (w * w - x * x - y * y + z * z) / n],
        ]
        motion = PlatformMotion(
            exact["position"],
            R,
            exact["velocity"],
            exact["angular_velocity"],
            exact["acceleration"],
            exact["angular_acceleration"],
        )
        P = _in_balls(parameters(scene))

        def solve(rows, right):  # a solver of its own: the library's
            X = arb_mat([list(r) for r in rows]).solve(arb_mat([[b] for b in right]))
            return [X[i, 0] for i in range(6)]

        one = stewart.first_problem(P, motion, lambda v: v.sqrt(), solve)
        columns = [list(one.F), *zip(*one.forces, strict=True), *zip(*one.moments, strict=True)]
        return {name: list(values) for name, values in zip(("F", *VECTORS), columns, strict=True)}
    finally:
        flint.ctx.prec = before


def _in_balls(value: Any) -> Any:
    """Parameters with every float as an exact ball, so that products of parameters do not round."""
    if isinstance(value, float):
        return arb(value)
    if isinstance(value, tuple):
        return tuple(_in_balls(v) for v in value)
    return dataclasses.replace(value, **{f.name: _in_balls(getattr(value, f.name)) for f in dataclasses.fields(value)})


def components(values: list) -> list:
    return [x for v in values for x in (v if isinstance(v, tuple) else (v,))]


@pytest.mark.parametrize("base", [True, False], ids=["19 bodies", "13 bodies"])
@pytest.mark.parametrize("gravity", [(0.0, -9.81, 0.0), (2.5, -8.0, -3.5)], ids=["vertical", "inclined"])
@pytest.mark.parametrize("seed", range(3))
def test_formulas_in_balls_overlap_the_reference_at_1e_40(
    seed: int, gravity: tuple[float, float, float], base: bool
) -> None:
    scene = random_scene(seed, base=base, gravity=gravity)
    trajectory = from_scene(scene, 3)
    for k in range(3):
        row = row_of(trajectory, k)
        truth = certified(scene, row, bound=1e-45)
        formulas = formulas_in_balls(scene, row, bits=256)
        for name in ("F", *VECTORS):
            for want, got in zip(components(truth[name]), components(formulas[name]), strict=True):
                assert want.overlaps(got)
                assert max(float(want.rad()), float(got.rad())) < 1e-40  # the overlap means 40 places, not wide balls


def test_a_wrong_formula_does_not_overlap(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = random_scene(0)
    row = row_of(from_scene(scene, 3), 1)
    inertia = stewart.inertia
    monkeypatch.setattr(
        stewart, "inertia", lambda leg, q_s: (inertia(leg, q_s)[0] * (1 + arb(2) ** -100), *inertia(leg, q_s)[1:])
    )
    truth, formulas = certified(scene, row, bound=1e-45), formulas_in_balls(scene, row, bits=256)
    assert not any(w.overlaps(g) for w, g in zip(truth["F"], formulas["F"], strict=True))


@pytest.mark.parametrize("seed", range(3))
def test_dense_newton_euler_agrees(seed: int) -> None:
    scene = random_scene(seed)
    trajectory = from_scene(scene, 3)
    result = load_engine("reference")(scene).inverse_dynamics(trajectory)
    scale = np.abs(result.reactions[..., 3:]).max()
    for k in range(3):
        dense = dense_newton_euler(scene, trajectory, k)
        for name in scene.quantities:
            want = quantity(scene, name, result.F, result.reactions)[k]
            # float64 with moments about the world origin: 126 x 126, condition about 1e3
            np.testing.assert_allclose(dense[name].reshape(want.shape), want, rtol=0, atol=1e-12 * scale)


def test_dense_newton_euler_sees_a_wrong_scene(hexapod: Scene, trajectory: Trajectory, truth: DynamicsResult) -> None:
    rod = hexapod.leg.rod.model_copy(update={"J_x": hexapod.leg.rod.J_x * (1 + 1e-6)})
    wrong = hexapod.model_copy(update={"leg": hexapod.leg.model_copy(update={"rod": rod})})
    dense = dense_newton_euler(wrong, trajectory, 5)
    assert np.abs(dense["F"] - truth.F[5]).max() > 1e-10 * np.abs(truth.F).max()


def test_power_balance_closes_in_balls(hexapod: Scene, trajectory: Trajectory) -> None:
    for k in range(0, len(trajectory.t), 5):
        power = certified(hexapod, row_of(trajectory, k))["power"][0]
        assert power.contains(0)
        assert float(power.rad()) < 1e-25  # W, of some hundred: the balance is no wide ball


def test_power_balance_catches_a_wrong_force(
    hexapod: Scene, trajectory: Trajectory, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A driving force off by 1e-18 of itself does another work than the energy takes up."""
    reactions = newton_euler._Leg.reactions

    def wrong(self, a, F_r):
        out = reactions(self, a, F_r)
        return out | {"F_s": tuple(x * (1 + arb(2) ** -60) for x in out["F_s"])}

    monkeypatch.setattr(newton_euler._Leg, "reactions", wrong)
    with pytest.raises(NotCertified, match="power balance"):
        certified(hexapod, row_of(trajectory, 3))


def test_power_balance_equals_the_change_of_energy(hexapod: Scene) -> None:
    """d(T + V)/dt of the bodies by central differences of energies computed from joint coordinates alone."""
    t0, h = 0.7, 1e-4

    def energy(trajectory: Trajectory, k: int) -> float:
        R, w = trajectory.rotation[k], trajectory.angular_velocity[k]
        I_W = R @ np.array(hexapod.platform.inertia) @ R.T
        total = 0.5 * hexapod.platform.mass * np.sum(trajectory.velocity[k] ** 2) + 0.5 * w @ I_W @ w
        total += 9.81 * hexapod.platform.mass * trajectory.position[k, 1]
        leg, base = hexapod.leg, hexapod.leg.base
        assert base is not None
        for i in hexapod.legs:
            q_n, q_s = trajectory.q[f"n{i}"][k], trajectory.q[f"s{i}"][k]
            v_o, v_n, v_s = (trajectory.v[f"{c}{i}"][k] for c in "ons")
            swing = (np.sin(q_n) * v_o) ** 2 + v_n**2
            spin = (np.cos(q_n) * v_o) ** 2
            transverse = leg.guide.J_x + leg.rod.J_x + leg.rod.mass * q_s**2
            total += 0.5 * (base.J_z * v_o**2 + transverse * swing + (leg.guide.J_y + leg.rod.J_z) * spin)
            total += 0.5 * leg.rod.mass * v_s**2
            total += 9.81 * np.cos(q_n) * (leg.guide.mass * leg.guide.com + leg.rod.mass * q_s)
        return float(total)

    def rate(step: float) -> float:
        assert hexapod.motion is not None
        span = hexapod.model_copy(update={"motion": hexapod.motion.model_copy(update={"duration": t0 + step})})
        after = from_scene(span, 2)
        span = hexapod.model_copy(update={"motion": hexapod.motion.model_copy(update={"duration": t0 - step})})
        return (energy(after, 1) - energy(from_scene(span, 2), 1)) / (2 * step)

    assert hexapod.motion is not None
    at = hexapod.model_copy(update={"motion": hexapod.motion.model_copy(update={"duration": t0})})
    out = certified(hexapod, row_of(from_scene(at, 2), 1))
    power = sum(float(F * dL) for F, dL in zip(out["F"], out["dL"], strict=True))
    errors = [abs(rate(step) - power) for step in (8 * h, 16 * h)]
    assert errors[0] < 1e-4 * abs(power)
    assert 3.9 < errors[1] / errors[0] < 4.1  # second order: what is left is the difference quotient's own error


def test_radius_covers_the_rounding_to_float64(hexapod: Scene, trajectory: Trajectory, truth: DynamicsResult) -> None:
    """|value - truth| <= radius, with the truth known to 60 digits; and the radius is not generous."""
    k = 4
    out = certified(hexapod, row_of(trajectory, k), bound=1e-60)
    for name in hexapod.quantities:
        value = quantity(hexapod, name, truth.F, truth.reactions)[k].ravel()
        radius = quantity(hexapod, name, truth.radius["F"], truth.radius["reactions"])[k].ravel()
        for v, r, exact in zip(value.tolist(), radius.tolist(), components(out[name]), strict=True):
            assert abs(exact - arb(v)) <= arb(r)
            assert r <= np.spacing(abs(v)) * 0.51 + 1e-18


def test_precision_is_raised_until_the_radius_is_small(hexapod: Scene, trajectory: Trajectory) -> None:
    row = row_of(trajectory, 2)
    wide, narrow = certified(hexapod, row, bound=1e-20), certified(hexapod, row, bound=1e-200)
    assert float(narrow["F"][0].rad()) < 1e-190 < float(wide["F"][0].rad())
    assert wide["F"][0].overlaps(narrow["F"][0])


def test_the_callers_precision_is_left_alone(hexapod: Scene, trajectory: Trajectory) -> None:
    before = flint.ctx.prec
    certified(hexapod, row_of(trajectory, 0), bound=1e-100)
    assert flint.ctx.prec == before


def test_singular_pose_is_not_certified(
    hexapod: Scene, trajectory: Trajectory, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All pins of the platform in one point: no force holds a moment, at any precision."""
    monkeypatch.setattr(reference_, "PRECISIONS", (128, 256))  # the answer is the same at 8192 bits, later
    platform = hexapod.platform.model_copy(update={"pins": ((0.1, 0.0, 0.2),) * 6})
    with pytest.raises(NotCertified, match="singular pose"):
        certified(hexapod.model_copy(update={"platform": platform}), row_of(trajectory, 0))


def test_length_of_the_quaternion_does_not_matter(hexapod: Scene, trajectory: Trajectory) -> None:
    row = row_of(trajectory, 6)
    longer = row | {"quaternion": [4.0 * v for v in row["quaternion"]]}  # a power of two: the same direction exactly
    assert all(
        a.overlaps(b) for a, b in zip(certified(hexapod, row)["F"], certified(hexapod, longer)["F"], strict=True)
    )


def test_long_trajectories_are_sampled_with_the_worst_pose_among_them() -> None:
    condition, sin_q_n = np.ones(5000), np.ones(5000)
    bad, steep = np.setdiff1d(np.arange(5000), chosen_samples(5000, condition, sin_q_n))[[100, 200]]
    condition[bad], sin_q_n[steep] = 7.0, 0.1
    chosen = chosen_samples(5000, condition, sin_q_n)
    assert {bad, steep} <= set(chosen)
    assert len(set(chosen)) == len(chosen)
    assert 1000 <= len(chosen) <= 1002
    np.testing.assert_array_equal(chosen, chosen_samples(5000, condition, sin_q_n))
    np.testing.assert_array_equal(chosen_samples(1000, condition[:1000], sin_q_n[:1000]), np.arange(1000))


def test_moments_are_bounded_too(hexapod: Scene, trajectory: Trajectory) -> None:
    out = certified(hexapod, row_of(trajectory, 1), bound=1e-60)
    force = max(abs(float(x)) for x in components(out["F_o"]))
    for name in ("M_s", "M_n", "M_o"):
        assert max(float(x.rad()) for x in components(out[name])) <= 2e-60 * force


def test_a_ball_becomes_a_float_and_a_radius_that_is_never_too_small() -> None:
    third = arb(1) / 3
    for x in (third, third * arb(2) ** -1080, arb(0, 1e-300), arb(1, 2**-60)):
        value, radius = reference_._to_float(x)
        assert abs(x - arb(value)) <= arb(radius)
    assert reference_._to_float(arb(0.5)) == (0.5, 0.0)


def test_a_leg_without_base_is_a_base_without_inertia() -> None:
    scene = random_scene(2, base=False)
    tiny = {"mass": 1e-300, "J_z": 1e-300}
    with_base = Scene.model_validate(scene.model_dump(by_alias=True) | {"leg": scene.leg.model_dump() | {"base": tiny}})
    row = row_of(from_scene(scene, 3), 1)
    a, b = certified(scene, row), certified(with_base, row)
    assert all(x.overlaps(y) for n in ("F", "M_n") for x, y in zip(components(a[n]), components(b[n]), strict=True))


def test_a_platform_at_rest_without_gravity_has_no_forces(hexapod: Scene) -> None:
    """All balls are exactly zero, and free fall gives balls around zero: both are certified."""
    rest = {name: [0.0, 0.0, 0.0] for name in ROW} | {"position": [0.0, 0.95, 0.0], "quaternion": [1.0, 0.0, 0.0, 0.0]}
    weightless = hexapod.model_copy(update={"gravity": (0.0, 0.0, 0.0)})
    assert all(x == 0 for x in components(certified(weightless, rest)["F_o"]))
    falling = certified(hexapod, rest | {"acceleration": [0.0, -9.81, 0.0]})
    assert 0 < float(falling["F_o"][0][1].rad()) < 1e-20  # legs do not fall freely: they turn about their pins


def test_what_a_residual_is_measured_by() -> None:
    """By hand at rest: weights of all bodies and the platform's inertial force, the load, and what they turn."""
    scene = random_scene(0, base=True, gravity=(1.0, -9.0, 2.0))
    trajectory = from_scene(scene, 1)
    zero = [0.0, 0.0, 0.0]
    rates = dict.fromkeys(("velocity", "angular_velocity", "acceleration", "angular_acceleration"), zero)
    load, norm = scene.load, np.linalg.norm
    assert load
    lever = max(norm(p) for p in scene.pins)
    force = sum(body.mass for body in scene.bodies) * norm(scene.gravity) + norm(load.force)
    moment = force * lever + norm(load.moment)
    got = newton_euler.Sample(scene, row_of(trajectory, 0) | rates)._size()
    np.testing.assert_allclose(got, (force, moment), rtol=1e-12)

    # A platform that turns: about its own inertia in addition, and its pins move the legs.
    still = scene.model_copy(update={"leg": scene.leg.model_copy(update={"base": None})})
    turning = rates | {"angular_velocity": [0.0, 0.3, 0.0], "angular_acceleration": [0.4, 0.0, 0.0]}
    sample = newton_euler.Sample(still, row_of(trajectory, 0) | turning)
    carried = sum(float(m) * norm([float(x) for x in a]) for leg in sample.legs for m, _, a, _ in leg.bodies)
    force = sum(body.mass for body in still.bodies) * norm(scene.gravity) + norm(load.force) + carried
    moment = force * lever + norm(scene.platform.tensor) * (0.4 + 0.3**2) + norm(load.moment)
    np.testing.assert_allclose(sample._size(), (force, moment), rtol=1e-12)
    assert carried > 0.1
