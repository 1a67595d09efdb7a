"""Engines in processes of their own: crashes, hangs, missing packages, and what `run` makes of them."""

from __future__ import annotations

import contextlib
import os
import resource
import secrets
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from test_supervise import processes_with

from stewart_crosscheck.analytic import stewart
from stewart_crosscheck.crosscheck import processes, ranges
from stewart_crosscheck.crosscheck import run as run_module
from stewart_crosscheck.crosscheck.cli import engines
from stewart_crosscheck.crosscheck.engine import (
    DynamicsResult,
    EngineError,
    Failure,
    UnknownEngine,
    crashed,
    engine_names,
    engine_version,
    load_engine,
)
from stewart_crosscheck.crosscheck.ranges import out_of_range
from stewart_crosscheck.crosscheck.run import ENGINE_FAILED, choose_engines, require_determinate, run
from stewart_crosscheck.crosscheck.trajectory import Trajectory, from_scene
from stewart_crosscheck.models import Scene, SceneError

PLUGIN = """
import dataclasses, os, resource, time
import numpy as np
from stewart_crosscheck.crosscheck.engine import EngineError
from stewart_crosscheck.crosscheck.engines.analytic_ import AnalyticEngine

class Base(AnalyticEngine):
    package, route = "numpy", "kkt"

class Crash(Base):
    name = "crash"
    def inverse_dynamics(self, trajectory):
        os.write(2, b"engine: about to fall over\\n")
        os.abort()

class Hang(Base):
    name = "hang"
    def inverse_dynamics(self, trajectory):
        time.sleep(600)
    def simulate(self, problem, method):
        time.sleep(600)

class Hungry(Base):
    name = "hungry"
    def inverse_dynamics(self, trajectory):
        resource.setrlimit(resource.RLIMIT_DATA, (3 * 10**9, resource.RLIM_INFINITY))
        return np.ones(10**9)

class Leaves(Base):
    name = "leaves"
    def inverse_dynamics(self, trajectory):
        raise SystemExit(0)

class Raises(Base):
    name = "raises"
    def __init__(self, scene, models=None):
        raise KeyError("joint [o1]")

class Refuses(Base):
    name = "refuses"
    def inverse_dynamics(self, trajectory):
        raise EngineError("refuses: warnings {'mjWARN_BADQACC': 1}")

class Nothing(Base):
    name = "nothing"
    def inverse_dynamics(self, trajectory):
        return None

class Fewer(Base):
    name = "fewer"
    def inverse_dynamics(self, trajectory):
        result = super().inverse_dynamics(trajectory)
        return dataclasses.replace(result, F=result.F[:, :5])

class Open(Base):
    name = "open"
    checks = ("loop_pos",)

class Unsure(Base):
    name = "unsure"
    def inverse_dynamics(self, trajectory):
        result = super().inverse_dynamics(trajectory)
        return dataclasses.replace(result, dL=result.dL * np.nan)

class Liar(Base):
    name = "liar"
    def inverse_dynamics(self, trajectory):
        result = super().inverse_dynamics(trajectory)
        return dataclasses.replace(result, radius={"F": 0 * result.F})

class Pretender(Base):
    name = "reference"
    def inverse_dynamics(self, trajectory):
        result = super().inverse_dynamics(trajectory)
        return dataclasses.replace(result, samples=result.samples[:1])

class Missing(Base):
    name = "missing"
    def __init__(self, scene, models=None):
        import a_package_that_is_not_there
"""
NAMES = (
    "crash",
    "hang",
    "hungry",
    "leaves",
    "raises",
    "refuses",
    "nothing",
    "fewer",
    "open",
    "unsure",
    "liar",
    "pretender",
    "missing",
)


