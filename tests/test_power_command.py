"""The command `power`: its files, exit statuses, and what becomes of engines that do not run."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from rich.console import Console

from stewart_crosscheck.crosscheck import cli, power, power_elsewhere
from stewart_crosscheck.crosscheck.engine import REFERENCE, Died, load_engine
from stewart_crosscheck.crosscheck.power import MISTAKE, PARAMETER, SURVEY, TERM, PowerReport, Task
from stewart_crosscheck.crosscheck.power_mistakes import MISTAKES, Mistake
from stewart_crosscheck.crosscheck.power_tasks import COLUMNS, Survey, row
from stewart_crosscheck.crosscheck.power_work import FORMULAS, Place, Seen
from stewart_crosscheck.crosscheck.trajectory import from_scene
from stewart_crosscheck.models import Scene, load_scene
from stewart_crosscheck.reports.power import groups, print_power, unseen

NULL = Mistake("null", "nobody", "nothing is wrong", "dot", (("a[0] * b[0]", "b[0] * a[0]"),))


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first faults of each kind, on two scenes: what is done with the others is the same."""
    monkeypatch.setattr(power, "scene_names", lambda: ["hexapod", "pointmass2"])
    split, sites = power._Look.split, power.terms()

    def first(self: Any, kind: str, engine: str, items: Sequence[int]) -> None:
        split(self, kind, engine, list(items)[:2] if kind != MISTAKE else items)

    monkeypatch.setattr(power._Look, "split", first)
    monkeypatch.setattr(power, "terms", lambda: sites[600:602])


