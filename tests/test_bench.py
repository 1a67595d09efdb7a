"""Speed against error: what is measured and how, never how long it takes."""

from __future__ import annotations

import contextlib
import json
import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import pytest

from stewart_crosscheck.crosscheck import bench as benching
from stewart_crosscheck.crosscheck import bench_split, bench_work, cli, cli_bench
from stewart_crosscheck.crosscheck.bench import bench, measure, plan_cases, verdict
from stewart_crosscheck.crosscheck.bench_split import SPLIT_COLUMNS, split, split_cases, split_table
from stewart_crosscheck.crosscheck.bench_table import Error, Timed, Truth, ratio_to_fastest, speed_error
from stewart_crosscheck.crosscheck.bench_work import First, Warm, again, first
from stewart_crosscheck.crosscheck.engine import (
    REFERENCE,
    DynamicsResult,
    EngineError,
    Failure,
    engine_names,
    load_engine,
)
from stewart_crosscheck.crosscheck.machine import cpu_model
from stewart_crosscheck.crosscheck.problem import pose
from stewart_crosscheck.crosscheck.sweep import (
    BASELINE,
    FULL,
    QUICK,
    TASKS,
    Case,
    Inputs,
    Plan,
    Ready,
    load_sweep,
    parts,
    picked,
    sweep_names,
)
from stewart_crosscheck.crosscheck.trajectory import Trajectory, from_scene
from stewart_crosscheck.models import Scene, load_scene, scene_names, write_models
from stewart_crosscheck.reports import SPEED_ERROR_COLUMNS

TINY = Plan((1, 10), (10,), every=20, rounds=1, most=1.0, least=1e-4, samples=10)


# --- The command ------------------------------------------------------------------------------------------------------


class Done(NamedTuple):
    status: int
    out: str
    folder: Path
    table: pd.DataFrame
    info: dict


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Done:
    """Every engine on the hexapod by a tiny plan."""
    folder = tmp_path_factory.mktemp("bench") / "results"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(cli_bench, "QUICK", TINY)
        patch.setattr(sys, "argv", ["crosscheck", "bench", "--quick", "--out", str(folder)])
        console = cli_bench.console
        lines: list[str] = []

        def recording(stderr: bool = False) -> Any:
            screen = console(stderr)
            screen.print = lambda *objects, **_: lines.extend(map(str, objects))  # type: ignore[method-assign]
            return screen

        patch.setattr(cli_bench, "console", recording)
        with pytest.raises(SystemExit) as e:
            cli.main()
    table = pd.read_csv(folder / "speed_error.csv", keep_default_na=False)
    info = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    return Done(int(str(e.value.code)), "\n".join(lines), folder, table, info)


def test_every_engine_is_measured_and_exact_methods_hold(done: Done) -> None:
    assert done.status == 0, (done.info["failed"], done.info["wrong"])
    assert done.info["status"] == 0
    assert (done.info["failed"], done.info["wrong"]) == ([], [])


def test_the_files_are_those_of_the_contract(done: Done) -> None:
    plots = {f"{name}.{kind}" for name in ("work_precision", "scaling", "legs") for kind in ("svg", "png")}
    tables = {"speed_error.csv", "scaling.csv", "split.csv", "run.json", "report.html"}
    assert {file.name for file in done.folder.iterdir()} == plots | tables


def test_the_table_has_its_columns_and_every_expected_row(done: Done, hexapod: Scene) -> None:
    assert list(done.table.columns) == SPEED_ERROR_COLUMNS
    cases = [case for case in plan_cases(hexapod, engine_names(), TINY) if case.task in TASKS]
    expected = [(c.task, "hexapod", c.engine, c.route, c.backend, c.setting, c.batch) for c in cases]
    assert list(done.table[SPEED_ERROR_COLUMNS[:7]].itertuples(index=False, name=None)) == expected
    assert len(set(expected)) == len(expected)


def test_every_row_has_numbers(done: Done) -> None:
    numbers = done.table[SPEED_ERROR_COLUMNS[7:]].astype(float)
    assert np.isfinite(numbers).all(axis=None)
    assert (numbers["us_p10"] <= numbers["us_per_sample"]).all()
    assert (numbers["us_per_sample"] <= numbers["us_p90"]).all()
    assert (numbers["ratio_to_fastest"] >= 1.0).all()
    assert (numbers["max_rel_error"] > 0.0).all()


