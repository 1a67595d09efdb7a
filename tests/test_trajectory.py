"""Trajectories: rates that are derivatives, files that mean the same, and refusals that name file, line and field."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import parameters
from scipy.spatial.transform import Rotation

from stewart_crosscheck import analytic
from stewart_crosscheck.analytic import stewart
from stewart_crosscheck.analytic.samples import components
from stewart_crosscheck.analytic.solve import conditioned, longest_lever
from stewart_crosscheck.crosscheck import quaternions
from stewart_crosscheck.crosscheck.trajectory import (
    POSE,
    RATES,
    SPLINE_ROWS,
    Trajectory,
    TrajectoryError,
    from_file,
    from_scene,
)
from stewart_crosscheck.models import Scene, load_scene
from stewart_crosscheck.models.reading import printable

COLUMNS = (*POSE, *RATES)


def waves(*components: tuple[float, float, float, float]) -> list[dict[str, Any]]:
    """Components c0 + amplitude sin(omega t + phase)."""
    return [{"c0": c0, "terms": [[amplitude, omega, phase]]} for c0, amplitude, omega, phase in components]


WIDE = waves((0.031, 0.112, 3.1, 0.9), (-0.043, 0.134, 2.7, 2.6), (0.024, 0.097, 3.9, 1.7))
LARGE = waves((0.35, 0.112, 3.1, 0.9), (-0.2, 0.134, 2.7, 2.6), (0.1, 0.097, 3.9, 1.7))
THROUGH_ZERO = waves((0.0, 0.03, 3.1, 0.0), (0.0, 0.04, 2.7, 0.0), (0.0, 0.02, 3.9, 0.0))  # no rotation at t = 0

MOTIONS = {
    "cardan_xyz": ("cardan_xyz", LARGE),
    "rotation_vector, closed form": ("rotation_vector", LARGE),
    "rotation_vector, series": ("rotation_vector", THROUGH_ZERO),
    "rotation_vector, both": ("rotation_vector", WIDE),
}


def turning(scene: Scene, kind: str, components: list[dict[str, Any]]) -> Scene:
    """The scene with another orientation of its motion."""
    data = scene.model_dump(by_alias=True)
    data["motion"]["orientation"] = {"kind": kind, "components": components}
    return Scene.model_validate(data)


@pytest.fixture(params=MOTIONS)
def turned(request: pytest.FixtureRequest, hexapod: Scene) -> Scene:
    return turning(hexapod, *MOTIONS[request.param])


def table(trajectory: Trajectory) -> np.ndarray:
    """Rows of a full trajectory file."""
    return np.column_stack(
        [
            trajectory.t, trajectory.position, trajectory.quaternion, trajectory.velocity, trajectory.angular_velocity,
            trajectory.acceleration, trajectory.angular_acceleration,
        ]
    )  # fmt: skip


def csv(columns: tuple[str, ...], rows: np.ndarray) -> str:
    return "\n".join([",".join(columns), *(",".join(repr(float(x)) for x in row) for row in rows)]) + "\n"


def read(scene: Scene, folder: Path, columns: tuple[str, ...], rows: np.ndarray) -> Trajectory:
    path = folder / "motion.csv"
    path.write_text(csv(columns, rows), encoding="utf-8")
    return from_file(scene, path)


def assert_same(one: Trajectory, two: Trajectory) -> None:
    """Bit for bit, but for the source."""
    for name in vars(one).keys() - {"source", "q", "v", "a"}:
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name), err_msg=name)
    for name in ("q", "v", "a"):
        assert getattr(one, name).keys() == getattr(two, name).keys()
        for coordinate, x in getattr(one, name).items():
            np.testing.assert_array_equal(x, getattr(two, name)[coordinate], err_msg=f"{name} of {coordinate}")


# --- Rates are derivatives --------------------------------------------------------------------------------------------

Pairs = dict[str, tuple[np.ndarray, np.ndarray]]


def slopes(errors: Callable[[int], dict[str, float]], steps: tuple[int, ...]) -> dict[str, np.ndarray]:
    """Observed order between successive refinements, by name."""
    found = [errors(n) for n in steps]
    ratio = np.diff(np.log([n - 1 for n in steps]))
    return {name: -np.diff(np.log([f[name] for f in found])) / ratio for name in found[0]}


def central_errors(scene: Scene, n: int, spoil: float = 0.0) -> dict[str, float]:
    """Largest difference between rates and central differences at the same 19 instants, whatever n is."""
    x = from_scene(scene, n)
    h = x.t[1] - x.t[0]
    at = slice(None, None, (n - 1) // 20)

    def error(value: np.ndarray, rate: np.ndarray) -> float:
        difference = (value[2:] - value[:-2]) / (2 * h) - rate[1:-1]
        return float(np.abs(np.concatenate([[0 * rate[0]], difference, [0 * rate[0]]])[at][1:-1]).max())

    R = x.rotation
    half = 0.5 * (R[2:] @ R[:-2].transpose(0, 2, 1) - R[:-2] @ R[2:].transpose(0, 2, 1))  # sin(angle) [axis]x
    turn = np.stack([half[:, 2, 1], half[:, 0, 2], half[:, 1, 0]], axis=1) / (2 * h) - x.angular_velocity[1:-1]
    errors = {
        "velocity": error(x.position, x.velocity * (1 + spoil)),
        "acceleration": error(x.velocity, x.acceleration * (1 + spoil)),
        "angular_velocity": float(np.abs(np.concatenate([turn[:1], turn, turn[:1]])[at][1:-1]).max()),
        "angular_acceleration": error(x.angular_velocity, x.angular_acceleration * (1 + spoil)),
    }
    for c in scene.coordinates:
        errors[f"velocity of {c}"] = error(x.q[c], x.v[c] * (1 + spoil))
        errors[f"acceleration of {c}"] = error(x.v[c], x.a[c] * (1 + spoil))
    return errors


STEPS = (101, 201, 401, 801)  # 20, 10, 5 and 2.5 ms


def test_rates_of_platform_and_every_joint_are_derivatives_of_order_2(turned: Scene) -> None:
    orders = slopes(lambda n: central_errors(turned, n), STEPS)
    assert len(orders) == 4 + 2 * 18
    for name, order in orders.items():
        # 0.01: the next term of the error is (omega h)^2 / 20 of the first, 1e-3 at the largest step
        np.testing.assert_allclose(order, 2.0, rtol=0, atol=0.01, err_msg=name)


def test_a_rate_off_by_1e_4_has_no_order_2(hexapod: Scene) -> None:
    """At 2.5 ms the differences are good to 1e-5 of a rate: a relative mistake of 1e-4 stops the convergence."""
    orders = slopes(lambda n: central_errors(hexapod, n, spoil=1e-4), STEPS)
    del orders["angular_velocity"]  # not spoilt
    assert all(order[-1] < 1.5 for order in orders.values())


def test_quaternions_have_length_1(turned: Scene) -> None:
    length = np.linalg.norm(from_scene(turned, 201).quaternion, axis=1)
    np.testing.assert_allclose(length, 1.0, rtol=0, atol=1e-15)  # a few units in the last place (2e-16)


@pytest.mark.parametrize("kind", ["cardan_xyz", "rotation_vector"])
def test_orientation_is_the_rotation_that_its_kind_says(hexapod: Scene, kind: str) -> None:
    """cardan_xyz: R = Rx Ry Rz, SciPy's intrinsic XYZ."""
    scene = turning(hexapod, kind, LARGE)
    trajectory = from_scene(scene, 41)
    angles = np.column_stack(
        [c["c0"] + c["terms"][0][0] * np.sin(c["terms"][0][1] * trajectory.t + c["terms"][0][2]) for c in LARGE]
    )
    want = Rotation.from_euler("XYZ", angles) if kind == "cardan_xyz" else Rotation.from_rotvec(angles)
    np.testing.assert_allclose(trajectory.rotation, want.as_matrix(), rtol=0, atol=2e-15)  # some ten roundings


