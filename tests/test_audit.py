"""The audit: every row holds, the table is complete, and a wrong sign anywhere in the formulas turns a row red."""

from __future__ import annotations

import ast
import copy
import importlib
import inspect
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from rich.console import Console

from stewart_crosscheck.analytic import stewart
from stewart_crosscheck.analytic.audit import MARGIN, Case, Row, miss
from stewart_crosscheck.crosscheck import audit, cli
from stewart_crosscheck.crosscheck.audit import COLUMNS, TABLE
from stewart_crosscheck.crosscheck.engine import EngineError
from stewart_crosscheck.models import load_scene
from stewart_crosscheck.reports import print_audit

MEASURED = [row for row in TABLE if row.residual]


@pytest.fixture(scope="module")
def cases() -> dict[str, Case]:
    return audit.cases()


def failing(cases: dict[str, Case], table: list[Row]) -> set[str]:
    with np.errstate(all="ignore"):  # a broken formula may divide by zero
        return {row.key for row in table if audit.measured(row, cases)["verdict"] == "fail"}


# --- The table holds and is complete ----------------------------------------------------------------------------------


@pytest.mark.parametrize("row", TABLE, ids=lambda row: f"{row.kind} {row.key}")
def test_row(row: Row, cases: dict[str, Case]) -> None:
    found = audit.measured(row, cases)
    assert found["verdict"] == ("text" if row.kind == "text" else "pass"), found


def test_every_numbered_equation_is_there_once() -> None:
    assert [row.key for row in TABLE if row.kind == "equation"] == [f"({n})" for n in range(1, 37)]


MISPRINTS = {
    "f_o, display", "M_io, z_i for s_i", "J_3^z = J_s^x", "(7), dots", "(16), dots", "C_p O_r x y_n, first chain",
    "cosines of y_p", "F_o, proof of (26)", "example 1, x_r . x_n", "example 1, dots, x_r", "example 1, dots, y_r",
    "example 3, y_p'' = 0",
}  # fmt: skip
CONTROLS = {"-J_o^z in (4)", "-M_io in (7), (8)", "-G in (21)", "-G in (28)"}
TEXT = {
    "parameters", "L = q_s + a", "states, dots", "J_ai, J_v, m_ai", "renamings", "L^tr", "weight of the base",
    "( )'_r, ( )'_*, ( )'_i", "axes of w_p", "vertical axis", "(24), (25), t^2", "(24), first copy", "(27), J_si^x",
    "(2.7)", "(5.7)", "system (1), (2)", "p^alpha, p^gamma", "system (33)", "(42)-(46)",
}  # fmt: skip


@pytest.mark.parametrize(("kind", "keys"), [("misprint", MISPRINTS), ("control", CONTROLS), ("text", TEXT)])
def test_every_misprint_and_control_is_there_once(kind: str, keys: set[str]) -> None:
    found = [row.key for row in TABLE if row.kind == kind]
    assert len(found) == len(set(found))
    assert set(found) == keys


@pytest.mark.parametrize("row", TABLE, ids=lambda row: f"{row.kind} {row.key}")
def test_what_a_row_names_exists(row: Row, cases: dict[str, Case]) -> None:
    assert row.where
    for name in row.where:
        module, _, attribute = name.rpartition(".")
        assert callable(getattr(importlib.import_module(f"stewart_crosscheck.analytic.{module}"), attribute))
    assert {*row.scenes, *row.refuses} <= set(cases)
    assert row.states
    assert (row.kind == "equation") == (not row.prints) == (not row.correct)
    assert (row.kind in ("misprint", "control")) == (row.printed is not None)
    assert (row.kind == "text") == (row.residual is None) == (row.tolerance is None) == (not row.scenes)
    if row.tolerance:
        assert row.tolerance.why


def test_what_holds_in_any_gravity_is_measured_in_inclined_gravity() -> None:
    """(1)-(19) and the reactions; the scalar forms refuse it."""
    rows = {row.key: row for row in TABLE if row.kind == "equation"}
    inclined = {key for key, row in rows.items() if "hexapod_inclined" in row.scenes}
    assert inclined == {f"({n})" for n in (*range(1, 20), *range(23, 32))}
    refusing = {key: row.refuses for key, row in rows.items() if row.refuses}
    assert refusing == {
        **{f"({n})": ("hexapod_inclined",) for n in (20, 21, 22)},
        "(33)": ("planar3_inclined",),
    }


# --- The cases come from elsewhere ------------------------------------------------------------------------------------


