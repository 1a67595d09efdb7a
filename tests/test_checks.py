"""Long trajectories: blocks that do not show, checks at every sample, memory, and what a process needs to import."""

from __future__ import annotations

import json
import subprocess
import sys
import tracemalloc
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from conftest import ENGINES

from stewart_crosscheck.crosscheck import chosen
from stewart_crosscheck.crosscheck import trajectory as trajectory_module
from stewart_crosscheck.crosscheck.checks import Worst, inverse_dynamics
from stewart_crosscheck.crosscheck.chosen import chosen_samples
from stewart_crosscheck.crosscheck.compare import agreement
from stewart_crosscheck.crosscheck.engine import LOOPS, DynamicsResult, EngineError, Key, load_engine
from stewart_crosscheck.crosscheck.run import run
from stewart_crosscheck.crosscheck.trajectory import Trajectory, from_scene
from stewart_crosscheck.models import Scene, load_scene


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """Blocks of 4 samples, and 5 of all samples are compared."""
    monkeypatch.setattr(chosen, "MOST_SAMPLES", 5)
    monkeypatch.setattr(trajectory_module, "BLOCK", 4)


def certain(trajectory: Trajectory) -> np.ndarray:
    return chosen_samples(len(trajectory.t), trajectory.condition, trajectory.sin_q_n)


# --- Blocks -----------------------------------------------------------------------------------------------------------


def test_the_largest_error_of_each_sample_is_kept_and_a_nan_is_larger_than_any() -> None:
    worst = Worst.of(np.array([[1.0, 3.0], [np.nan, 4.0], [2.0, 0.0]]), ["leg 1", "leg 2"])
    np.testing.assert_array_equal(worst.error, [3.0, np.nan, 2.0])
    np.testing.assert_array_equal(worst.column, [1, 0, 0])
    np.testing.assert_array_equal(worst.square, [5.0, np.nan, 2.0])
    twice = Worst.joined([worst, worst])
    np.testing.assert_array_equal(twice.error, [*worst.error, *worst.error])
    assert twice.columns == worst.columns == ("leg 1", "leg 2")


@pytest.mark.usefixtures("few")
def test_blocks_do_not_show(engine_name: str, hexapod: Scene, trajectory: Trajectory) -> None:
    """21 samples in blocks of 4 against the engine's own answer: its numbers where they are compared, checks at all."""
    engine = load_engine(engine_name)
    whole = engine(hexapod).inverse_dynamics(trajectory)
    got = inverse_dynamics(engine_name, engine, hexapod, None, trajectory)
    assert 5 <= len(got.samples) <= 7
    np.testing.assert_array_equal(got.samples, certain(trajectory))
    for name in ("L", "dL"):
        np.testing.assert_array_equal(getattr(got, name), getattr(whole, name)[got.samples])
    few = 4e-15 * np.abs(whole.reactions).max()  # blocks of a few samples are solved another way
    for name in ("F", "reactions"):
        np.testing.assert_allclose(getattr(got, name), getattr(whole, name)[got.samples], rtol=0, atol=few)
    for loop in LOOPS:
        want = Worst.of(np.linalg.norm(whole.loops[loop], axis=2), [f"leg {i}" for i in hexapod.legs])
        for part in range(3):
            np.testing.assert_array_equal(got.checks[loop][part], want[part])
    assert set(got.checks["balance"].columns) == {body.name for body in hexapod.bodies}
    assert len(got.checks["balance"].error) == got.evaluated == 21
    assert got.loops == {}


@pytest.mark.usefixtures("few")
def test_an_error_in_a_later_block_says_where_it_counts_from(hexapod: Scene, trajectory: Trajectory) -> None:
    class Late(Zeros):
        def inverse_dynamics(self, trajectory: Trajectory) -> DynamicsResult:
            result = super().inverse_dynamics(trajectory)
            result.F[1, 2] = np.nan if trajectory.t[0] > 0.7 else 0.0
            return result

    with pytest.raises(EngineError, match=r"^late: F is not finite at sample 1 \(counted from sample 8\)$"):
        inverse_dynamics("late", Late, hexapod, None, trajectory)


PLUGIN = """
import numpy as np
from stewart_crosscheck.crosscheck.engines.mujoco_ import MujocoEngine

class Once(MujocoEngine):
    name = "once"
    def inverse_dynamics(self, trajectory):
        result = super().inverse_dynamics(trajectory)
        at = np.flatnonzero(trajectory.t == {t!r})
        result.loops["loop_vel"][at, 1, 0] += 1e-6
        result.reactions[at, 0, 3] += 1e-3
        return result
"""