def _jump() -> float:
    """Largest change of (q, q', q'') across the switch from series to closed form at |x|^2 = 1e-2."""
    axis = np.array([[2.0, -3.0, 6.0]]) / 7.0
    dx, ddx = np.array([[1.3, 0.4, -0.7]]), np.array([[-2.1, 0.9, 3.3]])
    below, above = (quaternions.exponential((0.1 * s * axis, dx, ddx)) for s in (1 - 1e-13, 1 + 1e-13))
    return max(float(np.abs(a - b).max()) for a, b in zip(below, above, strict=True))


def test_rotation_vector_is_continuous_where_series_and_closed_form_meet(monkeypatch: pytest.MonkeyPatch) -> None:
    # 1e-13: the two points lie 2e-14 apart; the closed S'' loses 1e-12 by cancellation, times (|x|^2)'^2 = 1e-2
    assert _jump() < 1e-13
    monkeypatch.setattr(quaternions, "SERIES", [series[:2] for series in quaternions.SERIES])
    assert _jump() > 1e-9  # two terms are too few, and the check sees it


def test_series_of_the_rotation_vector_at_zero() -> None:
    """At x = 0: q = 1, q' = x'/2, q'' = x''/2 - |x'|^2/4 in the scalar part."""
    dx, ddx = np.array([[1.3, 0.4, -0.7]]), np.array([[-2.1, 0.9, 3.3]])
    q, dq, ddq = quaternions.exponential((np.zeros((1, 3)), dx, ddx))
    np.testing.assert_array_equal(q, [[1.0, 0.0, 0.0, 0.0]])
    np.testing.assert_array_equal(dq, np.hstack([[[0.0]], dx / 2]))
    # 1e-15: two roundings
    np.testing.assert_allclose(ddq, np.hstack([[[-np.sum(dx**2) / 4]], ddx / 2]), rtol=1e-15)


