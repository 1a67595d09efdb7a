"""Tables, plots and page of the bench, from a small table."""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest
from rich.console import Console

from stewart_crosscheck.reports import SPEED_ERROR_COLUMNS, print_bench, write_bench
from stewart_crosscheck.reports import plots as reports_plots
from stewart_crosscheck.reports.bench import TITLES, best, number, samples, summary
from stewart_crosscheck.reports.drawing import MARKERS, Plot, styles
from stewart_crosscheck.reports.plots import draw, methods, over_legs, over_samples, work_precision

ROWS = [
    ("driving_forces", "analytic", "closed_form", "numpy", "(7)-(8)", 1, 100.0, 1e-15),
    ("driving_forces", "analytic", "closed_form", "numpy", "(7)-(8)", 1000, 1.0, 1e-15),
    ("driving_forces", "analytic", "closed_form", "float", "(7)-(8)", 1, 80.0, 1e-15),
    ("driving_forces", "mujoco", "kkt", "", "hard loops", 1, 50.0, 2e-15),
    ("driving_forces", "mujoco", "kkt", "", "hard loops", 1000, 20.0, 2e-15),
    ("forward_step", "analytic", "closed_form", "numpy", "form compliance", 1000, 3.0, 1e-15),
    ("forward_step", "mujoco", "native", "", "mj_forward, solimp 0.9", 1000, 10.0, 1e-1),
    ("forward_step", "mujoco", "native", "", "mj_forward, solimp 0.9999", 1000, 12.0, 1e-4),
    ("forward_step", "mujoco", "native", "", "mj_forward, solimp 0.9999", 1, 30.0, 1e-4),
    ("simulate", "analytic", "closed_form", "float", "DOP853, rtol 0.001", 1, 2e4, 1e-4),
    ("simulate", "analytic", "closed_form", "float", "DOP853, rtol 1e-13", 1, 2e5, 0.0),
    ("simulate", "<b>other</b>", "own & kkt", "", "steps, dt 0.01 s", 1, 4e4, 1e-7),
    ("simulate", "pinocchio", "native", "", "RK4, constraintDynamics, mu 1e-10 × 5, dt 0.0025 s", 1, 9e5, 7e-10),
    ("simulate", "broken", "kkt", "", "RK4, dt 0.01 s", 1, np.nan, np.nan),
]


@pytest.fixture(scope="module")
def table() -> pd.DataFrame:
    columns = ["task", "engine", "route", "backend", "setting", "batch", "us_per_sample", "max_rel_error"]
    table = pd.DataFrame(ROWS, columns=columns).assign(scene="hexapod", ratio_to_fastest=1.0)
    table["us_p10"], table["us_p90"] = 0.9 * table["us_per_sample"], 1.2 * table["us_per_sample"]
    return table[SPEED_ERROR_COLUMNS]


@pytest.fixture(scope="module")
def scaling(table: pd.DataFrame) -> pd.DataFrame:
    rows = table[(table["task"] != "simulate")].rename(columns={"task": "what"}).assign(legs=6, peak_mb=1.0)
    legs = rows[:1].assign(what="inverse_kinematics", setting="")
    return pd.concat([rows, legs, legs.assign(legs=12, us_per_sample=300.0, peak_mb=5.0)], ignore_index=True)


@pytest.fixture(scope="module")
def plots(table: pd.DataFrame, scaling: pd.DataFrame) -> dict[str, Plot]:
    return draw(table, scaling, 2.5)


SPLIT = pd.DataFrame(
    [("mujoco", "driving_forces", "kkt", "hard loops", 20.0, 0.6, "mj_inverse", 9.0)],
    columns=["engine", "task", "route", "setting", "us_per_sample", "engine_share", "call", "call_us"],
)