@pytest.mark.parametrize("engine_name", ["mujoco"], indirect=True)
@pytest.mark.parametrize("wrong", [True, False], ids=["wrong once", "never wrong"])
def test_a_fault_outside_the_truths_samples_is_seen(
    wrong: bool, engine_name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An engine of another distribution, which knows of no blocks, is wrong at one sample without truth."""
    scene = load_scene("pointmass2")
    trajectory = from_scene(scene, 2100)
    t = float(trajectory.t[np.setdiff1d(np.arange(2050, 2100), certain(trajectory))[0]])  # in the second block
    (tmp_path / "once_wrong.py").write_text(PLUGIN.format(t=t if wrong else -1.0))
    info = tmp_path / "once_wrong-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: once-wrong\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[stewart_crosscheck.engines]\nonce = once_wrong:Once\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "once_wrong", raising=False)
    report = run(scene, trajectory, ["once"])
    rows = report.agreement[report.agreement["engine"] == "once"].set_index(["route", "quantity"])
    failed = rows.index[rows["verdict"] == "fail"].tolist()
    assert failed == ([("kkt", "loop_vel"), ("kkt", "balance")] if wrong else [])
    assert report.status == int(wrong)
    if wrong:
        assert rows.loc[("kkt", "loop_vel"), "where"] == f"leg 2, t = {t:.6g} s"
        assert rows.loc[("kkt", "balance"), "where"] == f"guide1, t = {t:.6g} s"
    assert report.info["truth"]["samples"] == len(certain(trajectory))


# --- Memory -----------------------------------------------------------------------------------------------------------


class Zeros:
    """An engine that answers at once, as much as any other."""

    name: ClassVar[str] = "zeros"
    package: ClassVar[str] = "numpy"
    route: ClassVar[str] = "kkt"
    checks: ClassVar[tuple[str, ...]] = (*LOOPS, "balance")

    def __init__(self, scene: Scene, models: Mapping[str, str] | None = None) -> None:
        self.scene = scene

    def inverse_dynamics(self, trajectory: Trajectory) -> DynamicsResult:
        nt, N = len(trajectory.t), self.scene.N
        F, L, dL = np.zeros((3, nt, N))
        reactions = np.zeros((nt, len(self.scene.joints), 6))
        loops = {name: np.zeros((nt, N, 3)) for name in LOOPS}
        return DynamicsResult("zeros", "1", "kkt", "", np.arange(nt), F, reactions, L, dL, loops, seconds=1.0)


def growth(task: Callable[[Trajectory], object], hexapod: Scene) -> float:
    """What the peak of memory grows by, in bytes per sample, from 4000 to 20000 samples, beside the trajectory."""
    peaks = []
    for nt in (4000, 20000):
        trajectory = from_scene(hexapod, nt)
        tracemalloc.start()
        try:
            task(trajectory)
            peaks.append(tracemalloc.get_traced_memory()[1])
        finally:
            tracemalloc.stop()
    return (peaks[1] - peaks[0]) / 16000


def test_no_engine_holds_more_than_its_checks_of_every_sample(hexapod: Scene) -> None:
    """Four checks of three numbers are 96 bytes, and twice that while blocks are joined; all reactions are 1152."""
    assert growth(lambda trajectory: inverse_dynamics("zeros", Zeros, hexapod, None, trajectory), hexapod) < 300.0
    assert growth(lambda trajectory: Zeros(hexapod).inverse_dynamics(trajectory), hexapod) > 1500.0  # what it watches


def test_the_comparison_holds_no_more(hexapod: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    """A bound, its name in Unicode (100 bytes) and some masks for every sample, one quantity after the other."""
    monkeypatch.setattr(chosen, "MOST_SAMPLES", 20)  # the truth is not what is measured
    engines = {"zeros": Zeros, "reference": load_engine("reference")}
    results: dict[int, dict[Key, Any]] = {}
    for nt in (4000, 20000):
        trajectory = from_scene(hexapod, nt)
        results[nt] = {
            ("zeros", "kkt"): inverse_dynamics("zeros", Zeros, hexapod, None, trajectory),
            ("reference", "certified"): engines["reference"](hexapod).inverse_dynamics(trajectory),
        }
    compared = growth(lambda t: agreement("id", hexapod, t, engines, results[len(t.t)]), hexapod)
    assert compared < 500.0


# --- What a process imports -------------------------------------------------------------------------------------------

NOT_NEEDED = {"pandas", "scipy", "rich", "typer", "matplotlib"}

SCRIPT = """
import json, sys
from stewart_crosscheck.crosscheck.processes import Workers, dynamics
from stewart_crosscheck.crosscheck.trajectory import from_scene
from stewart_crosscheck.models import load_scene, write_models

if __name__ == "__main__":
    scene, name, more = load_scene("hexapod"), sys.argv[1], sys.argv[2]
    with Workers([name], 60.0) as workers:
        motion = workers.shared(from_scene(scene, 3))
        workers.start(name, "answer", dynamics, name, scene, write_models(scene), motion, None)
        for key, answer in workers.ended():
            if key == "answer":
                workers.start(name, "modules", eval, f"{more} and sorted(__import__('sys').modules)")
    print(json.dumps([answer, sorted(sys.modules)]))
"""


def loaded(name: str, more: str = "1") -> tuple[set[str], set[str]]:
    """Modules of an engine's process after its work, and of the one that started it, which has no table to make."""
    argv = [sys.executable, "-c", SCRIPT, name, more]
    done = subprocess.run(argv, capture_output=True, text=True, timeout=120, check=True)
    worker, parent = json.loads(done.stdout)
    return set(worker), set(parent)


@pytest.mark.parametrize("engine_name", ["analytic", *ENGINES, "reference"], indirect=True)
def test_a_process_imports_what_its_engine_needs(engine_name: str) -> None:
    worker, parent = loaded(engine_name)
    assert f"stewart_crosscheck.crosscheck.engines.{engine_name}_" in worker
    assert not worker & {"stewart_crosscheck.reports", "stewart_crosscheck.crosscheck.compare"}
    others = {f"stewart_crosscheck.crosscheck.engines.{other}_" for other in (*ENGINES, "reference")}
    assert worker & others <= {f"stewart_crosscheck.crosscheck.engines.{engine_name}_"}
    assert not worker & NOT_NEEDED
    assert not parent & NOT_NEEDED


def test_an_import_too_many_is_seen() -> None:
    worker, _ = loaded("analytic", more="__import__('pandas')")
    assert "pandas" in worker