def test_the_sag_of_example_3_and_no_other_is_feasible(cases: dict[str, Case]) -> None:
    """The certified reference accepts the sag, and neither the straight motion nor one off by more than rounding."""
    assert set(cases["collinear_sagging"].motion.ddC_p[:, 1]) == {-7.5}
    for y_acceleration in (0.0, -7.5 * (1.0 - 1e-12), -7.5 * (1.0 + 1e-12)):
        with pytest.raises(EngineError, match="no forces give this motion"):
            audit.case_of(*audit.sagging(float(y_acceleration)))


def test_inertia_of_the_cases_is_that_of_a_cloud_of_points() -> None:
    """Guide and rod as points with their masses, first and second moments: sums of m r^2, no theorem."""
    scene, q_s = load_scene("hexapod"), 0.6
    guide, rod = scene.leg.guide, scene.leg.rod
    points, masses = [], []
    for mass, distance, J_x, J_y in (
        (guide.mass, guide.com, guide.central_J_x, guide.J_y),
        (rod.mass, q_s, rod.J_x, rod.J_z),
    ):
        across, along = np.sqrt(J_y / mass), np.sqrt((J_x - J_y / 2) * 3 / mass)
        for a, b, c in np.vstack([np.eye(3), -np.eye(3)]) * np.sqrt([1.5, 1.0, 1.5]):
            points.append((a * across, distance + b * along, c * across))
            masses.append(mass / 6)
    x, y, z = np.array(points).T
    want = [np.dot(masses, y**2 + z**2), np.dot(masses, x**2 + z**2), np.dot(masses, y)]
    np.testing.assert_allclose(audit.composed_inertia(scene, np.array(q_s)), want, rtol=1e-14)  # a dozen products


def test_truth_off_by_a_millionth_turns_every_row_that_uses_it_red(cases: dict[str, Case]) -> None:
    hexapod = cases["hexapod"]
    for name, rows in {
        "M_s": {"(27)"}, "M_n": {"(28)", "-G in (28)"}, "M_o": {"(29)"}, "F_n": {"(25)"}, "L": {"(10)", "(31)", "(5)"},
        "dL": {"(31)"},
    }.items():  # fmt: skip
        truth = {**hexapod.truth, name: hexapod.truth[name] * (1 + 1e-6)}
        red = failing({**cases, "hexapod": hexapod._replace(truth=truth)}, MEASURED)
        assert rows <= red, name
        assert "(18)" not in red


# --- Every sign, factor and product of the formulas is seen -----------------------------------------------------------

CALLED = {
    "hinge_rates", "in_world", "second_derivative_along", "moment_rate", "momentum_rate_of_leg", "projections_of_F_r",
    "leg_axes", "platform_momentum_rate",
}  # fmt: skip
"""What the functions of the table call, and it does not name."""

FORMULAS = sorted(CALLED | {name.removeprefix("stewart.") for row in MEASURED for name in row.where})

UNSEEN = {
    "joint_moments": {"0.0 * k.L"},  # zeros of the right shape
    "joint_moments_printed": {"0.0 * k.L"},
    "y_x_F_r_printed": {"0.0 * k.L"},
    "leg_axes": {"0.0 * so"},
    "leg_kinematics": {"sub(add(sub(C_p, O), r), (VERTICAL, 0.0, 0.0))"},  # 1e-150 m, which only a vertical leg feels
    # (33) is about gravity along -y_r
    "planar_loads": {"k.c * g[1] - k.s * g[0]"},
    # no load acts on the platform: the paper knows of none
    "platform_equations": {
        "sub(mul(P.m_p, sub(motion.ddC_p, P.g)), force)",
        "sub(platform_momentum_rate(P, motion), moment)",
    },
    "platform_equations_printed": {"b - d"},
    "planar_platform_equations": {
        "P.m_p * (ddC_p[0] - P.g[0]) - f[0]",
        "ddC_p[0] - P.g[0]",
        "P.m_p * (ddC_p[1] - P.g[1]) - f[1]",
        "cos * q[0] - sin * q[1]",
        "sin * q[0] + cos * q[1]",
        "P.J_pz * motion.dw_p[2] - P.load.moment[2] - (lever[0] * f[1] - lever[1] * f[0])",
        "P.J_pz * motion.dw_p[2] - P.load.moment[2]",
        "lever[0] * f[1] - lever[1] * f[0]",
    },
}
"""Changes that change nothing in the cases, and why."""


