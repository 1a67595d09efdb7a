"""Units of a night: what they must bring is what their commands bring, and their rows say what the files say."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from stewart_crosscheck.crosscheck.engine import engine_names
from stewart_crosscheck.crosscheck.hard import family_names
from stewart_crosscheck.crosscheck.nightly import attempt, unit_rows
from stewart_crosscheck.crosscheck.tolerance import ROUND_OFF
from stewart_crosscheck.crosscheck.unfinished import Attempt, Record
from stewart_crosscheck.crosscheck.unit import Key, UnknownUnit, all_units, choose_units, missing, read, row
from stewart_crosscheck.crosscheck.units import bench_, run_, simulate_, stress_
from stewart_crosscheck.models import scene_names
from stewart_crosscheck.reports.checks import CHECK_KEY


def test_every_scene_and_family_and_the_audit_are_units_and_times_are_taken_three_times() -> None:
    names = list(all_units())
    assert names == [
        *(f"run-{scene}" for scene in scene_names()),
        "audit",
        *(f"simulate-{scene}" for scene in scene_names()),
        *(f"stress-{family}" for family in family_names()),
        *(f"bench-{k}" for k in (1, 2, 3)),
    ]


def test_an_unknown_unit() -> None:
    with pytest.raises(UnknownUnit, match=r"^--unit: got an unknown unit 'run-x', expected one of run-collinear, "):
        choose_units(["audit", "run-x"])


def test_units_are_chosen_in_the_order_of_a_night() -> None:
    assert list(choose_units(["audit", "run-planar3", "audit"])) == ["run-planar3", "audit"]


@pytest.mark.parametrize("name", all_units())
def test_what_must_come_is_known_before_and_names_every_engine(name: str) -> None:
    keys = list(all_units()[name].expected())
    assert len(keys) == len(set(keys)) > 40
    if name != "audit":
        engines = {key.engine for key in keys}
        without = {"reference"} if name.startswith(("simulate", "stress")) else set()
        assert engines == set(engine_names()) - without


@pytest.mark.parametrize("name", ["run-collinear", "audit"])
def test_a_unit_brings_what_it_must(name: str, tmp_path: Path) -> None:
    """The other kinds take long: a missing row is an error in every night."""
    unit = all_units()[name]
    checks, _ = unit_rows(unit, tmp_path, attempt(unit, tmp_path))
    keys = [tuple(check[column] for column in CHECK_KEY[1:]) for check in checks]
    assert sorted(keys) == sorted(tuple(getattr(key, column) for column in CHECK_KEY[1:]) for key in unit.expected())
    assert {check["verdict"] for check in checks} == {"pass"}
    for check in checks:
        assert check["margin"] == pytest.approx(check["error"] / check["tolerance"], rel=1e-6)
        assert 0.0 < check["floor"] < check["tolerance"]
    assert checks[0]["reproduce"].startswith(f"crosscheck {unit.arguments[0]}")


def test_a_row_that_does_not_come_is_an_error(tmp_path: Path) -> None:
    unit = all_units()["run-collinear"]
    record = attempt(unit, tmp_path)
    for name in ("agreement.csv", "margins.csv"):
        lines = (tmp_path / "1" / name).read_text().splitlines()
        (tmp_path / "1" / name).write_text("\n".join(lines[:-1]) + "\n")
    checks, _ = unit_rows(unit, tmp_path, record)
    (gone,) = (check for check in checks if check["verdict"] == "error")
    assert (gone["engine"], gone["quantity"]) == ("reference", "M_hull")
    assert gone["reason"] == "not among the results, though it was expected"
    agreement = tmp_path / "1" / "agreement.csv"
    right = agreement.read_text()
    for wrong in ("", right.replace(",pass,", ",fine,"), right.replace(",F_r,", ",F,")):
        agreement.write_text(wrong)
        checks, _ = unit_rows(unit, tmp_path, record)
        assert {check["verdict"] for check in checks} == {"error"}
        assert all(check["reason"].startswith("its results cannot be read: ") for check in checks)
    agreement.write_text(right)
    (tmp_path / "1" / "margins.csv").unlink()
    checks, _ = unit_rows(unit, tmp_path, record)
    assert {check["verdict"] for check in checks} == {"error"}
    assert {check["reason"] for check in checks} == {
        "its results cannot be read: margins.csv: No such file or directory"
    }


def test_a_command_that_ends_without_results_is_told_by_what_it_said(tmp_path: Path) -> None:
    unit = all_units()["audit"]
    (tmp_path / "1.log").write_text("starting\ncrosscheck: the certified reference is needed\n")
    record = Record(attempts=[Attempt(how="ended", status=3, seconds=1.0, crashed=[], reason="")])
    checks, _ = unit_rows(unit, tmp_path, record)
    assert {check["reason"] for check in checks} == {"exit status 3: crosscheck: the certified reference is needed"}
    (tmp_path / "1.log").write_text("Traceback\nnumpy._core._exceptions._ArrayMemoryError: MemoryError")
    assert unit_rows(unit, tmp_path, record)[0][0]["reason"].startswith("out of memory: a process may have ")


def test_margins_are_only_where_something_is_promised() -> None:
    key = Key("hexapod", "dart", "kkt", "", "F")
    assert row(key, 2e-14, 1e-13, 3e-15, "pass")["margin"] == pytest.approx(0.2)
    assert np.isnan(row(key, 2e-14, np.nan, 3e-15, "pass")["margin"])
    assert np.isnan(row(key, 2e-14, 0.0, 3e-15, "pass")["margin"])
    assert missing(key, "why")["verdict"] == "error"


def test_rounding_grows_where_its_tolerance_does_and_not_with_a_law() -> None:
    assert run_.rounding("round_off", 1e-13) == ROUND_OFF.rounding
    assert run_.rounding("round_off_ill_conditioned", 1e-11) == pytest.approx(100 * ROUND_OFF.rounding)
    assert run_.rounding("closure", 1e-14) == 2e-15
    assert run_.rounding("law_of_softness", 1e-4) == ROUND_OFF.rounding


def test_texts_of_a_table_stay_what_they_are(tmp_path: Path) -> None:
    (tmp_path / "x.csv").write_text("engine,verdict,reason,error\nnan,NA,,\nnull,pass,1,2.5\n")
    table = read(tmp_path / "x.csv")
    assert table["engine"].tolist() == ["nan", "null"]
    assert table["verdict"].tolist() == ["NA", "pass"]
    assert table["reason"].tolist() == ["", "1"]
    assert np.isnan(table["error"][0])
    assert table["error"][1] == 2.5


SIMULATION = """\
engine,route,integrator,dt,pose_error,rotation_error,judged_until,energy_defect,a_error,alpha_error,amplification,\
tolerance_pose,tolerance_rotation,verdict,wrong,reason
dart,kkt,RK4,0.01,1e-3,1e-5,1.0,1e-8,1e-15,2e-15,3.0,1e-4,1e-4,fail,pose energy,pose off; energy made
dart,kkt,RK4,0.02,1e-3,1e-5,0.5,1e-8,1e-15,2e-15,3.0,1e-2,1e-4,pass,,
"""


def test_a_simulation_that_fails_is_the_failure_of_what_it_names(tmp_path: Path) -> None:
    (tmp_path / "simulation.csv").write_text(SIMULATION)
    first, second = (
        {r["quantity"]: r for r in simulate_.checks("hexapod", tmp_path) if r["setting"].endswith(dt)}
        for dt in ("0.01 s", "0.02 s")
    )
    assert {name: r["verdict"] for name, r in first.items()} == {
        "pose": "fail", "rotation": "pass", "energy": "fail", "accelerations": "pass", "order": "pass",
    }  # fmt: skip
    assert (first["pose"]["reason"], first["energy"]["reason"]) == ("pose off", "energy made")
    assert first["pose"]["margin"] == pytest.approx(10.0)
    assert first["accelerations"]["error"] == 2e-15
    assert np.isnan(second["pose"]["margin"]), "the largest error came after the time that was judged"


def stress_files(folder: Path, *rows: tuple[float, str, str, float, str], failed: str = "") -> None:
    names = ["value", "engine", "route", "max_rel_error", "outcome"]
    table = pd.DataFrame(rows, columns=names).assign(
        case="steep", parameter="s", quantity="F", input_sensitivity=1e-15, condition=1.0
    )
    table.to_csv(folder / "stress.csv", index=False)
    (folder / "run.json").write_text(json.dumps({"failed": {failed: "missing package"} if failed else {}}))
    reasons = table[["case", "value", "engine", "route", "outcome"]].assign(reason=table["outcome"] + " because")
    reasons.assign(problem=["forward" if r == "native" else "inverse" for r in table["route"]]).to_csv(
        folder / "reasons.csv", index=False
    )


def test_the_worst_answer_of_a_hard_case_and_its_refusals(tmp_path: Path) -> None:
    stress_files(
        tmp_path,
        (1e-1, "dart", "kkt", 2e-15, "accurate"),
        (1e-2, "dart", "kkt", 5e-13, "degraded"),
        (1e-3, "dart", "kkt", np.nan, "refused"),
        (1e-1, "dart", "native", 1e-3, "silent"),
    )
    worst, refusals, native, _ = stress_.checks(tmp_path)
    assert (worst["verdict"], worst["error"], worst["where"]) == ("degraded", pytest.approx(500), "F, s = 0.01")
    assert np.isnan(worst["tolerance"])
    assert worst["reason"] == "degraded because"
    assert native["reason"] == "silent because"
    assert refusals["error"] == 1
    assert native["verdict"] == "silent", "an engine's own solver: its defect, not ours"
    stress_files(tmp_path, (1e-1, "dart", "kkt", 1e-3, "silent"))
    assert next(iter(stress_.checks(tmp_path)))["verdict"] == "fail"
    nothing = [(value, "dart", "kkt", np.nan, "refused") for value in (1e-1, 1e-2)]
    stress_files(tmp_path, *nothing)
    worst, refusals = stress_.checks(tmp_path)
    assert (worst["verdict"], worst["where"]) == ("refused", "F, s = 0.1"), "where most is expected of it"
    assert np.isnan(worst["error"])
    assert refusals["error"] == 2
    stress_files(tmp_path, *nothing, failed="dart")
    assert [(row["verdict"], row["reason"]) for row in stress_.checks(tmp_path)] == [("error", "refused because")] * 2
    stress_files(tmp_path, *nothing, (1e-3, "dart", "kkt", 2e-15, "accurate"), failed="dart")
    assert [row["verdict"] for row in stress_.checks(tmp_path)] == ["accurate", "pass"]


def test_what_failed_or_is_wrong_in_bench(tmp_path: Path) -> None:
    case = {"task": "driving_forces", "engine": "dart", "route": "kkt", "backend": "", "setting": "x"}
    table = pd.DataFrame(
        [{**case, "batch": batch, "us_per_sample": us} for batch, us in ((1, 4.0), (10, np.nan), (100, 1.0))]
    )
    table.assign(scene="hexapod", max_rel_error=1e-15).to_csv(tmp_path / "speed_error.csv", index=False)
    info = {
        "baseline": {"us_per_sample": 2.0},
        "failed": [{**case, "batch": 10, "reason": "late"}],
        "wrong": [{**case, "batch": 100, "over_tolerance": 7.0}],
    }
    (tmp_path / "run.json").write_text(json.dumps(info))
    assert [(r["verdict"], r["reason"]) for r in bench_.checks(tmp_path)] == [
        ("pass", ""), ("error", "late"), ("fail", "7 times the tolerance"),
    ]  # fmt: skip
    assert [(r["unit"], r["ratio"]) for r in bench_.times("bench-2", tmp_path)] == [("bench-2", 2.0), ("bench-2", 0.5)]
