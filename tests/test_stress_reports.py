"""Tables, plots and page of hard cases, from a made-up table."""

from __future__ import annotations

import io
import json
import re
from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from rich.console import Console
from test_bench_reports import read

from stewart_crosscheck.crosscheck import cli
from stewart_crosscheck.crosscheck import stress as core
from stewart_crosscheck.reports import STRESS_COLUMNS, print_stress, write_stress
from stewart_crosscheck.reports import stress_plots as reports_plots
from stewart_crosscheck.reports.drawing import Plot, styles
from stewart_crosscheck.reports.stress import OUTCOMES, REASON_COLUMNS, counts, groups, methods, points, verdict
from stewart_crosscheck.reports.stress_matrix import matrix
from stewart_crosscheck.reports.stress_plots import BOTTOM, TOP, Across, draw, error_curves

METHODS = {
    "inverse": [("analytic", "closed_form"), ("analytic", "printed"), ("mujoco", "kkt")],
    "forward": [("analytic", "6+N"), ("mujoco", "kkt"), ("mujoco", "native"), ("<b>[other]</b>", "native")],
}
QUANTITIES = {"inverse": ("F", "M_s"), "forward": ("a", "alpha")}
KEY = ("case", "value", "engine", "route", "problem", "quantity")
VALUES = (1e-1, 1e-4, 1e-8, 0.0)
SENSITIVITY = 1e-15
REASON = "sample 0: [bold]condition[/] <1e13> & more"

Row = dict[str, Any]
OURS: Row = dict(zip(KEY, ("steep", 1e-4, "mujoco", "kkt", "forward", "alpha"), strict=True))
"""One row among the accurate ones."""


def silent(error: float, reason: str = "9 times what the route states") -> Row:
    return {"max_rel_error": error, "outcome": "silent", "reason": reason}


REFUSED = {"max_rel_error": np.nan, "outcome": "refused", "reason": REASON}
UNKNOWN = silent(np.nan, "an answer where there is no certain one")
DEGRADED = {"max_rel_error": 1e-9, "outcome": "degraded", "reason": "1e6 times, within the 1e-8 that the route states"}


def end(case: str, value: float, engine: str, route: str, problem: str, quantity: str) -> Row:
    """What is not accurate: the printed form, all forces at zero, and near it engines' own solvers."""
    if case == "steep" and value == 0.0 and problem == "inverse":
        return REFUSED | {"input_sensitivity": np.nan}
    if case == "steep" and 0.0 < value < 1e-1 and route == "printed" and quantity == "F":
        return DEGRADED
    if case == "steep" and value <= 1e-8 and (engine, route, quantity) == ("mujoco", "native", "alpha"):
        return silent(5e7)
    if case == "steep" and value == 0.0 and engine == "<b>[other]</b>":
        return UNKNOWN
    return {}


def made() -> pd.DataFrame:
    """Two cases, of which one reaches zero."""
    rows = []
    for case, family, values in (("steep", "steep", VALUES), ("offset", "scale", (1.0, 2.0, 3.0))):
        parameter = "sin q_n, 1" if case == "steep" else "offset, m"
        of_case = {"case": case, "family": family, "title": "A leg at $s$ of <its> axis", "parameter": parameter}
        for value, (problem, found) in product(values, METHODS.items()):
            for (engine, route), quantity in product(found, QUANTITIES[problem]):
                which = (case, value, engine, route, problem, quantity)
                k = QUANTITIES[problem].index(quantity)
                sizes = {"max_rel_error": (1 + k) * SENSITIVITY, "input_sensitivity": (2 - k) * SENSITIVITY}
                well = {**sizes, "condition": 10.0, "stated": 1e-13, "outcome": "accurate", "reason": ""}
                rows.append(of_case | dict(zip(KEY, which, strict=True)) | well | end(*which))
    return pd.DataFrame(rows)


def changed(table: pd.DataFrame, where: Row, to: Row) -> pd.DataFrame:
    """A copy of which one row says something else."""
    table = table.copy()
    which = np.all([table[name] == value for name, value in where.items()], axis=0)
    assert which.sum() == 1
    table.loc[which, [*to]] = [*to.values()]
    return table