INFO = {
    "run_id": "20260101T000000Z-hexapod-0000",
    "started": "2026-01-01T00:00:00+00:00",
    "command": ["crosscheck", "bench"],
    "versions": {"python": "3.11", "numpy": "2"},
    "machine": {
        "system": "Linux",
        "processor": "x86_64",
        "model": "A <fast> one",
        "cores": 2,
        "usable_cores": 2,
        "memory_gib": 8.0,
    },
    "scene": {"name": "hexapod", "sha256": "0"},
    "seconds": 12.0,
    "plan": {"rounds": 3, "samples": 100},
    "baseline": {"what": "pin.rnea, one call per sample", "us_per_sample": 2.5, "us_p10": 2.4, "us_p90": 2.6},
    "roofline": {"products": 6e10, "stored": 3e10, "loaded": 2e10, "least_us": {"driving_forces": 0.25}},
    "wrong": [],
    "failed": [],
}

FAILED = {
    "task": "simulate",
    "engine": "broken",
    "route": "kkt",
    "backend": "",
    "setting": "RK4, dt 0.01 s",
    "batch": 1,
    "reason": "its process died: <SIGSEGV>",
}

WRONG = {
    "task": "forward_step",
    "engine": "mujoco",
    "route": "kkt",
    "backend": "",
    "setting": "hard loops",
    "batch": 1,
    "max_rel_error": 1e-6,
    "over_tolerance": 1e7,
}


# --- Plots ------------------------------------------------------------------------------------------------------------


def test_every_plot_is_a_well_formed_svg_and_a_png(plots: dict[str, Plot]) -> None:
    assert set(plots) == {"work_precision", "scaling", "legs"}
    for plot in plots.values():
        assert ElementTree.fromstring(plot.svg).tag.endswith("svg")
        assert plot.png.startswith(b"\x89PNG")
    ids = [set(re.findall(r'\bid="([mp][0-9a-f]{10})"', plot.svg)) for plot in plots.values()]
    assert all(ids)
    assert not ids[0] & ids[1] | ids[1] & ids[2] | ids[0] & ids[2]  # one page holds them all


def test_the_same_plot_is_the_same_file(plots: dict[str, Plot], table: pd.DataFrame, scaling: pd.DataFrame) -> None:
    assert draw(table, scaling, 2.5) == plots


def test_every_method_with_numbers_is_named_and_drawn(table: pd.DataFrame) -> None:
    figure = work_precision(table, 2.5)
    assert [axes.get_title() for axes in figure.axes] == [
        "Driving forces",
        "Accelerations from forces",
        "One second of motion",
    ]
    for axes, task in zip(figure.axes, ("driving_forces", "forward_step", "simulate"), strict=True):
        legend = axes.get_legend()
        assert legend is not None
        named = [text.get_text().split("\n")[0] for text in legend.get_texts()]
        rows = table[(table["task"] == task) & table["max_rel_error"].notna()]
        assert named == [f"{' '.join(filter(None, m[:3]))}: {m[3]}" for m in dict.fromkeys(methods(rows))]
        marks = [line for line in axes.get_lines() if line.get_linestyle() == "None"]
        drawn = {(float(x), float(y)) for line in marks for x, y in np.asarray(line.get_xydata()).tolist()}
        unit = 1e-6 if task == "simulate" else 1.0
        assert len(drawn) == len(rows)
        assert {x for x, _ in drawn} == set(rows["us_per_sample"] * unit)
        assert axes.get_xscale() == axes.get_yscale() == "log"
        assert all("[" in label for label in (axes.get_xlabel(), axes.get_ylabel()))


def test_legends_tell_knobs_and_batches(table: pd.DataFrame) -> None:
    axes = work_precision(table, 2.5).axes[1]
    legend = axes.get_legend()
    assert legend is not None
    (text,) = [t.get_text() for t in legend.get_texts() if "mujoco" in t.get_text()]
    assert text == "mujoco native: mj_forward\n   solimp 0.9 … solimp 0.9999\n   batch 1 … $10^{3}$"