@pytest.fixture
def plugins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Engines of another distribution that all fail, each in its own way; one of them calls itself mujoco."""
    (tmp_path / "failing_engines.py").write_text(PLUGIN)
    info = tmp_path / "failing_engines-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: failing-engines\nVersion: 1.0\n")
    entries = [f"{n} = failing_engines:{n.capitalize()}" for n in NAMES]
    entries += ["broken = module_that_is_not_there:Engine", "mujoco = failing_engines:Crash"]
    (info / "entry_points.txt").write_text("[stewart_crosscheck.engines]\n" + "\n".join(entries) + "\n")
    monkeypatch.syspath_prepend(tmp_path)
    yield
    sys.modules.pop("failing_engines", None)


@pytest.fixture(scope="module")
def short(hexapod: Scene) -> Trajectory:
    return from_scene(hexapod, 3)


@pytest.mark.usefixtures("plugins")
def test_each_failure_is_that_engines_alone(hexapod: Scene, short: Trajectory, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(processes, "SECONDS", 20.0)  # enough for a dozen to start; one sleeps thirty times that
    ended: list[str] = []
    report = run(hexapod, short, [*NAMES, "broken", "analytic"], done=lambda name, route, result: ended.append(name))
    reasons = {name: r.reason for (name, _), r in report.results.items() if isinstance(r, Failure)}
    assert set(reasons) == {*NAMES, "broken"}
    assert reasons["crash"] == "its process died: SIGABRT; it last printed: engine: about to fall over"
    assert reasons["hang"].startswith("no answer within 20 s")
    assert reasons["hungry"].startswith("out of memory (its limit is 3 GB): Unable to allocate 7.45 GiB")
    assert reasons["leaves"] == "SystemExit: 0"
    assert reasons["nothing"] == "nothing: got NoneType, expected a DynamicsResult"
    assert reasons["fewer"] == "fewer: F: got shape (3, 5), expected shape (3, 6)"
    assert reasons["open"] == "open: loop_pos: got nothing, expected shape (3, 6, 3)"
    assert reasons["unsure"] == "unsure: dL is not finite at sample 0"
    assert reasons["pretender"] == "pretender: only the reference brings radii or leaves samples out"
    assert reasons["liar"] == "liar: only the reference brings radii or leaves samples out"
    assert reasons["raises"] == "KeyError: 'joint [o1]'"
    assert "mjWARN_BADQACC" in reasons["refuses"]
    assert reasons["missing"] == "missing package: No module named 'a_package_that_is_not_there'"
    assert reasons["broken"] == "missing package: No module named 'module_that_is_not_there'"
    verdicts = report.agreement.groupby("engine")["verdict"].agg(set).to_dict()
    assert verdicts["analytic"] == verdicts["reference"] == {"pass"}
    assert all(verdicts[name] == {"error"} for name in reasons)
    assert report.status == ENGINE_FAILED
    assert report.info["crashed"] == ["crash"]
    assert {name: list(f.values()) for name, f in report.info["failed"].items()} == {n: [r] for n, r in reasons.items()}
    assert sorted(ended) == sorted([*NAMES, "broken", "analytic", "reference"])


@pytest.mark.usefixtures("plugins")
def test_a_plug_in_does_not_replace_a_built_in_engine() -> None:
    assert engine_names().count("mujoco") == 1
    assert load_engine("mujoco").__module__ == "stewart_crosscheck.crosscheck.engines.mujoco_"


def test_a_killed_process_is_told_from_a_crash(tmp_path: Path) -> None:
    log = tmp_path / "log"
    log.write_text("\x1b[1;33mWarning\x1b[0m of long ago")
    assert processes.death(-signal.SIGKILL, str(log)).startswith("its process was killed by SIGKILL")
    assert (
        processes.death(-signal.SIGSEGV, str(log)) == "its process died: SIGSEGV; it last printed: Warning of long ago"
    )
    assert processes.death(7, str(tmp_path / "none")) == "its process died: exit code 7"


def test_memory_that_is_short_is_told_with_its_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    limits = {resource.RLIMIT_DATA: resource.RLIM_INFINITY, resource.RLIMIT_AS: resource.RLIM_INFINITY}
    monkeypatch.setattr(resource, "getrlimit", lambda which: (limits[which], resource.RLIM_INFINITY))
    assert processes.failure_of(MemoryError()) == Failure("out of memory")
    limits[resource.RLIMIT_AS] = 4 * 10**9
    assert processes.failure_of(MemoryError()) == Failure("out of memory (its limit is 4 GB)")
    limits[resource.RLIMIT_DATA] = 15 * 10**8
    assert processes.failure_of(MemoryError("1 GiB")) == Failure("out of memory (its limit is 1.5 GB): 1 GiB")
    assert processes.failure_of(KeyError("x")) == Failure("KeyError: 'x'")


def test_what_a_library_says_becomes_one_line_that_is_not_long() -> None:
    """A wrong argument: some print every number of it."""
    reason = processes.failure_of(
        TypeError("f(): wrong arguments.\n    1. (x: float)\nInvoked with: " + "0.0, " * 999)
    ).reason
    assert reason.startswith("TypeError: f(): wrong arguments. 1. (x: float) Invoked with: 0.0, 0.0, ")
    assert reason.endswith(" ...")
    assert len(reason) < 210


@pytest.mark.usefixtures("plugins")
def test_a_version_that_this_project_is_not_made_for_is_named_where_it_fails(
    hexapod: Scene, short: Trajectory, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(ranges, "requires", lambda name: ["numpy>=1000,<1001", 'other>=3; extra == "dev"'])
    report = run(hexapod, short, ["raises", "crash", "analytic"])
    numpy = f"numpy {np.__version__} is installed, expected <1001,>=1000"
    reasons = {name: r.reason for (name, _), r in report.results.items() if isinstance(r, Failure)}
    assert reasons["raises"] == f"KeyError: 'joint [o1]' ({numpy})"
    assert reasons["crash"].endswith(f"about to fall over ({numpy})")
    assert set(reasons) == {"raises", "crash"}  # what works is not complained of
    assert engines() == 0
    assert "numpy>=1000" not in (shown := capsys.readouterr().out)
    assert " ".join(shown.split()).count("is installed, expected") == len(NAMES)


@pytest.mark.parametrize("name", ["mujoco", "pinocchio", "dart"])
def test_a_library_of_another_version_than_its_package_is_an_error(
    name: str, hexapod: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Half an upgrade: reports would name a version that did not run."""
    engine = load_engine(name)
    engine(hexapod)
    told = engine_version(engine)
    monkeypatch.setattr(ranges, "engine_version", lambda engine: f"{told}.post1")
    engine(hexapod)
    monkeypatch.setattr(ranges, "engine_version", lambda engine: "1000.1")
    with pytest.raises(EngineError, match=f"{name}: the library .* of version {told}, expected 1000.1 as its package"):
        engine(hexapod)