@pytest.fixture(scope="module")
def table() -> pd.DataFrame:
    return made()


@pytest.fixture(scope="module")
def found(table: pd.DataFrame) -> pd.DataFrame:
    return points(table)


@pytest.fixture(scope="module")
def plots(found: pd.DataFrame) -> dict[str, Plot]:
    return draw(found)


INFO = {
    "run_id": "20260101T000000Z-stress-0000",
    "started": "2026-01-01T00:00:00+00:00",
    "command": ["crosscheck", "stress"],
    "versions": {"python": "3.11", "numpy": "2"},
    "machine": {
        "system": "Linux", "processor": "x86_64", "model": "A <fast> one", "cores": 2, "usable_cores": 2,
        "memory_gib": 8.0,
    },
    "seconds": 12.0,
    "failed": {},
}  # fmt: skip

FAILED = INFO | {"failed": {"dart": "missing package: No module named [dartpy]"}}


# --- Points and counts ------------------------------------------------------------------------------------------------


def test_a_point_ends_as_the_worst_of_its_quantities(table: pd.DataFrame, found: pd.DataFrame) -> None:
    assert len(found) == len(table) / 2
    assert not found.duplicated(["case", "value", "engine", "route", "problem"]).any()
    (point,) = found.query("route == 'printed' and value == 1e-4").to_dict("records")
    assert (point["outcome"], point["max_rel_error"], point["input_sensitivity"]) == ("degraded", 1e-9, 2e-15)
    assert point["reason"].endswith("that the route states")
    worse = points(changed(table, OURS, {"outcome": "refused", "max_rel_error": np.nan, "reason": "why"}))
    (point,) = worse.query("engine == 'mujoco' and route == 'kkt' and value == 1e-4 and problem == 'forward'").to_dict(
        "records"
    )
    assert (point["outcome"], point["max_rel_error"], point["reason"]) == ("refused", 1e-15, "why")


def test_a_refused_point_has_the_sensitivity_of_the_others(table: pd.DataFrame) -> None:
    lost = REFUSED | {"input_sensitivity": np.nan}
    both = changed(changed(table, OURS, lost), OURS | {"quantity": "a"}, lost)
    found = points(both)
    assert found["input_sensitivity"].isna().sum() == 3  # all at zero, where there is no truth
    assert letters(found)[0, 4] == "R"


def test_a_long_title_leaves_the_legend_alone(found: pd.DataFrame) -> None:
    rows = found[(found["case"] == "steep") & (found["problem"] == "forward")].assign(title="a long title " * 12)
    drawn = error_curves(rows, styles(methods(found)))
    drawn.canvas.draw()
    title = drawn.get_suptitle()
    assert title.count("\n") == 2
    (text,) = [t for t in drawn.texts if t.get_text() == title]
    assert not text.get_window_extent().overlaps(drawn.legends[0].get_window_extent())


def test_every_point_is_counted_once(found: pd.DataFrame) -> None:
    table = counts(found)
    assert table["problem"].tolist() == ["inverse"] * 3 + ["forward"] * 4
    by = {(row["engine"], row["route"], row["problem"]): row for row in table.to_dict("records")}
    for row in by.values():
        assert row["points"] == sum(row[name] for name in OUTCOMES) == 7
    assert [by["analytic", "printed", "inverse"][name] for name in OUTCOMES] == [4, 2, 1, 0]
    assert [by["mujoco", "native", "forward"][name] for name in OUTCOMES] == [5, 0, 0, 2]


def test_a_silent_row_of_ours_changes_counts_and_verdict(table: pd.DataFrame, found: pd.DataFrame) -> None:
    assert verdict(found, INFO) == (
        True,
        "nothing of ours is silent: 41 accurate, 2 degraded, 3 refused, 3 silent of engines' own solvers",
    )
    worse = points(changed(table, OURS, silent(1e-3)))
    assert verdict(worse, INFO) == (
        False,
        "silent answers of ours: 1: 40 accurate, 2 degraded, 3 refused, 3 silent of engines' own solvers",
    )
    assert counts(worse)["silent"].sum() == counts(found)["silent"].sum() + 1


