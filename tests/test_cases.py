"""Hard cases: where they really lie, and that answers, sensitivities and conditions grow as theory says."""

from __future__ import annotations

import math
from collections.abc import Iterator

import flint
import numpy as np
import pytest
from flint import arb

from stewart_crosscheck.crosscheck.balls import Vector, cross, dot, minus, plus, times, total, vector
from stewart_crosscheck.crosscheck.cases.machines import SPATIAL
from stewart_crosscheck.crosscheck.certainty import Certain, certain_forward, certain_inverse
from stewart_crosscheck.crosscheck.engines.reference_ import NotCertified
from stewart_crosscheck.crosscheck.hard import Case, Point, family_names, load_family
from stewart_crosscheck.models import Scene, load_scene

CASES = {case.name: case for family in family_names() for case in load_family(family) if isinstance(case, Case)}


@pytest.fixture(autouse=True)
def _many_digits() -> Iterator[None]:
    with flint.ctx.workprec(400):
        yield


def arms(point: Point) -> list[Vector]:
    """R p_i of every leg, balls: v + 2 (w u x v + u x (u x v))/|q|^2, not the builder's way."""
    w, *u = (arb(c) for c in point.row.quaternion)
    n = w * w + dot(vector(u), vector(u))

    def turned(p: Vector) -> Vector:
        once = cross(vector(u), p)
        return plus(p, times(2 / n, plus(times(w, once), cross(vector(u), once))))

    return [turned(vector(p)) for p in point.scene.pins]


def leg_vectors(point: Point) -> list[Vector]:
    """C_p + R p_i - O_oi of every leg, balls."""
    C = vector(point.row.position)
    return [minus(plus(C, r), vector(O)) for r, O in zip(arms(point), point.scene.hull.pins, strict=True)]


def length(*v: arb) -> arb:
    return total(*(x * x for x in v)).sqrt()


def is_zero(*xs: arb) -> bool:
    """Whether nothing but rounding at 400 bits is left."""
    return all(x.contains(0) and float(x.rad()) < 1e-60 for x in xs)


def is_close(found: arb, wanted: float, by: float) -> bool:
    """Whether an achieved parameter is the wanted one within a part of it; zero has to be zero."""
    return abs(float(found / arb(wanted) - 1)) < by if wanted else is_zero(found)


def slope(law: dict[float, float]) -> float:
    """Exponent of a power law through two points."""
    (x0, y0), (x1, y1) = law.items()
    return math.log(y1 / y0) / math.log(x1 / x0)


def largest(sure: Certain, name: str) -> float:
    """Of an answer: driving forces F, or the platform's accelerations a, alpha together."""
    x = sure.result.F if name == "F" else sure.result.platform
    assert x is not None
    return float(np.abs(x).max())


def test_every_case_has_its_own_name_and_valid_points() -> None:
    names = [case.name for family in family_names() for case in load_family(family)]
    assert len(set(names)) == len(names)
    for case in CASES.values():
        assert case.name.isidentifier()
        assert "\n" not in case.title + case.parameter
        assert len(set(case.values)) == len(case.values) >= 10, case.name
        for value in (case.values[0], case.values[-1]):
            scene, row = case.at(value)
            assert Scene.model_validate(scene.model_dump(exclude_none=True, by_alias=True)) == scene
            assert all(type(x) is float for part in row for x in part)
            assert abs(math.hypot(*row.quaternion) - 1.0) <= 1e-6


# --- steep_ ---------------------------------------------------------------------------------------------------------

STEEP = [case for case in CASES.values() if case.name.startswith("steep_")]


@pytest.mark.parametrize("case", STEEP, ids=lambda c: c.name)
def test_a_steep_leg_is_as_steep_as_it_says(case: Case) -> None:
    for s in case.values:
        first, *others = leg_vectors(case.at(s))
        assert is_zero(first[2])
        assert is_close(first[0] / length(*first), s, 1e-3)
        assert min(float(length(l[0], l[2]) / length(*l)) for l in others) > 0.2


