"""`stress`: cases posed, asked and judged; engines that die, and what is then said of them."""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path

import numpy as np
import pytest

from stewart_crosscheck.crosscheck import cases
from stewart_crosscheck.crosscheck import stress as stress_module
from stewart_crosscheck.crosscheck.engine import UnknownEngine
from stewart_crosscheck.crosscheck.hard import UnknownFamily, decades, family_names, load_family
from stewart_crosscheck.crosscheck.outcome import ACCURATE, REFUSED, SILENT
from stewart_crosscheck.crosscheck.run import DISAGREE, ENGINE_FAILED
from stewart_crosscheck.crosscheck.stress import FULL, QUICK, Plan, pose, stress
from stewart_crosscheck.crosscheck.units.stress_ import checks
from stewart_crosscheck.reports.stress import STRESS_COLUMNS, write_stress

FAMILY = '''
"""A family that is no more than a mass."""
from stewart_crosscheck.crosscheck.hard import Case, Point, Row
from stewart_crosscheck.models import load_scene

SCENE = load_scene("hexapod")
ROW = Row(
    (0.02, 0.94, -0.02), (1.0, 0.01, 0.02, 0.03), (0.1, 0.2, 0.3), (0.3, 0.2, 0.1), (1.0, 2.0, 3.0), (3.0, 2.0, 1.0)
)

def at(mass):
    return Point(SCENE.model_copy(update={"platform": SCENE.platform.model_copy(update={"mass": mass})}), ROW)

CASES = (Case("mass_up", "a heavier platform", "mass [kg]", (1.0, 10.0, 100.0, 1000.0), at),)
'''