def test_an_engine_that_did_not_run_is_no_success(found: pd.DataFrame) -> None:
    good, text = verdict(found, FAILED)
    assert not good
    assert text.startswith("nothing of ours is silent, but dart failed to run: ")


def test_groups_tell_where_how_far_and_why(found: pd.DataFrame) -> None:
    own, other = groups(found, "silent")
    assert (own.method, own.problem, own.case) == ("mujoco native", "forward", "steep")
    assert (own.where, own.points, own.error) == ("1e-08 … 0 (sin q_n, 1)", 2, "5.0e+07")
    assert (other.where, other.error) == ("0 (sin q_n, 1)", "")
    assert other.reason == "an answer where there is no certain one"
    assert [group.points for group in groups(found, "refused")] == [1, 1, 1]
    assert [group.method for group in groups(found, "degraded")] == ["analytic printed"]


def test_the_reason_of_a_group_is_that_of_its_largest_error(table: pd.DataFrame) -> None:
    where = {"case": "steep", "value": 1e-8, "engine": "mujoco", "route": "native", "quantity": "alpha"}
    own = groups(points(changed(table, where, silent(9e9, "the worst"))), "silent")[0]
    assert (own.error, own.reason) == ("9.0e+09", "the worst")


# --- The terminal -----------------------------------------------------------------------------------------------------


def printed(table: pd.DataFrame, info: Row, width: int = 80) -> str:
    file = io.StringIO()
    print_stress(table, info, Console(width=width, file=file, color_system=None))
    return file.getvalue()


@pytest.mark.parametrize("width", [80, 100, 140])
def test_the_terminal_tells_counts_and_every_silent_group(table: pd.DataFrame, width: int) -> None:
    text = printed(table, FAILED, width)
    lines = text.splitlines()
    assert max(len(line) for line in lines if re.match(r"(engine|analytic|mujoco|<b>|─)", line)) <= width
    assert "Accelerations under given forces" in lines
    assert [line.split() for line in lines if re.match("analytic +printed", line)] == [
        ["analytic", "printed", "7", "4", "2", "1"]
    ]
    assert any(line.split() == ["<b>[other]</b>", "native", "7", "6", "1"] for line in lines)
    assert (
        "SILENT mujoco native, forward: steep at 1e-08 … 0 (sin q_n, 1): error up to 5.0e+07: 9 times what the route"
        " states"
    ) in lines
    assert (
        "SILENT <b>[other]</b> native, forward: steep at 0 (sin q_n, 1): an answer where there is no certain one"
        in lines
    )
    assert "ERROR dart: missing package: No module named [dartpy]" in lines
    assert lines[-1].startswith("nothing of ours is silent, but dart failed to run: 41 accurate, ")
    assert lines[-1].endswith(", in 12 s")


def test_the_terminal_names_what_of_ours_is_silent(table: pd.DataFrame) -> None:
    assert "SILENT mujoco kkt" not in printed(table, INFO)
    text = printed(changed(table, OURS, silent(1e-3, "it said nothing")), INFO)
    assert "SILENT mujoco kkt, forward: steep at 0.0001 (sin q_n, 1): error up to 1.0e-03: it said nothing\n" in text
    assert "silent answers of ours: 1: " in text


# --- Plots ------------------------------------------------------------------------------------------------------------


def figure(found: pd.DataFrame, case: str = "steep") -> Figure:
    return error_curves(found[found["case"] == case], styles(methods(found)))


def marked(axes: Axes, gid: str) -> set[tuple[float, float]]:
    """Places of the marks of a kind."""
    lines = [line for line in axes.get_lines() if line.get_gid() == gid]
    return {(float(x), float(y)) for line in lines for x, y in np.asarray(line.get_xydata()).tolist()}


def test_every_plot_is_a_well_formed_svg_and_a_png(plots: dict[str, Plot]) -> None:
    assert set(plots) == {"stress_steep", "stress_offset", "outcomes"}
    for plot in plots.values():
        assert ElementTree.fromstring(plot.svg).tag.endswith("svg")
        assert plot.png.startswith(b"\x89PNG")