@pytest.mark.parametrize("name", ["steep_meridian", "steep_meridian_thin"])
def test_a_leg_in_its_meridian_plane_does_not_leave_it(name: str) -> None:
    """The plane is x_r y_r: the tip has neither velocity nor acceleration along z_r, but the platform has."""
    point = CASES[name].at(1e-4)
    r, row = arms(point)[0], point.row
    w, dw = vector(row.angular_velocity), vector(row.angular_acceleration)
    v_tip = plus(vector(row.velocity), cross(w, r))
    a_tip = plus(vector(row.acceleration), cross(dw, r), cross(w, cross(w, r)))
    assert is_zero(v_tip[2], a_tip[2])
    assert all(float(abs(x)) > 0.1 for x in (v_tip[0], a_tip[0]))
    assert all(abs(x) > 0.1 for x in (row.velocity[2], row.acceleration[2]))


# Exponents over sin q_n: of the largest driving force, and of how far half ulps move the force on the tip.
@pytest.mark.parametrize(
    ("name", "size", "moved"),
    [
        ("static", 0, 0),
        ("rest", -2, -3),
        ("meridian", 0, -4),  # half an ulp turns z_n by ulp/s, which brings back the general motion's 1/s^3
        ("moving", -3, -4),
        ("static_thin", 0, 0),
        ("rest_thin", 0, 0),
        ("meridian_thin", 0, 0),
        ("moving_thin", 0, 0),
    ],
)
def test_forces_of_a_steep_leg_grow_by_its_spin_inertia(name: str, size: int, moved: int) -> None:
    sure = {s: certain_inverse(CASES[f"steep_{name}"].at(s)) for s in (1e-4, 1e-7)}
    assert abs(slope({s: largest(x, "F") for s, x in sure.items()}) - size) < 0.02
    assert abs(slope({s: x.sensitivity["F_r"] for s, x in sure.items()}) - moved) < 0.05
    assert all(x.condition < 300 for x in sure.values())


def test_the_platform_stands_stiff_on_a_steep_leg_with_spin_inertia() -> None:
    """The condition of the accelerations' equations grows as 1/s^2, and does not without that inertia.

    What half ulps do to accelerations and reactions grows as 1/s^2 down to where that condition has no digits left.
    """
    stiff, thin = (
        {s: certain_forward(CASES[f"steep_{name}"].at(s)) for s in (1e-3, 1e-8)} for name in ("moving", "moving_thin")
    )
    assert abs(slope({s: x.condition for s, x in stiff.items()}) + 2) < 0.02
    for name in ("a", "alpha", "F_r"):
        assert abs(slope({s: x.sensitivity[name] for s, x in stiff.items()}) + 2) < 0.02
        assert abs(slope({s: x.sensitivity[name] for s, x in thin.items()})) < 0.02
    assert all(x.condition < 300 for x in thin.values())


def test_a_vertical_leg_has_forces_only_without_spin_inertia() -> None:
    for problem in (certain_inverse, certain_forward):
        with pytest.raises(NotCertified):
            problem(CASES["steep_moving"].at(0.0))
        problem(CASES["steep_moving_thin"].at(0.0))


# --- parallel_ ------------------------------------------------------------------------------------------------------


def yaw(point: Point) -> arb:
    """From how far moments of unit forces along the legs about the vertical axis, over their rise, differ."""
    up = [cross(vector(O), l)[1] / l[1] for O, l in zip(point.scene.hull.pins, leg_vectors(point), strict=True)]
    R_hull, across = arb(65) / 64, arb(1) / 4
    assert all(is_zero(u - up[i % 2]) for i, u in enumerate(up))
    return ((up[0] - up[1]) * leg_vectors(point)[0][1] / (2 * across * R_hull * R_hull)).asin()