def mutants(function: Callable[..., Any]) -> Iterator[tuple[str, Callable[..., Any]]]:
    """A function with one sign turned, one product made a quotient, or one number half as large again, each in turn."""
    tree = ast.parse(inspect.getsource(function))
    for i, node in enumerate(ast.walk(tree)):
        changed = copy.deepcopy(tree)
        other = list(ast.walk(changed))[i]
        match other:
            case ast.BinOp(op=ast.Add()):
                other.op = ast.Sub()
            case ast.BinOp(op=ast.Sub()):
                other.op = ast.Add()
            case ast.BinOp(op=ast.Mult()):
                other.op = ast.Div()
            case ast.UnaryOp(op=ast.USub()):
                other.op = ast.UAdd()
            case ast.Constant(value=float(value)) if value:
                other.value = 1.5 * value
            case ast.Call(func=ast.Name(id="add" | "sub" as name), args=[_, ast.expr() as b]) if not isinstance(
                b, ast.Starred
            ):
                other.func = ast.Name("sub" if name == "add" else "add", ast.Load())
            case _:
                continue
        found: dict[str, Any] = {}
        code = compile(ast.fix_missing_locations(changed), function.__name__, "exec")
        exec(code, stewart.__dict__, found)
        yield ast.unparse(node), found[function.__name__]


def _sharpest(row: Row) -> tuple[str, ...]:
    """One scene of a row that sees everything that its others see."""
    return ("hexapod_inclined",) if "hexapod_inclined" in row.scenes else row.scenes[:1]


@pytest.mark.parametrize("name", FORMULAS)
def test_a_wrong_formula_turns_a_row_red(name: str, cases: dict[str, Case], monkeypatch: pytest.MonkeyPatch) -> None:
    own = [row for row in MEASURED if f"stewart.{name}" in row.where]  # first: sooner done
    scenes = {scene for row in own for scene in row.scenes} or {"hexapod"}
    table = [*own, *(r for r in MEASURED if r.kind == "equation" and r not in own and scenes.intersection(r.scenes))]
    table = [row._replace(scenes=_sharpest(row)) for row in table]
    unseen = set()
    for before, mutant in mutants(getattr(stewart, name)):
        monkeypatch.setattr(stewart, name, mutant)
        with np.errstate(all="ignore"):  # a quotient in place of a product may divide by zero
            if not any(audit.measured(row, cases)["verdict"] == "fail" for row in table):
                unseen.add(before)
    assert unseen == UNSEEN.get(name, set())


def _times(k: float, part: int) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """A change of a function: one part of what it gives, times k."""

    def change(function: Callable[..., Any]) -> Callable[..., Any]:
        def changed(*args: Any) -> Any:
            out = list(function(*args))
            out[part] = stewart.mul(k, out[part]) if isinstance(out[part], tuple) else k * out[part]
            return type(function(*args))(*out) if hasattr(function(*args), "_fields") else tuple(out)

        return changed

    return change


BROKEN = {
    # function, part of its result, rows that must turn red: each by a millionth of one part
    "inertia": (2, {"(3)", "(4)", "(5)", "(21)", "(25)", "(33)"}),  # not (28): m_q cancels there
    "leg_loads_scalar": (2, {"(22)"}),
    "joint_forces_printed": (3, {"(26)"}),
    "joint_moments": (2, {"(29)"}),
    "planar_loads_printed": (1, {"(32)", "(33)", "(35)"}),
    "moments_printed": (1, {"(8)", "(13)"}),
    "cosines_printed": (1, {"(7)", "(8)", "(9)", "(11)"}),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_part_off_by_a_millionth_turns_its_rows_red_and_not_all(
    name: str, cases: dict[str, Case], monkeypatch: pytest.MonkeyPatch
) -> None:
    part, rows = BROKEN[name]
    monkeypatch.setattr(stewart, name, _times(1 + 1e-6, part)(getattr(stewart, name)))
    red = failing(cases, MEASURED)
    assert rows <= red
    assert not {"(18)", "(34)", "(36)"} & red


# --- Rows that must fail ----------------------------------------------------------------------------------------------


def _planted(**changes: Any) -> Row:
    row = next(row for row in TABLE if row.key == "-G in (21)")
    return row._replace(**changes)


WRONG = {
    "residual 2.00e-14, allowed 1.0e-14 (loads)": {"residual": lambda case: 2e-14},
    "residual nan, allowed 1.0e-14 (loads)": {"residual": lambda case: float("nan")},
    "printed reading misses by 9.00e-12, expected at least 1.0e-11": {"printed": lambda case: 9e-12},
    "printed reading misses by nan, expected at least 1.0e-11": {"printed": lambda case: float("nan")},
    "accepts hexapod, expected ValueError": {"refuses": ("hexapod",)},
}


@pytest.mark.parametrize("reason", WRONG)
def test_a_wrong_row_fails_and_says_why(reason: str, cases: dict[str, Case]) -> None:
    right, wrong = audit.measured(_planted(), cases), audit.measured(_planted(**WRONG[reason]), cases)
    assert (right["verdict"], right["reason"]) == ("pass", "")
    assert (wrong["verdict"], wrong["reason"]) == ("fail", reason)


def test_a_case_that_is_not_a_number_is_a_miss_that_is_not_one(cases: dict[str, Case]) -> None:
    """One NaN among the samples, or in one of two scenes, is not lost in a largest value."""
    hexapod = cases["hexapod"]
    F = hexapod.truth["F"].copy()
    F[3, 2] = np.nan
    assert np.isnan(miss(F, hexapod.truth["F"], 1.0))
    broken = hexapod._replace(truth={**hexapod.truth, "F": F})
    row = next(row for row in TABLE if row.key == "(2)")
    assert audit.measured(row, {**cases, "hexapod": broken})["verdict"] == "fail"


# --- The command ------------------------------------------------------------------------------------------------------


Status = tuple[int, str, str]


@pytest.fixture
def command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture) -> Callable[..., Status]:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("FORCE_COLOR", raising=False)

    def call(*args: str) -> Status:
        monkeypatch.setattr(sys, "argv", ["crosscheck", "audit", *args])
        with pytest.raises(SystemExit) as e:
            cli.main()
        assert isinstance(e.value.code, int)
        return (e.value.code, *capfd.readouterr())

    return call