def test_a_panel_for_each_problem_a_curve_for_each_method(found: pd.DataFrame) -> None:
    strips, panels = np.reshape(np.array(figure(found).axes), (2, 2))
    titles = ["Forces and reactions of a motion", "Accelerations under given forces"]
    assert [axes.get_title() for axes in strips] == titles
    for axes, names in zip(panels, METHODS.values(), strict=True):
        assert sum(line.get_linestyle() != "None" for line in axes.get_lines()) == len(names)
        assert axes.get_xlabel() == "sin q_n, 1"
        assert axes.get_yscale() == "log"
    assert panels[0].get_ylabel() == "largest error over scale [1]"
    (legend,) = figure(found).legends
    named = [text.get_text() for text in legend.get_texts()]
    assert named[:6] == [" ".join(pair) for pair in methods(found)]
    assert named[6:] == [
        "full: accurate", "hollow: degraded", "ringed: silent", "in the strip: refused", "up to the input sensitivity",
        "up to 100 times it", "no certified truth",
    ]  # fmt: skip


def test_outcomes_have_their_marks(found: pd.DataFrame) -> None:
    strips, (inverse, forward) = np.reshape(np.array(figure(found).axes), (2, 2))
    assert marked(inverse, "degraded") == {(-4.0, 1e-9), (-8.0, 1e-9)}
    hollow = [line for line in inverse.get_lines() if line.get_gid() == "degraded"]
    assert {line.get_markerfacecolor() for line in hollow} == {"white"}
    zero = Across(found.loc[found["case"] == "steep", "value"]).zero
    assert marked(forward, "ring") == {(-8.0, TOP), (zero, TOP)}
    assert marked(strips[0], "refused") == {(zero, 0.0), (zero, -1.0), (zero, -2.0)}  # a line for each method
    assert not marked(strips[1], "refused")
    assert marked(strips[1], "ring") == {(zero, 0.0)}  # an answer that nothing can be compared with
    labels = [text.get_text() for text in inverse.get_yticklabels()]
    assert "≥ $10^{3}$" in labels


def test_a_silent_row_gets_a_ring(table: pd.DataFrame, found: pd.DataFrame) -> None:
    def rings(found: pd.DataFrame) -> set[tuple[float, float]]:
        return marked(np.reshape(np.array(figure(found).axes), (2, 2))[1, 1], "ring")

    assert rings(points(changed(table, OURS, silent(1e-3)))) - rings(found) == {(-4.0, 1e-3)}


def test_nothing_is_drawn_across_the_break_before_zero(found: pd.DataFrame) -> None:
    _, (_, forward) = np.reshape(np.array(figure(found).axes), (2, 2))
    across = Across(found.loc[found["case"] == "steep", "value"])
    assert across.zero < -8.0
    curves = [line for line in forward.get_lines() if line.get_linestyle() != "None"]
    for line in curves:
        x, y = np.asarray(line.get_xydata()).T
        assert np.isnan(y[x == across.zero]).all()
        assert np.isfinite(y[x != across.zero]).all()
    assert [text.get_text() for text in forward.texts] == ["//"]
    assert forward.get_xticklabels()[-1].get_text() == "0"


def test_the_floor_is_the_input_sensitivity(found: pd.DataFrame) -> None:
    _, (inverse, forward) = np.reshape(np.array(figure(found).axes), (2, 2))
    for axes, stretches, unknown in ((inverse, 1, 1), (forward, 2, 0)):  # beside the break stands one of its own
        shades = [c for c in axes.collections if c.get_gid() == "sensitivity"]
        assert len(shades) == stretches
        assert len([p for p in axes.patches if p.get_gid() == "no truth"]) == unknown
        for shade in shades:
            y = shade.get_paths()[0].vertices[:, 1]
            assert {f"{h:.3g}" for h in np.unique(y)} == {f"{BOTTOM:.3g}", f"{2 * SENSITIVITY:.3g}"}
        near = [c.get_paths()[0].vertices[:, 1].max() for c in axes.collections if c.get_gid() == "near"]
        assert near == pytest.approx([200 * SENSITIVITY] * stretches)


