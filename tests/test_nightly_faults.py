"""Nights in which something goes wrong: workers killed, hanging, hungry, packages missing, nights interrupted."""

from __future__ import annotations

import dataclasses
import json
import os
import secrets
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pandas as pd
import pytest
from conftest import ENGINES
from test_supervise import others

from stewart_crosscheck.crosscheck import nightly as module
from stewart_crosscheck.crosscheck.nightly import attempt, unit_rows
from stewart_crosscheck.crosscheck.unfinished import Record
from stewart_crosscheck.crosscheck.unit import Unit, choose_units
from stewart_crosscheck.reports import load_night

FAULTY = '''
"""What the test wants to go wrong, in the processes where it does: read by every Python that starts."""
import importlib, json, os, pathlib, signal, sys, time

FAULTS = json.loads(os.environ["FAULTS"])
import_module = importlib.import_module
sys.modules |= {what: None for fault, what in FAULTS if fault == "missing"}


def faulty(name, package=None):
    module = import_module(name, package)
    if ".crosscheck.engines." in name and name.endswith("_") and not hasattr(module, "faulty"):
        module.faulty = True
        right = module.ENGINE.inverse_dynamics

        def inverse_dynamics(self, trajectory):
            for fault, what in FAULTS:
                if what != f"{self.name} {self.scene.name}":
                    continue
                mark = pathlib.Path(os.environ["MARKS"], what)
                if fault == "killed" or (fault == "killed once" and not mark.exists()):
                    mark.touch()
                    os.kill(os.getpid(), signal.SIGKILL)
                if fault == "hangs":
                    time.sleep(600)
                if fault == "hungry":
                    eaten = []
                    while True:
                        eaten.append(bytearray(1 << 28))
            return right(self, trajectory)

        module.ENGINE.inverse_dynamics = inverse_dynamics
    return module


importlib.import_module = faulty
'''

Faults = Callable[..., None]


@pytest.fixture
def faults(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Faults]:
    """What goes wrong from now on, in processes that are started: pairs of a fault and `engine scene`, or a module."""
    folder = tmp_path / "faults"
    folder.mkdir()
    (folder / "sitecustomize.py").write_text(FAULTY)
    monkeypatch.setenv("PYTHONPATH", str(folder))
    monkeypatch.setenv("MARKS", str(folder))
    monkeypatch.setenv("MARK_OF_A_TEST", secrets.token_hex(16))

    def go_wrong(*pairs: tuple[str, str]) -> None:
        monkeypatch.setenv("FAULTS", json.dumps(pairs))

    go_wrong()
    yield go_wrong
    assert others(f"MARK_OF_A_TEST={os.environ['MARK_OF_A_TEST']}") == [], "a process was left behind"


def done(unit: Unit, folder: Path) -> tuple[Record, pd.DataFrame]:
    folder.mkdir()
    record = attempt(unit, folder)
    return record, pd.DataFrame(unit_rows(unit, folder, record)[0])


def one(name: str) -> Unit:
    return choose_units([name])[name]


def test_workers_that_are_killed_once_have_a_second_attempt(faults: Faults, tmp_path: Path) -> None:
    faults(*(("killed once", f"{engine} collinear") for engine in ENGINES))
    record, rows = done(one("run-collinear"), tmp_path / "unit")
    assert [a.crashed for a in record.attempts] == [sorted(ENGINES), []]
    assert [a.status for a in record.attempts] == [3, 0]
    assert set(rows["verdict"]) == {"pass"}
    assert set(rows["reason"]) == {"second attempt: in the first dart, mujoco, pinocchio crashed"}
    first = pd.read_csv(tmp_path / "unit" / "1" / "agreement.csv")  # nothing that happened is lost
    assert set(first.loc[first["verdict"] == "error", "engine"]) == set(ENGINES)


def test_a_unit_that_hangs_is_rows_that_say_so_and_is_not_tried_again(faults: Faults, tmp_path: Path) -> None:
    faults(("hangs", "mujoco collinear"))
    record, rows = done(dataclasses.replace(one("run-collinear"), seconds=4.0), tmp_path / "unit")
    assert [a.how for a in record.attempts] == ["late"]
    assert set(rows["verdict"]) == {"error"}
    assert set(rows["reason"]) == {"no answer within 4 s"}
    assert len(rows) == len(list(one("run-collinear").expected()))


def test_a_worker_that_eats_memory_is_stopped_and_told_and_not_tried_again(
    faults: Faults, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "MEMORY", 15 * 10**8)
    faults(("hungry", "pinocchio collinear"))
    record, rows = done(one("run-collinear"), tmp_path / "unit")
    assert len(record.attempts) == 1
    wrong = rows[rows["verdict"] == "error"]
    assert set(wrong["engine"]) == {"pinocchio"}
    assert set(wrong.loc[wrong["route"] == "kkt", "reason"]) == {"out of memory (its limit is 1.5 GB)"}