def test_errors_are_those_that_are_known(done: Done) -> None:
    """Hard loops near rounding; soft ones, large steps and loose tolerances far from it."""
    for _, row in done.table.iterrows():
        error, which = float(row["max_rel_error"]), f"{row['engine']} {row['task']} {row['setting']}"
        if row["task"] == "simulate":
            assert 1e-9 < error < 0.5, which
        elif row["route"] == "native":  # the first values of the knobs: d = 0.9, mu = 1e-4 once, dt = 1 ms
            assert 1e-6 < error < 0.5, which
        else:
            assert error < 1e-13, which


def test_run_json_tells_yardstick_machine_versions_and_threads(done: Done) -> None:
    info = done.info
    assert info["baseline"]["what"] == "pin.rnea, one call per sample"
    assert 0.0 < info["baseline"]["us_p10"] <= info["baseline"]["us_per_sample"] <= info["baseline"]["us_p90"]
    assert info["machine"]["cores"] >= info["machine"]["usable_cores"] >= 1
    assert {"python", "numpy", "mujoco", "pin", "dartpy"} <= set(info["versions"])
    assert set(info["roofline"]["least_us"]) == set(TASKS[:3])
    assert min(info["roofline"]["least_us"].values()) > 0.0
    assert info["plan"]["samples"] == TINY.samples
    assert set(info["threads"]) == {"analytic", "dart", "mujoco", "pinocchio", REFERENCE}
    assert {library["num_threads"] for libraries in info["threads"].values() for library in libraries} == {1}


def test_the_split_has_every_engine_and_task(done: Done) -> None:
    table = pd.read_csv(done.folder / "split.csv")
    assert list(table.columns) == SPLIT_COLUMNS
    assert len(table) == 3 * 4
    assert (table[["us_per_sample", "engine_share", "call_us"]] > 0.0).all(axis=None)
    assert {"mj_inverse", "rnea"} & set(table["call"])


def test_the_scaling_table_has_batches_and_numbers_of_legs(done: Done) -> None:
    table = pd.read_csv(done.folder / "scaling.csv", keep_default_na=False)
    assert set(TASKS[:3]) | {"forward_dynamics", "inverse_kinematics"} == set(table["what"])
    assert (table["peak_mb"] > 0.0).all()
    formulas = table[(table["engine"] == "analytic") & (table["what"] == "all_reactions")]
    assert list(formulas.groupby("backend")["batch"].max().unique()) == [10]