def distance_of_two_legs(point: Point) -> arb:
    pins = [[vector(p) for p in part.pins or ()] for part in (point.scene.hull, point.scene.platform)]
    between = [minus(p[1], p[0]) for p in pins]
    assert is_zero(*minus(*between))
    return length(*between[0])


def departure_from_similarity(point: Point) -> arb:
    hull, platform = ([vector(p) for p in pins] for pins in (point.scene.hull.pins, point.scene.pins))
    assert all(is_zero(length(*O) - arb(65) / 64, O[1]) for O in hull)  # on a conic
    differences = [minus(times(arb(2), p), O) for p, O in zip(platform, hull, strict=True)]
    assert all(is_zero(*d) for d in differences[1:])
    return differences[0][1] / 2


def height_over_the_hull(point: Point) -> arb:
    heights = [l[1] for l in leg_vectors(point)]
    assert all(is_zero(h - heights[0]) for h in heights)
    return heights[0]


def angle_to_the_line(point: Point) -> arb:
    l = leg_vectors(point)[0]
    return (l[1] / l[0]).atan()


PARALLEL = {
    "parallel_yaw": yaw,
    "parallel_coincident": distance_of_two_legs,
    "parallel_similar": departure_from_similarity,
    "parallel_flat": height_over_the_hull,
    "parallel_in_line": angle_to_the_line,
    "parallel_along_line": angle_to_the_line,
}


def test_every_parallel_singularity_is_measured() -> None:
    assert set(PARALLEL) == {name for name in CASES if name.startswith("parallel_")}


@pytest.mark.parametrize("name", PARALLEL)
def test_a_parallel_singularity_is_as_near_as_it_says(name: str) -> None:
    for value in CASES[name].values:
        assert is_close(PARALLEL[name](CASES[name].at(value)), value, 1e-3), value


@pytest.mark.parametrize("name", PARALLEL)
def test_conditions_grow_towards_a_parallel_singularity(name: str) -> None:
    """The inverse problem's as one over the distance, and with it forces and what half ulps do; not the forward's."""
    near = {value: CASES[name].at(value) for value in (1e-4, 1e-6)}
    sure = {value: certain_inverse(point) for value, point in near.items()}
    assert abs(slope({v: x.condition for v, x in sure.items()}) + 1) < 0.02
    finite = name == "parallel_along_line"
    assert abs(slope({v: largest(x, "F") for v, x in sure.items()}) + (0 if finite else 1)) < 0.05
    # Heights and angles are small numbers that are given to full accuracy, and so is what follows from them.
    relative = 0 if name in ("parallel_flat", "parallel_in_line", "parallel_along_line") else 1
    of_answer = {v: x.sensitivity["F"] / largest(x, "F") for v, x in sure.items()}
    assert abs(slope(of_answer) + relative) < 0.05
    assert certain_forward(near[1e-6]).condition < 10


@pytest.mark.parametrize("name", PARALLEL)
def test_a_parallel_singularity_is_exact_at_zero(name: str) -> None:
    point = CASES[name].at(0.0)
    if name == "parallel_along_line":  # the motion needs no force across the line, so that there is a shortest answer
        assert certain_inverse(point).result.F.shape == (1, 2)
    else:
        with pytest.raises(NotCertified):
            certain_inverse(point)
    assert certain_forward(point).condition < 10


def test_a_platform_without_gravity_is_given_forces_too() -> None:
    point = CASES["parallel_along_line"].at(0.1)
    assert not any(point.scene.gravity)
    assert min(point.forces) > 1.0


# --- scale_ ---------------------------------------------------------------------------------------------------------

LIGHT = [name for name in CASES if name.startswith("scale_light_")]


def masses(scene: Scene) -> dict[str, float]:
    return {body.name.rstrip("0123456789"): body.mass for body in scene.bodies}