def test_a_package_that_is_missing_is_rows_that_say_so(faults: Faults, tmp_path: Path) -> None:
    faults(("missing", "pinocchio"))
    record, rows = done(one("run-collinear"), tmp_path / "unit")
    assert len(record.attempts) == 1
    wrong = rows[rows["verdict"] == "error"]
    assert set(wrong["engine"]) == {"pinocchio"}
    assert wrong["reason"].str.startswith("missing package: ").all()


# --- Nights -----------------------------------------------------------------------------------------------------------

COMMAND = [sys.executable, "-m", "stewart_crosscheck.crosscheck", "nightly"]


def start(folder: Path, *arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [*COMMAND, *arguments], cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def night(folder: Path, *arguments: str) -> tuple[int, str, str]:
    process = start(folder, *arguments)
    out, err = process.communicate(timeout=120)
    return process.returncode, out, err


def units(*names: str) -> list[str]:
    return [word for name in names for word in ("--unit", name)]


def until(process: subprocess.Popen[str], beginning: str) -> None:
    """Read what a night says on stderr until a unit has ended."""
    assert process.stderr is not None
    for line in process.stderr:
        if line.startswith(beginning):
            return
    pytest.fail(f"it ended before {beginning!r}")


def test_an_engine_that_is_killed_twice_ends_with_3_and_the_rest_goes_on(faults: Faults, tmp_path: Path) -> None:
    faults(("killed", "dart collinear"))
    status, out, err = night(tmp_path, *units("run-collinear", "audit"), "--out", "night")
    assert status == 3, out + err
    assert "audit: 52 pass" in err
    found = load_night(tmp_path / "night")
    assert set(found.checks.loc[found.checks["verdict"] == "error", "engine"]) == {"dart"}
    assert {name: unit["attempts"] for name, unit in found.info["units"].items()} == {"run-collinear": 2, "audit": 1}
    for name in ("summary.md", "junit.xml", "regressions.csv"):
        assert "killed by SIGKILL" in (tmp_path / "night" / name).read_text(), name
    assert "run-collinear: second attempt: in the first dart crashed" in (tmp_path / "night" / "summary.md").read_text()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_night_keeps_what_is_done(number: signal.Signals, faults: Faults, tmp_path: Path) -> None:
    faults(("hangs", "mujoco planar3"))
    process = start(tmp_path, *units("run-collinear", "run-planar3"), "--out", "night")
    until(process, "run-collinear")
    process.send_signal(number)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "interrupted: 1 of 2 units are done and kept in" in err
    assert "crosscheck nightly --resume --out night finishes the rest" in err
    assert not (tmp_path / "night").exists()


def test_a_killed_night_is_resumed(faults: Faults, tmp_path: Path) -> None:
    names = ["run-collinear", "run-planar3", "audit"]
    faults(("hangs", "mujoco planar3"))
    process = start(tmp_path, *units(*names))
    until(process, "run-collinear")
    process.kill()
    process.communicate()
    (begun,) = (tmp_path / "runs").iterdir()
    record = (begun / "units" / "run-collinear" / "unit.json").read_bytes()
    faults()
    status, out, err = night(tmp_path, "--resume")
    assert status == 0, out + err
    (finished,) = (tmp_path / "runs").iterdir()
    assert finished.name == begun.name.removeprefix(".").removesuffix(".unfinished")
    assert (finished / "units" / "run-collinear" / "unit.json").read_bytes() == record
    assert "run-collinear: 76 pass" in err
    assert err.count("(done before)") == 1
    assert sorted(load_night(finished).info["units"]) == sorted(names)
    assert sorted(p.name for p in finished.iterdir()) == [
        "checks.csv", "junit.xml", "regressions.csv", "run.json", "summary.md", "times.csv", "units",
    ]  # fmt: skip
    status, _, err = night(tmp_path, "--resume")
    assert status == 2
    assert err == "crosscheck: --resume: got no unfinished night in runs\n"


def test_two_nights_at_once_do_not_disturb_each_other(faults: Faults, tmp_path: Path) -> None:
    both = [start(tmp_path, *units("audit")) for _ in range(2)]
    for process in both:
        _, err = process.communicate(timeout=120)
        assert process.returncode == 0, err
    found = [load_night(folder) for folder in (tmp_path / "runs").iterdir()]
    assert len(found) == 2
    assert [len(n.checks) for n in found] == [52, 52]


def test_two_nights_for_one_folder(faults: Faults, tmp_path: Path) -> None:
    """The second one is turned away, also as a --resume of the first, which is under way."""
    faults(("hangs", "mujoco collinear"))
    first = start(tmp_path, *units("audit", "run-collinear", "run-planar3"), "--out", "night")
    try:
        hidden = tmp_path / ".night.unfinished"
        while not (hidden / "units").exists():
            assert first.poll() is None
        for arguments in (units("audit"), ["--resume"]):
            status, _, err = night(tmp_path, *arguments, "--out", "night")
            assert status == 2
            assert ".night.unfinished" in err
    finally:
        first.terminate()
        first.communicate(timeout=60)
    assert first.returncode == 130