@pytest.fixture
def tiny(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """One more family, from a file of its own."""
    (tmp_path / "tiny_.py").write_text(FAMILY)
    monkeypatch.setattr(cases, "__path__", [*cases.__path__, str(tmp_path)])
    monkeypatch.delitem(sys.modules, f"{cases.__name__}.tiny_", raising=False)
    return "tiny"


def test_a_family_is_one_file(tiny: str) -> None:
    assert tiny in family_names()
    (case,) = load_family(tiny)
    assert case.name == "mass_up"
    with pytest.raises(UnknownFamily, match=r"--family: got an unknown family of cases 'huge', expected one of .*tiny"):
        load_family("huge")


def test_plans(tiny: str) -> None:
    """The last value, which is the hardest, is never left out."""
    assert pose([tiny], FULL)["mass_up"].values == (1.0, 10.0, 100.0, 1000.0)
    assert pose([tiny], Plan(2))["mass_up"].values == (1.0, 100.0, 1000.0)
    assert pose([tiny], QUICK)["mass_up"].values == (1.0, 1000.0)
    assert decades(-1, -3) == (0.1, 0.01, 0.001)
    assert decades(0, 2) == (1.0, 10.0, 100.0)


def test_a_row_for_every_quantity_of_every_method(tiny: str) -> None:
    lines: list[str] = []
    report = stress([tiny], ["analytic", "mujoco"], QUICK, lambda line, total: lines.append(f"{line} of {total}"))
    table = report.table
    assert set(STRESS_COLUMNS) < set(table.columns)
    assert not table.duplicated(["case", "value", "engine", "route", "problem", "quantity"]).any()
    inverse, forward, native = 10, 2, 11
    expected = {
        ("analytic", "closed_form"): inverse + forward,
        ("analytic", "printed"): inverse,
        ("analytic", "6x6"): forward,
        ("analytic", "6+N"): forward,
        ("analytic", "dae"): forward,
        ("mujoco", "kkt"): inverse + forward,
        ("mujoco", "native"): native,
    }
    assert table.groupby(["engine", "route"]).size().to_dict() == {which: 2 * n for which, n in expected.items()}
    assert set(table.loc[table["route"] != "native", "outcome"]) == {ACCURATE}
    assert (table["input_sensitivity"] >= 2.0**-53).all()
    assert np.isfinite(table[["max_rel_error", "condition", "stated"]].to_numpy()).all()
    assert lines[-1].startswith("tiny: mass_up")
    assert len(lines) == 3
    assert report.status == 0
    assert report.info["families"] == ["tiny"]
    assert "scene" not in report.info


def test_unknown_names_are_refused(tiny: str) -> None:
    with pytest.raises(UnknownEngine, match="--engine: got an unknown engine 'nobody'"):
        stress([tiny], ["nobody"])
    with pytest.raises(UnknownFamily):
        stress(["huge"])


PLUGIN = """
import os, signal
from stewart_crosscheck.crosscheck.engines.analytic_ import AnalyticEngine

class Heavy(AnalyticEngine):
    \"\"\"Dies of a heavy platform, and lies about a middling one.\"\"\"
    name, package, route = "heavy", "numpy", "closed_form"
    def form(self, problem, route, row, F):
        mass = self.scene.platform.mass
        if mass > 500.0:
            os.kill(os.getpid(), signal.SIGKILL)
        answer = super().form(problem, route, row, F)
        if mass > 50.0 and problem == "forward":
            answer.platform[:] *= 1.0 + 1e-9
        return answer

class Absent(AnalyticEngine):
    name, package, route = "absent", "numpy", "closed_form"
    def __init__(self, scene, models=None):
        import a_package_that_is_not_there"""


@pytest.fixture
def plugins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Engines of another distribution, which the worker processes find on their path too."""
    info = tmp_path / "site" / "heavy-1.0.dist-info"
    info.mkdir(parents=True)
    (tmp_path / "site" / "heavy_engines.py").write_text(PLUGIN)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: heavy\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(
        "[stewart_crosscheck.engines]\nheavy = heavy_engines:Heavy\ngone = heavy_engines:Missing\n"
        "absent = heavy_engines:Absent\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path / "site"))


@pytest.mark.usefixtures("plugins")
def test_a_killed_engine_refuses_where_it_dies_and_nowhere_else(tiny: str) -> None:
    report = stress([tiny], ["heavy"])
    table = report.table
    by_mass = {mass: set(rows["outcome"]) for mass, rows in table.groupby("value")}
    assert by_mass == {1.0: {ACCURATE}, 10.0: {ACCURATE}, 100.0: {ACCURATE, SILENT}, 1000.0: {REFUSED}}
    assert table.loc[table["value"] == 1000.0, "reason"].str.contains(signal.SIGKILL.name).all()
    assert set(table.loc[table["outcome"] == SILENT, "problem"]) == {"forward"}
    assert report.info["silent_of_ours"] == 4  # forms of the forward problem
    assert signal.SIGKILL.name in report.info["failed"]["heavy"]
    assert report.info["crashed"] == ["heavy"]
    assert report.status == DISAGREE


def _crash(*args: object) -> None:
    os.abort()


def test_without_truth_nobody_is_judged(tiny: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A reference that cannot be run says nothing about the engines."""
    monkeypatch.setattr(stress_module, "certain", _crash)
    report = stress([tiny], ["analytic"], QUICK)
    assert set(report.table["outcome"]) == {REFUSED}
    assert report.table["reason"].str.contains("the reference failed").all()
    assert "reference" in report.info["failed"]
    assert report.info["crashed"] == ["reference"]
    assert report.status == ENGINE_FAILED


@pytest.mark.usefixtures("plugins")
def test_an_engine_that_cannot_be_loaded_is_told(tiny: str) -> None:
    report = stress([tiny], ["analytic", "gone"], QUICK)
    assert "Missing" in report.info["failed"]["gone"]
    assert report.info["crashed"] == []
    assert set(report.table["engine"]) == {"analytic"}
    assert report.status == ENGINE_FAILED


@pytest.mark.usefixtures("plugins")
def test_a_missing_package_is_no_refusal(tiny: str, tmp_path: Path) -> None:
    """It would pass for an engine that is careful."""
    report = stress([tiny], ["absent", "heavy"])
    assert "missing package: No module named 'a_package_that_is_not_there'" in report.info["failed"]["absent"]
    assert report.info["crashed"] == ["heavy"]
    write_stress(tmp_path / "out", report.table, report.info)
    rows = list(checks(tmp_path / "out"))
    assert {row["verdict"] for row in rows if row["engine"] == "absent"} == {"error"}
    assert all("missing package" in row["reason"] for row in rows if row["engine"] == "absent")
    assert "error" not in {row["verdict"] for row in rows if row["engine"] == "heavy"}  # it answered at other values