# --- Poses alone ------------------------------------------------------------------------------------------------------


def spline_errors(scene: Scene, folder: Path, n: int, stride: int = 1) -> dict[str, float]:
    """Largest difference between the rates of a pose-only file and the scene's own."""
    want = from_scene(scene, n)
    got = read(scene, folder, POSE, table(want)[::stride, :8])
    names = ("velocity", "acceleration", "angular_velocity", "angular_acceleration")
    return {name: float(np.abs(getattr(got, name) - getattr(want, name)[::stride]).max()) for name in names}


def test_rates_of_poses_alone_converge_as_quintic_splines_do(hexapod: Scene, tmp_path: Path) -> None:
    orders = slopes(lambda n: spline_errors(hexapod, tmp_path, n), (41, 81, 161, 321))
    for name, order in orders.items():
        # The first derivative of a quintic spline converges with h^5, the second with h^4 (at the ends; within, at the
        # knots, one order faster).  0.25: omega h is 0.35 at the largest step, not yet small.
        expected = 4.0 if "acceleration" in name else 5.0
        np.testing.assert_allclose(order, expected, rtol=0, atol=0.25, err_msg=name)


def test_a_file_of_poses_alone_says_that_its_rates_are_from_splines(hexapod: Scene, tmp_path: Path) -> None:
    got = read(hexapod, tmp_path, POSE, table(from_scene(hexapod, SPLINE_ROWS))[:, :8])
    assert got.source == f"{tmp_path / 'motion.csv'} (rates from quintic splines)"
    assert len(got.t) == 6


def test_uneven_times_are_legal_for_poses_alone(hexapod: Scene, tmp_path: Path) -> None:
    want = from_scene(hexapod, 201)
    rows = np.sort(np.random.default_rng(1).choice(201, 100, replace=False))
    got = read(hexapod, tmp_path, POSE, table(want)[rows, :8])
    # 1e-4 of some 1 m/s: gaps of up to 0.1 s, h^5 x^(6) / 5! = 1e-5 * 3e2 / 120
    np.testing.assert_allclose(got.velocity, want.velocity[rows], rtol=0, atol=1e-4)