def test_the_command_writes_its_files(
    few: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    out = tmp_path / "out"
    argv = ["crosscheck", "power", "pointmass2", "--engine", "analytic", "--out", str(out)]
    monkeypatch.setattr(sys, "argv", argv)
    with pytest.raises(SystemExit) as e:
        cli.main()
    assert e.value.code == 0
    assert {file.name for file in out.iterdir()} == {"power.csv", "power.svg", "power.png", "run.json"}
    table, info = pd.read_csv(out / "power.csv", keep_default_na=False), json.loads((out / "run.json").read_text())
    assert list(table.columns) == COLUMNS
    assert set(table["kind"]) == {"parameter", "term", "sign", "mistake"}
    assert len(table[table["kind"] == "parameter"]) == 18, "a row for each number, looked at or not"
    caught = table[(table["kind"] == "mistake") & (table["verdict"] == "detected")]
    assert set(caught["fault"]) == {m.name for m in MISTAKES}
    assert info["status"] == 0
    assert info["samples"] == 201
    assert "every mistake is caught" in capsys.readouterr().out


def test_a_mistake_that_is_not_caught_ends_with_1(few: None) -> None:
    said: list[str] = []
    report = power.power(
        load_scene("pointmass2"), ["analytic"], samples=3, mistakes=(NULL, MISTAKES[0]),
        done=lambda line, total: said.append(line),
    )  # fmt: skip
    assert report.status == 1
    assert report.info["uncaught"] == ["null"]
    assert any(line.startswith("mistakes, analytic") for line in said)


# --- What becomes of tasks --------------------------------------------------------------------------------------------


class Recorder:
    """Workers that note what they are given, and do nothing."""

    def __init__(self) -> None:
        self.tasks: list[Task] = []

    def start(self, engine: str, task: Task, body: Callable[..., Any], *args: Any) -> None:
        self.tasks.append(task)

    def shared(self, value: object) -> Path:
        return Path("somewhere")


def look(hexapod: Scene, *engines: str) -> tuple[Any, Recorder]:
    workers = Recorder()
    able = {name: load_engine(name) for name in (*engines, REFERENCE)}
    made = power._Look(workers, able, {"hexapod": hexapod}, {}, "hexapod", MISTAKES, {})  # pyright: ignore[reportArgumentType]
    return made, workers


def right(name: str, detected: bool = False) -> Survey:
    return Survey({route: Seen(0.1, "F", detected) for route in ("closed_form", "kkt", "native")}, frozenset({1, 2}))


def test_a_crash_costs_one_fault(hexapod: Scene) -> None:
    made, workers = look(hexapod, "analytic", "mujoco")
    made.end(Task(SURVEY, "mujoco", "hexapod"), right("mujoco"))
    many = next(task for task in workers.tasks if task.kind == PARAMETER)
    workers.tasks.clear()
    made.end(many, Died("killed"))
    assert workers.tasks == [many._replace(items=(k,)) for k in many.items]
    assert not made.failed
    made.end(workers.tasks[0], Died("killed"))
    assert "killed" in made.failed["mujoco"]
    table = power._table(made)
    rows = table[(table["fault"] == "gravity.x") & (table["engine"] == "mujoco")]
    assert set(rows["route"]) == {"kkt", "native"}
    assert set(rows["verdict"]) == {"not run"}
    assert "killed" in rows["reason"].iloc[0]


def test_an_engine_that_fails_without_a_fault_proves_nothing(hexapod: Scene) -> None:
    made, workers = look(hexapod, "mujoco")
    made.end(Task(SURVEY, "mujoco", "hexapod"), right("mujoco", detected=True))
    assert not workers.tasks
    assert made.disagree[0].startswith("mujoco")
    assert set(power._table(made)["verdict"]) == {"not run"}


def test_joint_coordinates_are_looked_at_in_every_engine(hexapod: Scene) -> None:
    made, workers = look(hexapod, "analytic", "mujoco")
    made.end(Task(SURVEY, "mujoco", "hexapod"), right("mujoco"))
    made.end(Task(SURVEY, "analytic", "hexapod"), right("analytic")._replace(shared=frozenset({2})))
    asked = {(task.engine, task.items) for task in workers.tasks if task.kind == TERM}
    assert asked == {("analytic", (1, 2)), ("mujoco", (2,))}


@pytest.mark.parametrize(
    ("uncaught", "disagree", "failed", "status"),
    [([], [], {}, 0), (["x"], [], {}, 1), ([], ["mujoco kkt: F"], {}, 1), ([], [], {"dart": "died"}, 3),
     (["x"], [], {"dart": "died"}, 1)],
)  # fmt: skip
def test_exit_statuses(uncaught: list[str], disagree: list[str], failed: dict[str, str], status: int) -> None:
    info = {"uncaught": uncaught, "disagree": disagree, "failed": failed}
    assert PowerReport(pd.DataFrame(), info).status == status


# --- Other commands, and the table ------------------------------------------------------------------------------------


def test_terms_that_run_does_not_reach_are_seen_by_other_commands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    places = {}
    for name in ("hexapod", "planar3"):
        scene = load_scene(name)
        trajectory = from_scene(scene, 5)
        places[tmp_path / name] = Place(scene, trajectory, load_engine(REFERENCE)(scene).inverse_dynamics(trajectory))
    monkeypatch.setattr(power_elsewhere, "place_of", places.get)
    for function, text, command in (
        ("leg_loads_scalar", "J_q * h.ddq_n", "audit"),
        ("tip_inertia", "leg.J_oz", "simulate"),
        ("planar_reactions", "leg.a * swing", "run"),
        ("energy", "k.w * k.w", ""),
    ):
        number = next(s.number for s in power.terms() if s.function == function and text in s.text)
        rows = power_elsewhere.of_other_terms(list(places), [number])
        assert {r["command"] for r in rows} == {command}
        assert {r["verdict"] for r in rows} == {"detected" if command else "not run"}
        assert {r["kind"] for r in rows} == ({"term", "sign"} if command else {"term"})


def test_what_is_blind_is_named() -> None:
    rows = [
        row("parameter", 0, "masses", "a mass", engine="mujoco", route="kkt", smallest=1e-12, verdict="detected"),
        row("parameter", 1, "masses", "other mass", engine="mujoco", route="kkt", verdict="blind", reason="no use"),
        row("parameter", 2, "masses", "third mass", engine="mujoco", route="kkt", smallest=1e-9, verdict="detected"),
        row("term", 0, "f", "x", where="f:1 (2)", engine=FORMULAS, route="closed_form", verdict="blind", reason="zero"),
        row("term", 0, "f", "x", where="f:1 (2)", engine="mujoco", route="kkt", verdict="detected", smallest=1e-9),
        row("term", 1, "f", "y", where="f:1 (2)", engine=FORMULAS, route="closed_form", verdict="blind", reason="zero"),
        row("sign", 1, "f", "y", where="f:1 (2)", engine=FORMULAS, route="closed_form", verdict="blind", reason="zero"),
        row("mistake", 0, "code", "slip", scene="hexapod", error_over_tolerance=1e9, verdict="detected"),
    ]
    table = pd.DataFrame(rows, columns=COLUMNS)
    assert groups(table[table["kind"] == "parameter"]).to_numpy().tolist() == [[1e-9]]
    assert unseen(table[table["kind"].isin(["term", "sign"])])["fault"].tolist() == ["y"]
    console = Console(record=True, width=140)
    info = {"uncaught": [], "disagree": [], "failed": {"dart": "missing package"}, "seconds": 1.0}
    print_power(table, info, console)
    said = console.export_text()
    assert "blind mujoco kkt: no use: other mass" in said
    assert "blind zero: f:1 y" in said
    assert "1e-09 1 not" in said
    assert "ERROR dart: missing package" in said


def test_bad_input_writes_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for arguments in (["nowhere"], ["hexapod", "--engine", "nobody"]):
        monkeypatch.setattr(sys, "argv", ["crosscheck", "power", *arguments, "--out", str(tmp_path / "out")])
        with pytest.raises(SystemExit) as e:
            cli.main()
        assert e.value.code == 2
    assert not list(tmp_path.iterdir())