def test_the_yardstick_is_drawn_where_it_was_measured(table: pd.DataFrame) -> None:
    with_it, without = (work_precision(table, x).axes[0] for x in (2.5, float("nan")))
    assert [text.get_text() for text in with_it.texts] == ["pin.rnea, open tree"]
    assert not without.texts


def test_methods_differ_without_colour() -> None:
    found = styles((str(k), "", "", "") for k in range(len(MARKERS)))
    assert len({style["marker"] for style in found.values()}) == len(MARKERS)
    assert len({(style["marker"], str(style["linestyle"])) for style in found.values()}) == len(found)


def test_legends_do_not_cover_each_other(table: pd.DataFrame) -> None:
    """Even with as many methods in a panel as a full bench has."""
    simulate = table[table["task"] == "simulate"].iloc[[0]]
    many = pd.concat([simulate.assign(setting=f"integrator {k}, dt 0.1 s") for k in range(16)])
    figure = work_precision(pd.concat([table[table["task"] != "simulate"], many], ignore_index=True), 2.5)
    figure.canvas.draw()
    boxes = [legend.get_window_extent() for axes in figure.axes if (legend := axes.get_legend())]
    assert len(boxes) == 3
    assert not any(a.overlaps(b) for k, a in enumerate(boxes) for b in boxes[:k])


def test_scaling_draws_what_has_more_than_one_batch(scaling: pd.DataFrame) -> None:
    figure = over_samples(scaling)
    (legend,) = figure.legends
    assert [t.get_text() for t in legend.get_texts()] == [
        "analytic closed_form numpy",
        "mujoco kkt",
        "mujoco native",
    ]


def test_legs_are_drawn_beside_their_proportion(scaling: pd.DataFrame) -> None:
    time, memory = over_legs(scaling).axes
    for axes, drawn, straight in ((time, [100.0, 300.0], [100.0, 200.0]), (memory, [1.0, 5.0], [1.0, 2.0])):
        line, proportion = axes.get_lines()
        assert np.array_equal(line.get_ydata(), drawn)
        assert np.array_equal(proportion.get_ydata(), straight)


def test_nothing_to_draw_is_no_plot(table: pd.DataFrame, scaling: pd.DataFrame) -> None:
    assert draw(table[:0], scaling[:0], float("nan")) == {}


# --- Tables -----------------------------------------------------------------------------------------------------------


def test_the_best_of_a_method_is_its_fastest_among_the_most_accurate(table: pd.DataFrame) -> None:
    shown = best(table)
    forward = shown[(shown["task"] == "forward_step") & (shown["engine"] == "mujoco")]
    assert forward[["batch", "us_per_sample", "max_rel_error"]].to_numpy().tolist() == [[1, 30, 1e-4], [1000, 12, 1e-4]]
    assert "broken" not in set(shown["engine"])


def test_numbers_are_short() -> None:
    assert [number(x) for x in (0.0581, 17.64, 1059.0, 293000.0, float("nan"))] == [
        "0.0581",
        "17.6",
        "1,059",
        "293,000",
        "",
    ]
    assert [samples(n) for n in (1, 100, 1000, 1_000_000, 2000)] == ["1", "100", "1e3", "1e6", "2000"]


def test_the_summary_compares_at_equal_error(table: pd.DataFrame) -> None:
    forces, forward, motion = summary(table)
    assert "analytic closed_form numpy with 1 µs, error 1.0e-15" in forces
    assert forces.endswith("mujoco kkt with 20 µs, error 2.0e-15, 20 times as long")
    assert forward.endswith("mujoco native with 12 µs, error 1.0e-04, 4 times as long")
    assert "analytic closed_form float with 200 ms, error 0.0e+00" in motion  # the other one is too wrong
    assert motion.endswith("pinocchio native with 900 ms, error 7.0e-10, 4.5 times as long")