@pytest.mark.parametrize(
    ("values", "places", "zero"),
    [
        ([1.0, 2.0, 12.0], [1.0, 2.0, 12.0], False),
        ([1e-3, 1e3], [-3.0, 3.0], False),
        ([0.0, 1e-1, 1e-16], [-17.8, -1.0, -16.0], True),
        ([0.0, 1.0, 2.0], [0.0, 1.0, 2.0], False),
        ([-1.0, 100.0], [-1.0, 100.0], False),
        ([0.0], [0.0], False),
    ],
)
def test_long_ranges_stand_by_powers_of_ten(values: list[float], places: list[float], zero: bool) -> None:
    across = Across(pd.Series(values))
    assert across.places == pytest.approx(places)
    assert np.isfinite(across.zero) == zero


def test_a_perfect_answer_is_drawn(table: pd.DataFrame) -> None:
    rows = table.assign(max_rel_error=0.0, outcome="accurate", input_sensitivity=2.0**-53)
    drawn = marked(figure(points(rows)).axes[2], "accurate")
    assert {y for _, y in drawn} == {BOTTOM}


def test_methods_look_the_same_in_every_figure(found: pd.DataFrame) -> None:
    legends = [figure(found, case).legends[0].get_lines() for case in ("steep", "offset")]
    looks = [{line.get_label(): (str(line.get_marker()), str(line.get_color())) for line in lines} for lines in legends]
    shared = [" ".join(pair) for pair in methods(found)]
    assert [looks[0][name] for name in shared] == [looks[1][name] for name in shared]
    assert len({marker for name, (marker, _) in looks[0].items() if name in shared}) == len(shared)


def letters(found: pd.DataFrame) -> dict[tuple[int, int], str]:
    (axes,) = matrix(found).axes
    return {
        (int(text.get_position()[1]), int(text.get_position()[0])): text.get_text()
        for text in axes.texts
        if text.get_gid() == "outcome"
    }


def test_the_matrix_has_the_worst_outcome_of_every_case_and_method(table: pd.DataFrame, found: pd.DataFrame) -> None:
    rows = ["".join(letters(found)[row, column] for column in range(7)) for row in range(2)]
    assert rows == ["ADAAASS", "AAAAAAA"]
    worse = letters(points(changed(table, OURS, silent(1e-3))))
    assert {place for place in worse if worse[place] != letters(found)[place]} == {(0, 4)}
    assert worse[0, 4] == "S"


def test_a_refusal_counts_where_there_is_truth_or_nothing_else(table: pd.DataFrame, found: pd.DataFrame) -> None:
    assert letters(points(changed(table, OURS, REFUSED)))[0, 4] == "R"
    nothing = found[(found["case"] != "steep") | (found["outcome"] == "refused")]
    assert [letters(nothing)[0, column] for column in range(3)] == ["R"] * 3


def test_what_was_not_asked_is_empty_in_the_matrix(found: pd.DataFrame) -> None:
    some = found[(found["case"] == "steep") | (found["problem"] == "forward")]
    assert len(letters(some)) == 7 + 4


# --- Files ------------------------------------------------------------------------------------------------------------


@pytest.fixture
def written(
    tmp_path: Path, table: pd.DataFrame, plots: dict[str, Plot], monkeypatch: pytest.MonkeyPatch
) -> Callable[..., Path]:
    """Folder of these tables' files."""

    def write(table: pd.DataFrame = table, info: Row = INFO) -> Path:
        monkeypatch.setattr(reports_plots, "draw", lambda found: plots)
        folder = tmp_path / f"{len(list(tmp_path.iterdir()))}"
        write_stress(folder, table, info)
        return folder

    return write


def test_the_files(written: Callable[..., Path], table: pd.DataFrame, found: pd.DataFrame) -> None:
    folder = written()
    names = {"stress.csv", "reasons.csv", "outcomes.csv", "report.html", "run.json"}
    drawn = {f"{name}.{kind}" for name in ("stress_steep", "stress_offset", "outcomes") for kind in ("svg", "png")}
    assert {path.name for path in folder.iterdir()} == names | drawn
    stress = pd.read_csv(folder / "stress.csv")
    assert list(stress) == STRESS_COLUMNS
    pd.testing.assert_frame_equal(stress, table[STRESS_COLUMNS])
    reasons = pd.read_csv(folder / "reasons.csv")
    assert list(reasons) == REASON_COLUMNS
    assert len(reasons) == 2 + 3 + 3
    assert reasons["reason"].notna().all()
    assert REASON in set(reasons["reason"])
    outcomes = pd.read_csv(folder / "outcomes.csv")
    pd.testing.assert_frame_equal(outcomes, counts(found))
    assert json.loads((folder / "run.json").read_text(encoding="utf-8")) == INFO