def test_installed_versions_are_those_that_this_project_is_made_for() -> None:
    assert {name: out_of_range(load_engine(name)) for name in engine_names()} == dict.fromkeys(engine_names(), "")


def _exit_at_start() -> None:
    os._exit(5)


def test_a_process_that_cannot_start_crashed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(processes, "_end_with_parent", _exit_at_start)
    with processes.Workers[str](["analytic"], 60.0) as workers:
        workers.start("analytic", "first", os.getpid)
        outcomes = dict(workers.ended())
        workers.start("analytic", "second", os.getpid)
        outcomes |= dict(workers.ended())
    assert crashed(outcomes.items()) == ["first", "second"]
    assert all("could not be started, or died at once" in outcome.reason for outcome in outcomes.values())


@pytest.mark.usefixtures("plugins")
def test_a_disagreement_outranks_a_failure(hexapod: Scene, short: Trajectory, monkeypatch: pytest.MonkeyPatch) -> None:
    write_models = run_module.write_models
    monkeypatch.setattr(
        run_module,
        "write_models",
        lambda scene: {name: t.replace('value="27.3"', 'value="27.4"') for name, t in write_models(scene).items()},
    )
    report = run(hexapod, short, ["pinocchio", "raises"])
    assert set(report.agreement["verdict"]) == {"pass", "fail", "error"}
    assert report.status == 1