@pytest.mark.parametrize("width", [80, 100, 120, 140])
def test_the_terminal_table_is_never_cut(width: int, table: pd.DataFrame) -> None:
    file = io.StringIO()
    console = Console(width=width, file=file, color_system=None)
    print_bench(table, SPLIT, INFO | {"failed": [FAILED], "wrong": [WRONG]}, console)
    text = file.getvalue()
    lines = text.splitlines()
    tables = [line for line in lines if re.match(r"(engine|analytic|mujoco|pinocchio|─)", line)]
    assert 0 < max(map(len, tables)) <= width
    assert "…" not in text
    for title in (TITLES["driving_forces"], TITLES["forward_step"], TITLES["simulate"]):
        assert title in text
    shown = " ".join(text.split())
    assert "solimp 0.9999" in shown
    assert "ERROR broken kkt simulate RK4, dt 0.01 s, batch 1: its process died: <SIGSEGV>" in shown
    assert "WRONG mujoco kkt forward_step hard loops, batch 1: error 1.0e-06, 1.0e+07 times what is allowed" in shown
    assert "1 wrong, 1 failed in 12 s" in shown


# --- The page ---------------------------------------------------------------------------------------------------------


class Reader(HTMLParser):
    """Text and links of a page; open tags must be closed in order."""

    def __init__(self) -> None:
        super().__init__()
        self.text: list[str] = []
        self.links: list[str] = []
        self.open: list[str] = []
        self.drawings = 0

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.links += [value for name, value in attrs if name in ("src", "href", "xlink:href") and value]
        self.drawings += tag == "svg"
        if tag not in ("meta", "br"):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.links += [value for name, value in attrs if name in ("src", "href", "xlink:href") and value]

    def handle_data(self, data: str) -> None:
        self.text.append(data)

    def all(self) -> str:
        return " ".join(" ".join(self.text).split())


def read(text: str) -> Reader:
    reader = Reader()
    reader.feed(text)
    assert reader.open == []
    return reader


@pytest.fixture
def page(
    tmp_path: Path, table: pd.DataFrame, scaling: pd.DataFrame, plots: dict[str, Plot], monkeypatch: pytest.MonkeyPatch
) -> Callable[[dict], Reader]:
    """The page of these tables, read again."""

    def write(info: dict) -> Reader:
        monkeypatch.setattr(reports_plots, "draw", lambda *_: plots)
        folder = tmp_path / f"{len(list(tmp_path.iterdir()))}"
        write_bench(folder, table, scaling, SPLIT, info)
        return read((folder / "report.html").read_text(encoding="utf-8"))

    return write


def test_the_page_holds_everything_and_nothing_from_elsewhere(
    page: Callable[[dict], Reader], table: pd.DataFrame
) -> None:
    found = page(INFO)
    assert found.drawings == 3
    assert all(link.startswith("#") for link in found.links)
    text = found.all()
    assert "All 14 settings were measured, and every exact one is within its tolerance." in text
    wanted = ("A <fast> one", "<b>other</b>", "own & kkt", "mj_inverse", "pin.rnea, one call per sample")
    wanted = (*wanted, "driving_forces 250 ns (fastest measured 1e+03 ns, 25 %)")
    for words in (*wanted, *summary(table)):
        assert words in text, words
    assert text.index("All 14 settings") < text.index("Best settings") < text.index("Error over time")


def test_the_page_begins_with_what_is_wrong(page: Callable[[dict], Reader]) -> None:
    text = page(INFO | {"failed": [FAILED]}).all()
    assert "1 settings failed to run; the others were measured." in text
    assert "its process died: <SIGSEGV>" in text
    assert "1 exact settings are off by more than their tolerance." in page(INFO | {"wrong": [WRONG]}).all()


def test_a_bench_of_one_engine_without_yardstick_is_written_too(
    tmp_path: Path, table: pd.DataFrame, scaling: pd.DataFrame
) -> None:
    write_bench(
        tmp_path, table[table["engine"] == "mujoco"], scaling[:0], SPLIT, INFO | {"baseline": None, "roofline": None}
    )
    found = read((tmp_path / "report.html").read_text(encoding="utf-8"))
    assert found.drawings == 1
    assert "× rnea:" not in found.all()