def test_a_machine_far_away_is_the_same_machine() -> None:
    near = leg_vectors(CASES["scale_offset"].at(0.1))
    for offset in CASES["scale_offset"].values:
        far = CASES["scale_offset"].at(offset)
        moved = minus(vector(far.row.position), vector(SPATIAL.position))
        assert is_close(length(*moved), offset, 1e-9)
        gaps = [x for a, b in zip(near, leg_vectors(far), strict=True) for x in minus(a, b)]
        assert max(abs(float(x)) for x in gaps) < 4 * math.ulp(max(offset, 1.0))


def test_sizes_and_inertias_are_as_they_say() -> None:
    hexapod = CASES["scale_size"].at(1.0).scene
    whole = hexapod.leg
    for value in (1e-8, 1e-2, 1e2, 1e12):
        if value < 1.0:
            small = CASES["scale_size"].at(value).scene
            assert np.allclose(np.array(small.pins) / value, hexapod.pins, rtol=1e-15)
            assert np.allclose(np.array(small.platform.tensor) / value**2, hexapod.platform.tensor, rtol=1e-15)
        leg = CASES["scale_leg_inertia"].at(value).scene.leg
        assert abs(leg.guide.central_J_x / whole.guide.central_J_x / value - 1) < 1e-7
        assert abs(leg.rod.J_x / whole.rod.J_x / value - 1) < 1e-15
        leg = CASES["scale_spin"].at(value).scene.leg
        assert leg.base is not None
        assert whole.base is not None
        assert abs(leg.base.J_z / whole.base.J_z / value - 1) < 1e-15
        assert abs(leg.rod.J_z / whole.rod.J_z / min(value, 10.0) - 1) < 1e-15


@pytest.mark.parametrize("name", ["scale_mass", "scale_mass_planar", *LIGHT])
def test_mass_ratios_are_as_they_say(name: str) -> None:
    first, last = (
        {v: masses(CASES[name].at(v).scene) for v in CASES[name].values[:: len(CASES[name].values) - 1]}
    ).items()
    whole = masses(load_scene({"planar": "planar3", "point": "pointmass2"}.get(name.split("_")[-1], "hexapod")))
    for value, found in (first, last):
        if name in LIGHT:
            parts = {"legs": {"base", "guide", "rod"}, "guides": {"guide"}, "rods": {"rod"}}
            light = parts.get(name.split("_")[2], {"platform"})
            for part, mass in found.items():
                assert abs(mass / whole[part] / (value if part in light else 1.0) - 1) < 1e-15
        else:
            for part in ("guide", "rod"):
                ratio = (found["platform"] / whole["platform"]) / (found[part] / whole[part])
                assert abs(ratio / value - 1) < 1e-15


# Exponents over the parameter: of the largest driving force, and of what half ulps do to it over that force.
@pytest.mark.parametrize(
    ("name", "between", "size", "moved"),
    [
        ("scale_offset", (1e3, 1e6), 0, 1),
        ("scale_size", (1e-2, 1e-8), 0, 0),
        ("scale_mass", (1e-4, 1e-12), 0, 0),
        ("scale_mass_planar", (1e4, 1e12), 0, 0),
        ("scale_leg_inertia", (1e4, 1e12), 1, 0),
        ("scale_spin", (1e6, 1e12), 1, 0),
        *((name, (1e-4, 1e-20), 0, 0) for name in LIGHT if name not in ("scale_light_guides", "scale_light_rods")),
    ],
)
def test_size_alone_costs_no_digits(name: str, between: tuple[float, float], size: int, moved: int) -> None:
    sure = {v: certain_inverse(CASES[name].at(v)) for v in between}
    assert abs(slope({v: largest(x, "F") for v, x in sure.items()}) - size) < 0.01
    assert abs(slope({v: x.sensitivity["F"] / largest(x, "F") for v, x in sure.items()}) - moved) < 0.05