@pytest.mark.usefixtures("plugins")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize(
    ("command", "begun"),  # in any order, while one hangs, or while there is much to do
    [
        ("run --samples 3", {"analytic", "reference"}),
        ("simulate --duration 0.02 --samples 3", {"analytic", "reference"}),
        ("stress --family steep --quick", {"steep"}),
        ("bench --quick", {"round"}),
    ],
    ids=lambda value: value.split()[0] if isinstance(value, str) else "",
)
def test_an_interrupted_command_writes_nothing_and_leaves_no_process(
    command: str, begun: set[str], number: signal.Signals, tmp_path: Path
) -> None:
    argv = [sys.executable, "-m", "stewart_crosscheck.crosscheck", *command.split(), "--out", "out"]
    running = subprocess.Popen(
        [*argv, "--engine", "hang", "--engine", "analytic"],
        env=os.environ | {"PYTHONPATH": str(tmp_path), "TMPDIR": str(tmp_path)},
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    assert running.stderr is not None
    said = {running.stderr.readline().split(":")[0].split()[0] for _ in begun}
    assert said <= begun
    os.killpg(running.pid, number)  # as a terminal does: to all processes of the command
    _, rest = running.communicate(timeout=60)
    assert running.returncode == 130
    assert rest.splitlines()[-1] == "crosscheck: interrupted; nothing was written"
    assert "Traceback" not in rest
    assert sorted(p.name for p in tmp_path.iterdir() if p.name != "__pycache__") == [
        "failing_engines-1.0.dist-info",
        "failing_engines.py",
    ]
    deadline = time.monotonic() + 60  # the resource tracker of multiprocessing follows a moment later
    while _alive(running.pid) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not _alive(running.pid)


def test_processes_that_only_just_start_do_not_hear_an_interrupt(tmp_path: Path) -> None:
    """A terminal sends Ctrl-C to all: what a worker says when its start is disturbed is nobody's concern."""
    (tmp_path / "sitecustomize.py").write_text(
        "import os, pathlib, sys, time\n"
        "if '--multiprocessing-fork' in sys.orig_argv:\n"
        "    pathlib.Path(f'begun{os.getpid()}').touch()\n"
        "    time.sleep(600)\n"
    )
    running = subprocess.Popen(
        [sys.executable, "-m", "stewart_crosscheck.crosscheck", "run", "--samples", "1", "--engine", "analytic"],
        env=os.environ | {"PYTHONPATH": str(tmp_path)},
        cwd=tmp_path,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    deadline = time.monotonic() + 60
    while len(list(tmp_path.glob("begun*"))) < 2 and time.monotonic() < deadline:
        time.sleep(0.05)
    time.sleep(1.0)  # while it starts processes, the command does not hear it either
    os.killpg(running.pid, signal.SIGINT)
    _, err = running.communicate(timeout=60)
    assert (running.returncode, err) == (130, "crosscheck: interrupted; nothing was written\n")


@pytest.mark.usefixtures("plugins")
def test_a_command_that_is_killed_takes_its_engines_along(tmp_path: Path) -> None:
    mark = f"MARK={secrets.token_hex(16)}"
    command = [sys.executable, "-m", "stewart_crosscheck.crosscheck", "run", "--samples", "3", "--engine", "hang"]
    running = subprocess.Popen(
        command,
        env=os.environ | {"PYTHONPATH": str(tmp_path), "TMPDIR": str(tmp_path), "MARK": mark.removeprefix("MARK=")},
        cwd=tmp_path,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert running.stderr is not None
    assert running.stderr.readline().startswith("reference certified done")  # while one hangs
    assert len(processes_with(mark)) >= 3
    running.kill()
    running.communicate(timeout=60)
    deadline = time.monotonic() + 60  # the engine would sleep ten times that
    while processes_with(mark) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not processes_with(mark)


def test_a_process_whose_parent_is_gone_before_it_starts_ends_too() -> None:
    """The system tells only of an end that is still to come."""
    script = (
        "import multiprocessing, os; from stewart_crosscheck.crosscheck import processes\n"
        "multiprocessing.parent_process = lambda: type('Gone', (), {'pid': 1 << 30})\n"
        "processes._end_with_parent(); print('still there')"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout) == (-signal.SIGKILL, "")


def _alive(group: int) -> list[str]:
    """Processes of a group that are not just waiting to be reaped."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            name, fields = stat.read_text().rsplit(")", 1)
            state, _, pgrp = fields.split()[:3]
            if int(pgrp) == group and state != "Z":
                found.append(name)
    return found


def test_an_engine_starts_from_a_clean_interpreter(
    hexapod: Scene, short: Trajectory, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What happens to modules of this process does not reach an engine: the process is spawned, not forked."""
    monkeypatch.setattr(stewart, "inertia", lambda leg, q_s: (0.0, 0.0, 0.0))
    assert run(hexapod, short, ["analytic"]).status == 0


def test_results_come_in_the_order_of_the_engines(hexapod: Scene, short: Trajectory) -> None:
    report = run(hexapod, short, ["mujoco", "analytic", "mujoco", "reference"])
    assert list(report.results) == [
        ("mujoco", "kkt"),
        ("mujoco", "native"),
        ("analytic", "closed_form"),
        ("reference", "certified"),
    ]
    assert all(isinstance(r, DynamicsResult) for r in report.results.values())
    assert report.status == 0


@pytest.mark.parametrize("package", ["mujoco", "flint"])
def test_a_missing_package_is_reported_by_the_command(package: str, tmp_path: Path) -> None:
    """One engine lacks its package: its rows say so, the others are compared; without truth nothing can be."""
    (tmp_path / f"{package}.py").write_text(f"raise ModuleNotFoundError({f'No module named {package}'!r})")
    argv = [sys.executable, "-m", "stewart_crosscheck.crosscheck", "run", "--samples", "3", "--out", "out"]
    done = subprocess.run(
        [*argv, "--engine", "mujoco", "--engine", "analytic"],
        env=os.environ | {"PYTHONPATH": str(tmp_path)},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 3, done.stderr
    assert f"No module named {package}" in done.stdout
    rows = pd.read_csv(tmp_path / "out" / "agreement.csv").groupby("engine")["verdict"].agg(set).to_dict()
    if package == "flint":
        assert rows == {"mujoco": {"error"}, "analytic": {"error"}, "reference": {"error"}}
        assert "ERROR mujoco native: no certified driving forces" in done.stdout
    else:
        assert rows == {"mujoco": {"error"}, "analytic": {"pass"}, "reference": {"pass"}}


def test_unknown_engines_are_refused() -> None:
    with pytest.raises(UnknownEngine, match="--engine: got an unknown engine 'ode', expected one of analytic, dart"):
        choose_engines(["mujoco", "ode"])


def test_the_reference_always_runs() -> None:
    assert list(choose_engines(["dart"])) == ["dart", "reference"]
    assert list(choose_engines([])) == ["analytic", "dart", "mujoco", "pinocchio", "reference"]


@pytest.mark.parametrize(("N", "kind"), [(5, "overdetermined"), (7, "underdetermined")])
def test_other_numbers_of_legs_are_refused(N: int, kind: str, hexapod: Scene) -> None:
    data = hexapod.model_dump(by_alias=True)
    for part in ("platform", "hull"):
        data[part]["pins"] = (*data[part]["pins"], (0.1, 0.0, 0.5))[:N]
    with pytest.raises(SceneError, match=f"hull.pins: got {N} legs, expected 6: nv = {3 * N + 6}.*{kind}"):
        require_determinate(Scene.model_validate(data))