def test_the_page_holds_everything_and_nothing_from_elsewhere(written: Callable[..., Path]) -> None:
    page = read((written() / "report.html").read_text(encoding="utf-8"))
    assert page.drawings == 3
    assert all(link.startswith("#") for link in page.links)
    text = page.all()
    for words in ("nothing of ours is silent: 41 accurate", "<b>[other]</b>", REASON, "A <fast> one", "1e-08 … 0"):
        assert words in text, words
    assert text.index("silent: 2 times a method and a case") < text.index("degraded: 1 times")


def test_the_page_begins_with_what_is_wrong(written: Callable[..., Path], table: pd.DataFrame) -> None:
    def head(info: Row, table: pd.DataFrame = table) -> str:
        return read((written(table, info) / "report.html").read_text(encoding="utf-8")).all().split("What became")[0]

    assert "dart failed to run: missing package: No module named [dartpy]" in head(FAILED)
    assert "silent answers of ours: 1:" in head(INFO, changed(table, OURS, silent(1e-3)))


# --- The command ------------------------------------------------------------------------------------------------------


@pytest.fixture
def command(
    tmp_path: Path, plots: dict[str, Plot], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> Callable[..., tuple[int, str, str, list]]:
    """`crosscheck stress` with a table in place of the work: status, output, messages, and what was asked for."""

    def run(table: pd.DataFrame, silent_of_ours: int, failed: dict[str, str], *args: str) -> tuple:
        asked = []

        def stress(*given: Any) -> core.StressReport:
            asked.extend(given[:3])
            given[3]("steep: steep analytic", 2)
            given[3]("scale: offset mujoco", 3)
            given[3]("steep: steep mujoco", 3)
            return core.StressReport(table, INFO | {"silent_of_ours": silent_of_ours, "failed": failed})

        monkeypatch.setattr(core, "stress", stress)
        monkeypatch.setattr(reports_plots, "draw", lambda found: plots)
        monkeypatch.setattr("sys.argv", ["crosscheck", "stress", "--out", str(tmp_path / "out"), *args])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        out, err = capsys.readouterr()
        return ended.value.code, out, err, asked

    return run


def test_the_command_asks_for_what_it_is_told(command: Callable, table: pd.DataFrame, tmp_path: Path) -> None:
    status, out, err, asked = command(
        table, 0, {}, "--family", "steep", "--family", "scale", "--engine", "dart", "--quick"
    )
    assert status == 0
    assert asked == [["steep", "scale"], ["dart"], core.QUICK]
    assert err.splitlines() == ["steep", "scale", f"writing {tmp_path / 'out'}"]
    assert "nothing of ours is silent: 41 accurate" in out
    assert out.splitlines()[-1] == f"results: {tmp_path / 'out'}"
    assert (tmp_path / "out" / "stress.csv").exists()


def test_the_command_asks_for_everything_by_itself(command: Callable, table: pd.DataFrame) -> None:
    assert command(table, 0, {})[3] == [(), (), core.FULL]


@pytest.mark.parametrize(
    ("silent_of_ours", "failed", "status"), [(0, {}, 0), (1, {}, 1), (0, {"dart": "gone"}, 3), (1, {"dart": "gone"}, 1)]
)
def test_the_status_tells_what_was_found(
    command: Callable, table: pd.DataFrame, silent_of_ours: int, failed: dict[str, str], status: int
) -> None:
    table = changed(table, OURS, silent(1e-3)) if silent_of_ours else table
    found, out, _, _ = command(table, silent_of_ours, failed)
    assert found == status
    assert ("silent answers of ours: 1" in out) == bool(silent_of_ours)