@pytest.mark.parametrize(("name", "power"), [("scale_length", 1), ("scale_kilogram", 1), ("scale_time", -2)])
def test_units_change_forces_and_nothing_else(name: str, power: int) -> None:
    """All numbers of scene and motion are in the new units: every reaction is, to rounding."""
    usual = certain_inverse(CASES[name].at(1.0))
    for k in (1e-6, 1e6):
        other = certain_inverse(CASES[name].at(k))
        unit = np.repeat([k if name == "scale_length" else 1.0, 1.0], 3)  # of moments over that of forces
        assert np.allclose(other.result.reactions / unit / k**power, usual.result.reactions, rtol=1e-12, atol=1e-11)
        assert abs(other.condition / usual.condition - 1) < 1e-12
        assert 0.5 < other.sensitivity["F"] / k**power / usual.sensitivity["F"] < 2


def test_bases_of_large_inertia_stand_against_a_light_platform() -> None:
    sure = {v: certain_forward(CASES["scale_spin"].at(v)).condition for v in (1e6, 1e12)}
    assert abs(slope(sure) - 1) < 0.02


# --- motion_ --------------------------------------------------------------------------------------------------------


def q_s(point: Point) -> arb:
    return length(*leg_vectors(point)[0]) - arb(point.scene.leg.a)


def length_over_a(point: Point) -> arb:
    return length(*leg_vectors(point)[0]) / arb(point.scene.leg.a)


def elevation(point: Point) -> arb:
    l = leg_vectors(point)[0]
    return (l[1] / length(*l)).asin()


def half_a_turn_less_q_o(point: Point) -> arb:
    x, _, z = leg_vectors(point)[0]
    assert float(x) > 0.3  # x_n is towards -x_r there
    return (z / x).atan()


def half_a_turn_less_q_n(point: Point) -> arb:
    x, y, _ = leg_vectors(point)[0]
    assert float(y) < 0
    return (x / y).atan()


def quarter_turn_less_q_n(point: Point) -> arb:
    x, y, _ = leg_vectors(point)[0]
    assert float(x) < 0
    return -(y / x).atan()


def half_a_turn_less_angle(point: Point) -> arb:
    w, *u = (arb(c) for c in point.row.quaternion)
    return 2 * (w / length(*u)).atan()


def right_angle_less_cardan(point: Point) -> arb:
    """cos of the middle angle is the length of (R_xx, R_xy), here of its complex number w + iy times x + iz."""
    w, x, y, z = (arb(c) for c in point.row.quaternion)
    xx, xy, n = w * w + x * x - y * y - z * z, 2 * (x * y - w * z), w * w + x * x + y * y + z * z
    return xx if is_zero(xx, xy) else (length(xx, xy) / n).asin()


MOTION = {
    "motion_slide": q_s,
    "motion_short": length_over_a,
    "motion_level": elevation,
    "motion_branch": half_a_turn_less_q_o,
    "motion_down_planar": half_a_turn_less_q_n,
    "motion_level_planar": quarter_turn_less_q_n,
    "motion_half_turn": half_a_turn_less_angle,
    "motion_gimbal": right_angle_less_cardan,
}


@pytest.mark.parametrize("name", MOTION)
def test_a_leg_or_platform_stands_where_it_says(name: str) -> None:
    for value in CASES[name].values:
        assert is_close(MOTION[name](CASES[name].at(value)), value, 0.01), value


@pytest.mark.parametrize(("name", "twist", "rates"), [("speed", 1, 2), ("twist", 1, 0), ("start", None, 1)])
def test_motions_are_as_fast_as_they_say(name: str, twist: int | None, rates: int) -> None:
    case = CASES[f"motion_{name}"]
    for k in (case.values[0], case.values[-1]):
        row, usual = case.at(k).row, CASES["motion_speed"].at(1.0).row
        for part, power in (("velocity", twist), ("angular_velocity", twist), ("acceleration", rates)):
            wanted = 0.0 if power is None else k**power
            assert np.allclose(getattr(row, part), wanted * np.array(getattr(usual, part)), rtol=1e-14, atol=0)