def test_signs_of_recorded_quaternions_do_not_matter(hexapod: Scene, tmp_path: Path) -> None:
    rows = table(from_scene(hexapod, 41))[:, :8]
    flipped = rows.copy()
    flipped[np.random.default_rng(0).random(41) < 0.5, 4:] *= -1.0
    assert not np.array_equal(rows, flipped)
    one, two = read(hexapod, tmp_path, POSE, rows), read(hexapod, tmp_path, POSE, flipped)
    np.testing.assert_array_equal(one.rotation, two.rotation)
    np.testing.assert_array_equal(one.angular_velocity, two.angular_velocity)
    np.testing.assert_array_equal(one.angular_acceleration, two.angular_acceleration)


def test_lengths_of_recorded_quaternions_within_1e_6_do_not_matter(hexapod: Scene, tmp_path: Path) -> None:
    rows = table(from_scene(hexapod, 41))[:, :8]
    scaled = rows.copy()
    scaled[:, 4:] *= 1 + 9e-7
    one, two = read(hexapod, tmp_path, POSE, rows), read(hexapod, tmp_path, POSE, scaled)
    # 1e-11: rounding 1e-16 of the components, divided by h^2 = 2.5e-3 and multiplied by the spline's norm, some 1e2
    for name in ("angular_velocity", "angular_acceleration"):
        np.testing.assert_allclose(getattr(one, name), getattr(two, name), rtol=0, atol=1e-11)


# --- Full rows --------------------------------------------------------------------------------------------------------


def test_a_full_file_is_the_trajectory_that_it_was_written_from_bit_for_bit(hexapod: Scene, tmp_path: Path) -> None:
    want = from_scene(hexapod, 21)
    got = read(hexapod, tmp_path, COLUMNS, table(want))
    assert_same(got, want)
    assert got.source == str(tmp_path / "motion.csv")
    spoilt = table(want)
    spoilt[7, 9] = np.nextafter(spoilt[7, 9], np.inf)
    with pytest.raises(AssertionError):
        assert_same(read(hexapod, tmp_path, COLUMNS, spoilt), want)


def test_one_full_row_is_legal(hexapod: Scene, tmp_path: Path) -> None:
    want = from_scene(hexapod, 21)
    got = read(hexapod, tmp_path, COLUMNS, table(want)[4:5])
    assert got.t.shape == (1,)
    for c in hexapod.coordinates:
        assert (got.q[c][0], got.v[c][0], got.a[c][0]) == (want.q[c][4], want.v[c][4], want.a[c][4])


@pytest.mark.parametrize("columns", [POSE, COLUMNS], ids=["poses", "full"])
def test_the_order_of_columns_does_not_matter(hexapod: Scene, tmp_path: Path, columns: tuple[str, ...]) -> None:
    rows = table(from_scene(hexapod, 11))[:, : len(columns)]
    order = np.random.default_rng(2).permutation(len(columns))
    shuffled = tuple(columns[j] for j in order)
    assert shuffled != columns
    assert_same(read(hexapod, tmp_path, shuffled, rows[:, order]), read(hexapod, tmp_path, columns, rows))


def test_spaces_crlf_blank_lines_and_a_byte_order_mark_do_not_matter(hexapod: Scene, tmp_path: Path) -> None:
    rows = table(from_scene(hexapod, 3))
    text = csv(COLUMNS, rows)
    path = tmp_path / "odd.csv"
    path.write_bytes(("\ufeff" + text.replace(",", " , ").replace("\n", "\r\n\r\n")).encode())
    assert_same(from_file(hexapod, path), read(hexapod, tmp_path, COLUMNS, rows))