def test_an_engine_that_fails_keeps_its_rows_and_stops_nobody(hexapod: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    good = Case("driving_forces", "analytic", "closed_form", "numpy", "(7)-(8)", 10, exact=True)
    bad = Case("forward_step", "mujoco", "native", "", "softer", 10, (("softness", 1.0),))
    monkeypatch.setattr(benching, "plan_cases", lambda *_: [bad, good])
    report = bench(hexapod, plan=TINY)
    assert report.status == 3
    (failed,) = report.info["failed"]
    assert failed["engine"] == "mujoco"
    assert failed["reason"] == "mujoco: no knob 'softness'"
    assert report.info["crashed"] == []
    assert report.speed_error["us_per_sample"].isna().tolist() == [True, False]
    assert report.speed_error["ratio_to_fastest"].isna().tolist() == [True, False]


def _crash(*args: object) -> None:
    os.abort()


def test_an_engine_that_crashes_is_told(hexapod: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    good = Case("driving_forces", "analytic", "closed_form", "numpy", "(7)-(8)", 10, exact=True)
    monkeypatch.setattr(benching, "plan_cases", lambda *_: [good])
    monkeypatch.setattr(benching, "first", _crash)
    report = bench(hexapod, plan=TINY)
    assert report.status == 3
    assert report.info["crashed"] == ["analytic"]


def test_without_truth_nothing_is_measured(hexapod: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(benching, "dynamics", _no_truth)
    with pytest.raises(EngineError, match="no certified truth: reference: no radius"):
        bench(hexapod, plan=TINY)


def _no_truth(*_: object) -> None:
    raise EngineError("reference: no radius")


# --- The sweeps -------------------------------------------------------------------------------------------------------


def test_every_engine_has_a_sweep() -> None:
    assert set(sweep_names()) == {"analytic", "dart", "mujoco", "pinocchio", REFERENCE}


@pytest.mark.parametrize("name", scene_names())
@pytest.mark.parametrize("plan", [FULL, QUICK], ids=["full", "quick"])
def test_cases_are_distinct_rows_of_known_tasks(name: str, plan: Plan) -> None:
    cases = plan_cases(load_scene(name), engine_names(), plan)
    rows = [case[:6] for case in cases if case.task in TASKS]
    assert len(set(rows)) == len(rows) > 30
    assert cases[0].task == BASELINE
    assert {case.task for case in cases} >= set(TASKS)
    assert ("dae" in {case.route for case in cases}) == (load_scene(name).topology == "spatial")


def test_the_quick_plan_is_a_part_of_the_full_one(hexapod: Scene) -> None:
    quick, full = (plan_cases(hexapod, engine_names(), plan) for plan in (QUICK, FULL))
    assert set(quick) < set(full)
    assert {(c.engine, c.route, c.task) for c in quick} == {(c.engine, c.route, c.task) for c in full}


def test_one_engine_has_the_yardstick_beside_it(hexapod: Scene) -> None:
    cases = plan_cases(hexapod, ["mujoco"], QUICK)
    assert {case.engine for case in cases if case.task != BASELINE} == {"mujoco"}
    assert [case.engine for case in cases if case.task == BASELINE] == ["pinocchio"]


@pytest.mark.parametrize("batch", [1, 5, 20, 100, 1000])
def test_a_batch_holds_every_sample_and_is_read_all_over(batch: int) -> None:
    index = parts(20, batch)
    assert {len(part) for part in index} == {batch}
    pick = picked(20, batch)
    assert np.concatenate(index)[pick].tolist() == list(range(20))
    assert pick.max() >= len(np.concatenate(index)) * 0.9


# --- Errors -----------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def inputs(hexapod: Scene, trajectory: Trajectory, truth: DynamicsResult) -> Inputs:
    problem = pose(hexapod, 1.0, 26)
    return Inputs(hexapod, write_models(hexapod), trajectory, truth.F, problem)


@pytest.fixture(scope="module")
def judge(hexapod: Scene, trajectory: Trajectory, truth: DynamicsResult, inputs: Inputs) -> Truth:
    return Truth(hexapod, trajectory, truth, inputs.problem)


def right(task: str, judge: Truth) -> tuple[np.ndarray, ...]:
    """What a perfect engine answers."""
    motion, at = judge.problem.motion(), judge.trajectory
    return {
        "driving_forces": (judge.certified.F,),
        "all_reactions": (judge.certified.F, judge.certified.reactions),
        "forward_step": (np.hstack([at.acceleration, at.angular_acceleration]),),
        "simulate": (motion.position, motion.unit_quaternion),
    }[task]


def case(task: str, engine: str = "mujoco", batch: int = 1) -> Case:
    return Case(task, engine, "kkt", "", "hard loops", batch, exact=True)


@pytest.mark.parametrize("task", TASKS)
def test_a_wrong_answer_shows_its_error(task: str, judge: Truth) -> None:
    """The last number of the answer is changed at one sample: by a millionth of the scale, some five of ten."""
    good = right(task, judge)
    assert judge_error(judge, task, good).relative <= 1e-15
    bad = [x.copy() for x in good]
    bad[-1][3].flat[-1] += 1e-4
    error = judge_error(judge, task, bad)
    assert 1e-8 < error.relative < 1e-3
    if task == "simulate":
        assert error.share == 0.0  # the knob of an integrator is its error
    else:
        assert error.share > 1e4
        wrong = verdict({case(task): Timed([1.0], error, 0)})["wrong"]
        assert [(row["engine"], row["task"]) for row in wrong] == [("mujoco", task)]


def judge_error(judge: Truth, task: str, answer: Any) -> Error:
    error = judge.error(case(task), answer if len(answer) > 1 else answer[0])
    assert error is not None
    return error


@pytest.mark.parametrize("task", TASKS)
def test_an_answer_of_a_wrong_shape_or_without_a_number_is_refused(task: str, judge: Truth) -> None:
    good = right(task, judge)
    short = [x[1:] for x in good]
    with pytest.raises(EngineError, match=rf"mujoco.*: got shape .* expected \({len(good[0])}, "):
        judge_error(judge, task, short)
    bad = [x.copy() for x in good]
    bad[-1].flat[-1] = np.nan
    with pytest.raises(EngineError, match="the answer is not finite"):
        judge_error(judge, task, bad)


def test_the_reference_has_its_proven_radius_as_error(judge: Truth) -> None:
    error = judge.error(Case("all_reactions", REFERENCE, "certified", "", ""), right("all_reactions", judge))
    assert error is not None
    assert 1e-18 < error.relative < 2e-16


@pytest.mark.parametrize("batch", [1, 21, 42])
@pytest.mark.parametrize("task", TASKS[:3])
def test_what_is_judged_is_what_the_engine_answers(
    task: str, batch: int, engine_name: str, inputs: Inputs, judge: Truth
) -> None:
    ready = load_sweep(engine_name).ready(case(task, engine_name, batch), inputs)
    results = [ready.call(part) for part in ready.parts]
    assert ready.samples == max(batch, 21)
    error = judge.error(case(task, engine_name, batch), ready.read(results, picked(21, batch)))
    assert error is not None
    assert 0.0 < error.relative < 1e-13
    broken = ready.read([_shifted(r) for r in results], picked(21, batch))
    found = judge.error(case(task, engine_name, batch), broken)
    assert found is not None
    assert found.share > 1e3


def _shifted(result: Any) -> Any:
    """A result that is off by a millionth."""
    return tuple(x * (1 + 1e-6) for x in result) if isinstance(result, tuple) else result * (1 + 1e-6)


@pytest.mark.parametrize("name", [name for name in scene_names() if name != "hexapod"])
def test_every_built_in_scene_is_measured_exactly(name: str, engine_name: str) -> None:
    scene = load_scene(name)
    at = from_scene(scene, TINY.samples)
    truth = load_engine(REFERENCE)(scene).inverse_dynamics(at)
    given = Inputs(scene, write_models(scene), at, truth.F, pose(scene, 1.0, 26))
    engines = {engine_name, "analytic"}
    for c in plan_cases(scene, list(engines), TINY):
        if c.exact and c.batch == 10:
            ready = load_sweep(c.engine).ready(c, given)
            answer = ready.read([ready.call(part) for part in ready.parts], picked(10, 10))
            floor = getattr(load_engine(c.engine), "inertia_floor", 0.0)
            error = Truth(scene, at, truth, given.problem).error(c, answer, floor)
            assert error is not None
            assert error.share <= 1.0, c


@pytest.mark.parametrize("backend", ["long double", "ball"])
def test_the_formulas_on_more_digits_are_off_by_the_rounding_of_what_they_are_given(
    backend: str, inputs: Inputs, judge: Truth
) -> None:
    """So the text itself holds, and what float64 is off by is rounding."""
    plan = TINY._replace(samples=21)
    c = next(c for c in load_sweep("analytic").cases(inputs.scene, plan) if c.backend == backend)
    ready = load_sweep("analytic").ready(c, inputs)
    error = judge.error(c, ready.read([ready.call(part) for part in ready.parts], picked(21, 21)))
    assert error is not None
    assert error.relative < 5e-16  # the rotation is rounded to float64 before


def test_a_softer_knob_is_less_accurate(inputs: Inputs, judge: Truth) -> None:
    errors = {}
    for c in load_sweep("mujoco").cases(inputs.scene, FULL):
        if c.task == "forward_step" and c.route == "native" and c.batch == 1000:
            ready = load_sweep("mujoco").ready(c._replace(batch=21), inputs)
            error = judge.error(c, ready.read([ready.call(part) for part in ready.parts], picked(21, 21)))
            assert error is not None
            errors[c.setting] = error.relative
    assert list(errors) == [f"mj_forward, solimp {d:g}" for d in (0.9, 0.99, 0.999, 0.9999)]
    assert list(errors.values()) == sorted(errors.values(), reverse=True)
    assert max(errors.values()) > 500 * min(errors.values())  # proportional to (1 - d)/d


# --- Times ------------------------------------------------------------------------------------------------------------


CASES = [Case("driving_forces", name, "kkt", "", "hard loops") for name in "abc"]
ROUNDS = Plan((1,), (1,), 1, rounds=5, most=3.5, least=1.0)


def test_cases_are_timed_in_turns() -> None:
    visited: list[str] = []

    def start(c: Case) -> tuple[First, None]:
        visited.append(c.engine)
        return First(None, 2, 5, 0), None

    def visit(c: Case, number: int) -> float:
        assert number == 2
        visited.append(c.engine.upper())
        return 0.1

    found = measure(CASES, ROUNDS, start, visit)
    assert "".join(visited) == "abc" + 5 * "ABC"
    for result in found.values():
        assert isinstance(result, Timed)
        assert result.seconds == pytest.approx([0.1 / 10] * 5)


def test_a_case_that_takes_long_leaves_after_the_third_round() -> None:
    visited: list[str] = []

    def visit(c: Case, number: int) -> float:
        visited.append(c.engine)
        return 2.0 if c.engine == "b" else 0.1

    measure(CASES, ROUNDS, lambda c: (First(None, 1, 1, 0), None), visit)
    assert "".join(visited) == 3 * "abc" + 2 * "ac"


@pytest.mark.parametrize("when", [0, 2])
def test_a_case_that_fails_is_left_alone(when: int) -> None:
    visited: list[str] = []

    def start(c: Case) -> Any:
        return Failure("broken") if when == 0 and c.engine == "b" else (First(None, 1, 1, 0), None)

    def visit(c: Case, number: int) -> float | Failure:
        visited.append(c.engine)
        return Failure("broken") if visited.count("b") == when and c.engine == "b" else 0.1

    found = measure(CASES, ROUNDS, start, visit)
    assert found[CASES[1]] == Failure("broken")
    assert visited.count("b") == when
    assert visited.count("a") == visited.count("c") == 5


def test_quantiles_are_those_of_the_rounds() -> None:
    timed = Timed([s * 1e-6 for s in (11, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10)], Error(1e-15), 0)
    assert timed.us() == pytest.approx([6.0, 2.0, 10.0])


class Clock:
    """Time that passes only when something is done."""

    now = 0.0

    def __call__(self) -> float:
        return self.now


def test_a_pass_is_timed_by_the_clock_and_nothing_else(inputs: Inputs, monkeypatch: pytest.MonkeyPatch) -> None:
    clock, calls = Clock(), []

    class Sweep:
        def ready(self, c: Case, given: Inputs) -> Ready:
            clock.now += 100.0  # making ready is not timed

            def call(part: str) -> str:
                clock.now += 0.001
                calls.append(part)
                return part

            return Ready(["x", "y", "z"], call, lambda out, pick: "".join(out), samples=30)

    monkeypatch.setattr(bench_work, "load_sweep", lambda name: Sweep())
    warm = Warm(clock)
    facts = first(CASES[0], inputs, least=0.03, warm=warm)
    assert (facts.answer, facts.number, facts.samples) == ("xyz", 10, 30)
    calls.clear()
    assert again(CASES[0], inputs, 4, warm) == pytest.approx(0.012)
    assert "".join(calls) == 5 * "xyz"  # the first of them untimed
    assert clock.now < 101.0  # made ready once


def test_memory_of_a_batch_is_what_the_call_takes(inputs: Inputs, monkeypatch: pytest.MonkeyPatch) -> None:
    class Sweep:
        def ready(self, c: Case, given: Inputs) -> Ready:
            return Ready([0], lambda part: np.ones(1_000_000), lambda out, pick: None)

    monkeypatch.setattr(bench_work, "load_sweep", lambda name: Sweep())
    assert first(CASES[0], inputs, 1e-6, Warm()).peak == pytest.approx(8e6, rel=0.01)


def test_an_engine_is_watched_where_it_takes_many_samples(hexapod: Scene) -> None:
    watched = split_cases(plan_cases(hexapod, engine_names(), QUICK), QUICK)
    assert {case.batch for case in watched} == {1000}
    rows = [(case.engine, case.task, case.route) for case in watched if case.engine not in ("analytic", REFERENCE)]
    kkt = [(name, task, "kkt") for name in ("dart", "mujoco", "pinocchio") for task in TASKS[:3]]
    native = [(name, "forward_step", "native") for name in ("dart", "mujoco", "pinocchio")]
    assert sorted(rows) == sorted(kkt + native)


def test_the_split_is_the_engines_share_and_its_costliest_call(inputs: Inputs, monkeypatch: pytest.MonkeyPatch) -> None:
    @contextlib.contextmanager
    def watching(engine: object) -> Iterator[dict[str, float]]:
        spent: dict[str, float] = {}
        yield spent
        spent |= {"short": 2e-3, "long": 6e-3}

    class Sweep:
        def ready(self, c: Case, given: Inputs) -> Ready:
            engine = None if c.engine == "a" else object()
            return Ready([0, 1], lambda part: time.sleep(0.01), lambda out, pick: None, 4, engine)

    monkeypatch.setattr(bench_split, "watching", watching)
    monkeypatch.setattr(bench_work, "load_sweep", lambda name: Sweep())
    warm = Warm()
    found = {c: split(c, inputs, warm) for c in CASES[:2]}
    assert found[CASES[0]] is None
    (row,) = split_table(found | {CASES[2]: Failure("broken")}).itertuples()
    assert (row.engine, row.task, row.route, row.call) == ("b", "driving_forces", "kkt", "long")
    assert row.call_us == pytest.approx(1500.0)
    us = float(str(row.us_per_sample))
    assert us >= 5000.0
    assert row.engine_share == pytest.approx(2000.0 / us)


# --- The ratio --------------------------------------------------------------------------------------------------------


def test_the_fastest_is_one_that_is_as_accurate_and_takes_no_more_samples() -> None:
    rows = pd.DataFrame(
        [
            ("t", 1, 8.0, 1e-15, 1.0),  # nobody as accurate is faster one by one
            ("t", 100, 2.0, 9e-15, 1.0),
            ("t", 100, 4.0, 2e-15, 2.0),  # the one above is within a decade
            ("t", 100, 6.0, 1e-16, 1.0),  # as accurate as nobody: the one above is a decade worse
            ("t", 100, 1.0, 1e-6, 1.0),  # faster, but wrong: counts for nobody but itself
            ("t", 1000, 3.0, 1.0, 3.0),
            ("u", 100, 3.0, 1e-3, 1.0),  # another task
            ("u", 100, np.nan, np.nan, np.nan),
        ],
        columns=["task", "batch", "us_per_sample", "max_rel_error", "expected"],
    )
    np.testing.assert_array_equal(ratio_to_fastest(rows), rows["expected"])


def test_a_faster_wrong_engine_is_not_what_others_are_compared_with(hexapod: Scene) -> None:
    def table(error: float) -> pd.DataFrame:
        fast, slow = CASES[0], CASES[1]
        return speed_error(hexapod, {fast: Timed([1e-6], Error(error), 0), slow: Timed([5e-6], Error(1e-15), 0)})

    assert table(1e-15)["ratio_to_fastest"].tolist() == pytest.approx([1.0, 5.0])
    assert table(1e-3)["ratio_to_fastest"].tolist() == pytest.approx([1.0, 1.0])


# --- The machine ------------------------------------------------------------------------------------------------------


def test_the_processor_is_named_by_the_first_of_its_cores(tmp_path: Path) -> None:
    info = tmp_path / "cpuinfo"
    info.write_text("model name\t: Fast One\ncpu family\t: 26\nmodel\t\t: 2\n\nmodel name\t: Slow One\n")
    assert cpu_model(info) == "Fast One, cpu family 26, model 2"
    assert cpu_model(tmp_path / "nothing") == ""