# Exponents over the parameter, of the largest driving force, and of what half ulps do to it over that force.
@pytest.mark.parametrize(
    ("name", "between", "size", "moved"),
    [
        ("motion_speed", (1e-12, 1e-4), 0, 0),
        ("motion_speed", (1e2, 1e8), 2, 0),
        ("motion_twist", (1e4, 1e8), 2, 0),
        ("motion_start", (1e-2, 1e-20), 1, 0),
        ("motion_slide", (1e-5, 1e-13), 0, 0),
        ("motion_short", (0.01, 0.002), -3, -1),
        ("motion_level", (1e-4, 1e-16), 0, 0),
        ("motion_branch", (1e-4, 1e-16), 0, 0),
        ("motion_down_planar", (1e-4, 1e-16), 0, 0),
        ("motion_level_planar", (1e-4, 1e-16), 0, 0),
        ("motion_half_turn", (1e-4, 1e-16), 0, 0),
        ("motion_gimbal", (1e-4, 1e-16), 0, 0),
    ],
)
def test_only_a_short_leg_costs_digits(name: str, between: tuple[float, float], size: int, moved: int) -> None:
    sure = {v: certain_inverse(CASES[name].at(v)) for v in between}
    assert all(x.condition < 40 for x in sure.values())
    assert abs(slope({v: largest(x, "F") for v, x in sure.items()}) - size) < 0.05
    assert abs(slope({v: x.sensitivity["F"] / largest(x, "F") for v, x in sure.items()}) - moved) < 0.1


def test_the_platform_stands_stiff_on_a_short_leg() -> None:
    sure = {v: certain_forward(CASES["motion_short"].at(v)).condition for v in (0.01, 0.002)}
    assert abs(slope(sure) + 2) < 0.05


# --- loops_ ---------------------------------------------------------------------------------------------------------

SHARED = {"platform": ((0, 1), (2, 3), (4, 5)), "hull": ((1, 2), (3, 4), (5, 0))}
BAR = {"platform": ((0, 1),), "hull": ((1, 2),)}
LOOPS = {
    "loops_platform_pins": {"platform": SHARED["platform"]},
    "loops_hull_pins": {"hull": SHARED["hull"]},
    "loops_octahedron": SHARED,
    "loops_bar": BAR,
}


@pytest.mark.parametrize("name", LOOPS)
def test_shared_pins_are_as_near_as_they_say(name: str) -> None:
    for value in CASES[name].values:
        scene = CASES[name].at(value).scene
        pins = {"platform": scene.pins, "hull": scene.hull.pins}
        for part, pairs in LOOPS[name].items():
            for i, j in pairs:
                gap = minus(vector(pins[part][i]), vector(pins[part][j]))
                assert is_close(total(*(abs(x) for x in gap)), value, 1e-15)
        others = [p for part in pins.keys() - LOOPS[name].keys() for p in pins[part]]
        assert len(set(others)) == len(others)


@pytest.mark.parametrize("name", LOOPS)
def test_shared_pins_cost_no_digits(name: str) -> None:
    for problem in (certain_inverse, certain_forward):
        apart, together = problem(CASES[name].at(0.1)), problem(CASES[name].at(0.0))
        assert apart.condition < 10
        assert together.condition < 10
        assert together.sensitivity["F_r"] < 2 * apart.sensitivity["F_r"]


@pytest.mark.parametrize(("name", "fits"), [("loops_legs", 6), ("loops_legs_bar", 3), ("loops_legs_point", 2)])
def test_any_number_of_legs_has_accelerations_and_one_has_forces(name: str, fits: int) -> None:
    for N in (1, fits - 1, fits, fits + 1):
        point = CASES[name].at(float(N))
        assert point.scene.N == N
        if N == fits:
            assert certain_inverse(point).condition < 40
        else:
            with pytest.raises(NotCertified):
                certain_inverse(point)
        assert certain_forward(point).condition < 10
    assert CASES[name].at(12.0).scene.N == 12
    assert len({*CASES[name].at(12.0).scene.hull.pins}) == 12