def test_condition_is_that_of_the_driving_force_equations(hexapod: Scene) -> None:
    trajectory = from_scene(hexapod, 21)
    P = parameters(hexapod)
    legs, loads, _ = stewart.determined(P, components(trajectory.motion), np.sqrt)
    rows, _ = stewart.platform_equations(P, components(trajectory.motion), legs, loads)
    condition = conditioned(np.moveaxis(np.array(rows), -1, 0), longest_lever(P.p))[1]
    # 1e-10: two ways to the rows, each good to 1e-15, times the condition of up to 8
    np.testing.assert_allclose(trajectory.condition, condition, rtol=1e-10)
    smallest = np.min([np.sin(trajectory.q[f"n{i}"]) for i in hexapod.legs], axis=0)
    np.testing.assert_allclose(trajectory.sin_q_n, smallest, rtol=1e-14)  # an arctan and a sine
    assert np.ptp(trajectory.condition) > 0.1  # it changes along the motion: no constant passes


def test_a_scene_without_motion_needs_a_file(hexapod: Scene, tmp_path: Path) -> None:
    still = hexapod.model_copy(update={"motion": None})
    with pytest.raises(TrajectoryError, match=r"^hexapod: motion: missing, expected a \[motion\] table or a traj"):
        from_scene(Scene.model_validate(still.model_dump(by_alias=True)), 5)
    want = from_scene(hexapod, 8)
    assert_same(read(still, tmp_path, COLUMNS, table(want)), want)


# --- Bad files --------------------------------------------------------------------------------------------------------


def edit(row: int, column: str, text: str) -> Callable[[list[list[str]]], None]:
    """Another text in one cell; `row` counts from 1, the header is row 0."""

    def change(cells: list[list[str]]) -> None:
        cells[row][COLUMNS.index(column)] = text

    return change


def quaternion(row: int, *q: float) -> Callable[[list[list[str]]], None]:
    def change(cells: list[list[str]]) -> None:
        cells[row][4:8] = [repr(x) for x in q]

    return change


def drop(*columns: str) -> Callable[[list[list[str]]], None]:
    def change(cells: list[list[str]]) -> None:
        keep = [j for j, name in enumerate(COLUMNS) if name not in columns]
        cells[:] = [[row[j] for j in keep] for row in cells]

    return change


def add(column: str, value: str) -> Callable[[list[list[str]]], None]:
    def change(cells: list[list[str]]) -> None:
        for k, row in enumerate(cells):
            row.append(column if k == 0 else value)

    return change


def keep_rows(n: int, columns: int = len(COLUMNS)) -> Callable[[list[list[str]]], None]:
    def change(cells: list[list[str]]) -> None:
        cells[:] = [row[:columns] for row in cells[: n + 1]]

    return change