def test_the_command_writes_the_table_and_ends_with_0(command: Callable[..., Status], tmp_path: Path) -> None:
    status, out, err = command("--out", "results")
    assert (status, err) == (0, "")
    assert "every equation holds and every misprint shows: 36 equations, 12 misprints" in out
    assert out.endswith("results: results\n")
    assert [path.name for path in (tmp_path / "results").iterdir()] == ["audit.csv"]
    table = pd.read_csv(tmp_path / "results" / "audit.csv", keep_default_na=False)
    assert list(table.columns) == COLUMNS
    assert list(table["row"]) == [row.key for row in TABLE]
    measured = table[table["kind"] != "text"]
    assert set(measured["verdict"]) == {"pass"}
    assert (measured["residual"].astype(float) <= measured["tolerance"].astype(float)).all()
    misprints = measured[measured["kind"] != "equation"]
    assert (misprints["printed_residual"].astype(float) >= MARGIN * misprints["tolerance"].astype(float)).all()


def test_a_broken_formula_ends_with_1(
    command: Callable[..., Status], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The sign of the rod's weight in (20)."""
    scalar = stewart.leg_loads_scalar

    def broken(leg: Any, k: Any, h: Any, g: Any) -> Any:
        loads = scalar(leg, k, h, g)
        return loads._replace(F_is=loads.F_is + 2.0 * leg.m_s * g[1] * k.c)

    monkeypatch.setattr(stewart, "leg_loads_scalar", broken)
    status, out, err = command()
    assert (status, err) == (1, "")
    assert "FAIL (20), (2) in joint rates, gravity along -y_r: residual" in out
    assert "1 of the rows fail" in out
    (folder,) = (tmp_path / "runs").iterdir()
    assert "-audit-" in folder.name
    table = pd.read_csv(folder / "audit.csv").set_index("row")
    assert list(table.index[table["verdict"] == "fail"]) == ["(20)"]


def test_without_the_reference_it_ends_with_3(
    command: Callable[..., Status], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def missing(name: str) -> None:
        raise ImportError("No module named 'flint'")

    monkeypatch.setattr(audit, "load_engine", missing)
    status, out, err = command("--out", "results")
    assert (status, out) == (3, "")
    assert err == (
        "crosscheck: the certified reference is needed and its package is missing: No module named 'flint'\n"
    )
    assert list(tmp_path.iterdir()) == []


def test_a_folder_in_use_ends_with_2(command: Callable[..., Status], tmp_path: Path) -> None:
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "entry").write_text("")
    status, out, err = command("--out", "full")
    assert (status, out) == (2, "")
    assert err.startswith("crosscheck: --out full: got a folder that is not empty, expected ")
    assert [path.name for path in (tmp_path / "full").iterdir()] == ["entry"]


@pytest.mark.parametrize("width", [80, 140])
def test_no_number_is_cut(width: int, capsys: pytest.CaptureFixture) -> None:
    table = audit.audit()
    print_audit(table, Console(width=width))
    lines = capsys.readouterr().out.splitlines()
    assert max(len(line.rstrip()) for line in lines) <= width + 6  # a title may be longer than a narrow terminal
    shown = [word for line in lines for word in line.split()]
    for column in ("residual", "printed_residual"):
        for value in table[column].dropna():
            assert f"{value:.1e}" in shown
    assert shown.count("pass") == len(MEASURED)