BAD: dict[str, tuple[Callable[[list[list[str]]], None], str]] = {
    "missing pose column": (drop("q_z"), "got missing columns 'q_z'; expected t, p_x, "),
    "missing rates": (drop("a_x", "w_z"), "got missing columns 'w_z', 'a_x'; expected t, p_x, "),
    "no time": (drop("t"), "got missing columns 't'; expected t, p_x, "),
    "unknown column": (add("mood", "1.0"), "got unknown columns 'mood'; expected t, p_x, "),
    "repeated column": (add("p_x", "1.0"), "got repeated columns 'p_x'; expected t, p_x, "),
    "trailing comma": (add("", ""), "got unknown columns ''; expected t, p_x, "),
    "no rows": (keep_rows(0), "got a header and no rows, expected at least one row"),
    "text": (edit(3, "v_y", "fast"), "line 4: v_y: got 'fast', expected a finite number"),
    "empty cell": (edit(3, "v_y", " "), "line 4: v_y: got '', expected a finite number"),
    "NaN": (edit(2, "p_x", "nan"), "line 3: p_x: got 'nan', expected a finite number"),
    "inf": (edit(2, "t", "inf"), "line 3: t: got 'inf', expected a finite number"),
    "-inf": (edit(1, "alpha_z", "-inf"), "line 2: alpha_z: got '-inf', expected a finite number"),
    "huge": (edit(1, "w_x", "1e300"), "line 2: w_x: got '1e300', expected a finite number up to 1e+20"),
    "time backwards": (edit(4, "t", "0.1"), "line 5: t: got 0.1 after 0.5714285714285714, expected increasing times"),
    "time stands": (edit(2, "t", "0.0"), "line 3: t: got 0.0 after 0.0, expected increasing times"),
    "zero quaternion": (
        quaternion(5, 0.0, 0.0, 0.0, 0.0),
        "line 6: q_w, q_x, q_y, q_z: got length 0, expected 1 within 1e-6",
    ),
    "long quaternion": (
        quaternion(5, 1.000002, 0.0, 0.0, 0.0),
        "line 6: q_w, q_x, q_y, q_z: got length 1.000002, expected 1 within 1e-6",
    ),
    "ragged, short": (
        lambda cells: cells.__setitem__(2, cells[2][:-1]),
        "line 3: got 19 fields, expected 20 as in the header",
    ),
    "ragged, long": (lambda cells: cells[2].append("0"), "line 3: got 21 fields, expected 20 as in the header"),
    "five poses": (keep_rows(5, len(POSE)), "got 5 rows of poses alone, expected at least 6 for the spline"),
    "one pose": (keep_rows(1, len(POSE)), "got 1 rows of poses alone, expected at least 6 for the spline"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_file_is_refused_by_line_and_field(hexapod: Scene, tmp_path: Path, name: str) -> None:
    change, message = BAD[name]
    cells = [row.split(",") for row in csv(COLUMNS, table(from_scene(hexapod, 8))).splitlines()]
    change(cells)
    path = tmp_path / "bad.csv"
    path.write_text("\n".join(",".join(row) for row in cells) + "\n", encoding="utf-8")
    with pytest.raises(TrajectoryError) as e:
        from_file(hexapod, path)
    assert str(e.value).startswith(f"{path}: {message}")


def test_lines_are_those_of_the_file_whatever_is_blank(hexapod: Scene, tmp_path: Path) -> None:
    text = csv(COLUMNS, table(from_scene(hexapod, 3))).replace("\n2.0,", "\n\n\n0.5,")
    path = tmp_path / "bad.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(TrajectoryError, match=r"line 6: t: got 0\.5 after 1\.0, expected"):
        from_file(hexapod, path)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "got an empty file, expected a header t, p_x, "),
        (b"\n\n", "got an empty file, expected a header t, p_x, "),
        (b"\x89PNG\r\n\x1a\n\xff\x00", "got bytes that are no text, expected a CSV file"),
        (b't,"p_x\n', "got no CSV, expected a trajectory: "),
        (b"t;p_x;p_y\n0.0;1.0;2.0\n", "got unknown columns 't;p_x;p_y'; expected t, p_x, "),
        (b"0.0,1.0,2.0\n", "got unknown columns '0.0', '1.0', '2.0'; expected t, p_x, "),
    ],
    ids=["empty", "blank", "binary", "quote", "semicolons", "no header"],
)
def test_a_file_without_a_table_is_refused(hexapod: Scene, tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "bad.csv"
    path.write_bytes(content)
    with pytest.raises(TrajectoryError) as e:
        from_file(hexapod, path)
    assert str(e.value).startswith(f"{path}: {message}")


@pytest.mark.parametrize(
    ("name", "got"), [("missing.csv", "No such file or directory"), (".", "Is a directory"), ("\0", "null byte")]
)
def test_an_unreadable_path_is_named(hexapod: Scene, tmp_path: Path, name: str, got: str) -> None:
    path = tmp_path / name
    with pytest.raises(TrajectoryError, match="expected a readable CSV file") as e:
        from_file(hexapod, path)
    assert str(e.value).startswith(f"{printable(path)}: ")
    assert got in str(e.value)


@pytest.mark.parametrize("scale", [1e-200, 1e-12])
def test_time_steps_that_overflow_the_rates_are_refused(hexapod: Scene, tmp_path: Path, scale: float) -> None:
    rows = table(from_scene(hexapod, 8))[:, :8]
    rows[:, 0] *= scale
    message = r"motion\.csv: line 2: t: got rates beyond 1e\+20, expected larger time steps"
    with pytest.raises(TrajectoryError, match=message):
        read(hexapod, tmp_path, POSE, rows)


def test_time_steps_too_uneven_for_a_spline_are_refused(hexapod: Scene, tmp_path: Path) -> None:
    rows = table(from_scene(hexapod, 8))[:, :8]
    rows[:, 0] = [0.0, 1e-18, 2e-18, 1.0, 2.0, 3.0, 4.0, 1e20]
    with pytest.raises(
        TrajectoryError, match=r"motion\.csv: t: got steps too uneven for a quintic spline .*, expected"
    ):
        read(hexapod, tmp_path, POSE, rows)


# --- Poses without inverse dynamics -----------------------------------------------------------------------------------


def test_all_platform_pins_in_one_place_are_a_singular_pose(hexapod: Scene) -> None:
    platform = hexapod.platform.model_copy(update={"pins": ((0.1, 0.0, 0.1),) * 6})
    with pytest.raises(TrajectoryError) as e:
        from_scene(hexapod.model_copy(update={"platform": platform}), 5)
    message = r"motion: t = [\d.]+ s: singular pose: sample \d, leg [1-6]: condition of the .* = \S+, above 1e\+12"
    assert e.match(message)


def moved_pin(scene: Scene, leg: int, pin: list[float]) -> Scene:
    """The scene with another hull pin of one leg."""
    pins = list(scene.hull.pins)
    pins[leg - 1] = (pin[0], pin[1], pin[2])
    return scene.model_copy(update={"hull": scene.hull.model_copy(update={"pins": tuple(pins)})})


def tip(scene: Scene, trajectory: Trajectory, leg: int, sample: int) -> np.ndarray:
    return trajectory.position[sample] + trajectory.rotation[sample] @ scene.pins[leg - 1]


def test_a_vertical_leg_is_refused_with_time_leg_and_sine(hexapod: Scene, tmp_path: Path) -> None:
    trajectory = from_scene(hexapod, 8)
    x, _, z = tip(hexapod, trajectory, leg=4, sample=2).tolist()
    below = moved_pin(hexapod, 4, [x, -0.3, z])
    message = r"t = 0\.571429 s: singular pose: sample 2, leg 4: sin q_n = \S+, the leg is vertical"
    with pytest.raises(TrajectoryError, match=rf"motion: {message}"):
        from_scene(below, 8)
    with pytest.raises(TrajectoryError, match=rf"motion\.csv: {message}"):
        read(below, tmp_path, COLUMNS, table(trajectory))
    assert len(from_scene(moved_pin(hexapod, 4, [x + 1e-3, -0.3, z]), 8).t) == 8  # nearly vertical is legal


@pytest.mark.parametrize("length", [0.0, 1e-9, 3e-4])
def test_a_leg_of_hardly_any_length_is_refused(length: float, hexapod: Scene) -> None:
    """A thousandth of the rod's tip a = 0.37 m is the least."""
    trajectory = from_scene(hexapod, 8)
    at_tip = moved_pin(hexapod, 2, (tip(hexapod, trajectory, leg=2, sample=5) + np.array([length, 0.0, 0.0])).tolist())
    message = r"t = 1\.42857 s: singular pose: sample 5, leg 2: length = .*, expected more than 0\.00037 m"
    with pytest.raises(TrajectoryError, match=message):
        from_scene(at_tip, 8)


def test_the_condition_is_that_of_moments_over_the_longest_lever(hexapod: Scene) -> None:
    """By hand: columns [y; r x y / lever], the library's condition number."""
    trajectory = from_scene(hexapod, 3)
    for k in range(3):
        columns = []
        for p, O in zip(hexapod.pins, hexapod.hull.pins, strict=True):
            r = trajectory.rotation[k] @ np.array(p)
            l = trajectory.position[k] + r - O
            y = l / np.linalg.norm(l)
            columns.append([*y, *np.cross(r, y)])
        A = np.array(columns).T
        scaled = A / np.array([[1.0]] * 3 + [[max(np.linalg.norm(p) for p in hexapod.pins)]] * 3)
        assert trajectory.condition[k] == pytest.approx(np.linalg.cond(scaled), rel=1e-12)
        assert abs(np.linalg.cond(A) / np.linalg.cond(scaled) - 1) > 0.1  # the scaling does something


@pytest.mark.parametrize("turn", [1e-3, 1e-6, 1e-9])
def test_legs_that_nearly_meet_in_the_centre_are_ill_conditioned(turn: float, hexapod: Scene) -> None:
    """No force holds a moment there: all three rows are small, and the condition says how small."""
    scene = concurrent(hexapod, turn)
    assert from_scene(scene, 1).condition[0] == pytest.approx(3.34 / turn, rel=0.01)  # the first-order lever of a turn


def test_legs_that_meet_in_the_centre_are_a_singular_pose(hexapod: Scene) -> None:
    with pytest.raises(TrajectoryError, match="in a parallel singularity"):
        from_scene(concurrent(hexapod, 0.0), 1)
    motion = from_scene(concurrent(hexapod, 1e-9), 1).motion
    still = motion._replace(R=np.eye(3)[None])
    with pytest.raises(analytic.SingularPose, match="in a parallel singularity"):
        analytic.inverse_dynamics(concurrent(hexapod, 0.0).parameters, still)


@pytest.mark.parametrize(("i", "j"), [(1, 4), (0, 2), (3, 5), (0, 5), (2, 3)])
def test_the_weakest_leg_is_one_of_those_that_coincide(i: int, j: int, hexapod: Scene) -> None:
    """Two legs between the same points push against each other, and no other leg has a share in that."""
    p, O = list(hexapod.pins), list(hexapod.hull.pins)
    p[j], O[j] = p[i], O[i]
    platform = hexapod.platform.model_copy(update={"pins": tuple(p)})
    hull = hexapod.hull.model_copy(update={"pins": tuple(O)})
    scene = hexapod.model_copy(update={"platform": platform, "hull": hull})
    with pytest.raises(TrajectoryError, match=rf"singular pose: sample \d+, leg [{i + 1}{j + 1}]: condition"):
        from_scene(scene, 5)


def concurrent(scene: Scene, turn: float) -> Scene:
    """Hull pins three times as far as the platform's, in the same directions from its centre; turned by a little."""
    data = scene.model_dump(by_alias=True)
    data["hull"]["pins"] = tuple(tuple(3.0 * x for x in pin) for pin in data["platform"]["pins"])
    data["motion"]["position"] = ({}, {}, {})
    angles = ({"c0": turn}, {"c0": 0.7 * turn}, {"c0": -0.4 * turn})
    data["motion"]["orientation"] = {"kind": "rotation_vector", "components": angles}
    return Scene.model_validate(data)


def test_reach_is_over_the_shortest_length(hexapod: Scene) -> None:
    """The farthest pin over the longest lever, shorter than any leg here; over the shortest leg for a point mass."""
    trajectory = from_scene(hexapod, 3)
    tips = trajectory.position[:, None] + np.einsum("tij,nj->tni", trajectory.rotation, np.array(hexapod.pins))
    far = max(np.linalg.norm(hexapod.hull.pins, axis=1).max(), np.linalg.norm(tips[1], axis=1).max())
    lever = max(np.linalg.norm(p) for p in hexapod.pins)
    assert trajectory.reach[1] == pytest.approx(far / lever, rel=1e-12)
    point = load_scene("pointmass2")
    motion = from_scene(point, 3)
    L = np.linalg.norm(motion.position[1] - np.array(point.hull.pins), axis=1)
    far = max(np.linalg.norm(motion.position[1]), np.linalg.norm(point.hull.pins, axis=1).max())
    assert motion.reach[1] == pytest.approx(far / L.min(), rel=1e-12)


def test_a_path_that_is_no_text_is_spelled_out(hexapod: Scene, tmp_path: Path) -> None:
    path = tmp_path / os.fsdecode(b"mot\xffion.csv")
    with pytest.raises(TrajectoryError, match=r"mot\\udcffion\.csv: No such file"):
        from_file(hexapod, path)
