"""Outcomes: what becomes of right, rough, wrong and missing answers at a hard point."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from test_certainty import row_of

from stewart_crosscheck.crosscheck.certainty import certain_forward, certain_inverse
from stewart_crosscheck.crosscheck.engine import DynamicsResult, Failure, load_engine
from stewart_crosscheck.crosscheck.engines.analytic_ import AnalyticEngine
from stewart_crosscheck.crosscheck.hard import FORWARD, INVERSE, Accelerated, Case, Point, load_family
from stewart_crosscheck.crosscheck.outcome import ACCURATE, DEGRADED, REFUSED, SILENT, Place, judge, outcome_of
from stewart_crosscheck.crosscheck.stress_work import Answer, Method, answers, methods
from stewart_crosscheck.crosscheck.trajectory import from_scene
from stewart_crosscheck.models import Scene

KKT, CLOSED = Method("kkt", INVERSE), Method("closed_form", INVERSE)


@pytest.fixture(scope="module")
def point(hexapod: Scene) -> Point:
    return Point(hexapod, row_of(from_scene(hexapod, 7), 3))


@pytest.fixture(scope="module")
def places(point: Point) -> dict[str, Place]:
    truths = {INVERSE: certain_inverse(point), FORWARD: certain_forward(point)}
    return {problem: Place.of(point, truth) for problem, truth in truths.items()}


def outcomes(point: Point, place: Place | Failure, method: Method, answer: Answer | Failure) -> dict[str, str]:
    return {row["quantity"]: row["outcome"] for row in judge(point, place, method, answer, 0.0)}


@pytest.mark.parametrize(
    ("error", "sensitivity", "stated", "outcome"),
    [
        (9.9e-14, 1e-15, 1e-20, ACCURATE),
        (1.1e-13, 1e-15, 1e-12, DEGRADED),
        (1.1e-13, 1e-15, 1.0e-13, SILENT),
        (0.5, 1e-15, 0.2, DEGRADED),  # a route that says that it knows nothing
        (0.5, 1e-15, np.inf, DEGRADED),
        (0.5, 1e-15, np.nan, SILENT),
        (0.05, 1e-2, 1e-12, ACCURATE),
        (0.5, 1e-2, 1e-12, DEGRADED),  # as near as float64 comes, and no digits
        (np.nan, 1e-15, 1e-12, SILENT),
        (np.inf, 1e-15, 1e-12, SILENT),
    ],
)
def test_outcome_of_an_error(error: float, sensitivity: float, stated: float, outcome: str) -> None:
    got, reason = outcome_of(error, sensitivity, stated)
    assert got == outcome
    assert bool(reason) == (outcome != ACCURATE)


def test_every_method_is_accurate_or_says_how_far_it_is_off(
    engine_name: str, point: Point, places: dict[str, Place]
) -> None:
    """At an easy point: exact routes are accurate, engines' own solvers degraded within their laws."""
    (found,) = answers(engine_name, [point])
    assert set(found) == set(methods(load_engine(engine_name)))
    for method, answer in found.items():
        assert not isinstance(answer, Failure), answer
        got = outcomes(point, places[method.problem], method, answer)
        assert set(got.values()) <= {ACCURATE, DEGRADED}
        if method.route != "native" or engine_name == "pinocchio":
            assert set(got.values()) == {ACCURATE}


def test_every_form_of_the_formulas_is_accurate(point: Point, places: dict[str, Place]) -> None:
    (found,) = answers("analytic", [point])
    routes = [(method.problem, method.route) for method in found]
    assert routes == [
        (INVERSE, "closed_form"), (INVERSE, "printed"), (FORWARD, "closed_form"), (FORWARD, "6x6"), (FORWARD, "6+N"),
        (FORWARD, "dae"),
    ]  # fmt: skip
    for method, answer in found.items():
        assert set(outcomes(point, places[method.problem], method, answer).values()) == {ACCURATE}, method


def test_a_wrong_answer_is_silent(point: Point, places: dict[str, Place]) -> None:
    """One driving force off by 1e-11 of the largest; one acceleration likewise."""
    (found,) = answers("analytic", [point])
    right = found[CLOSED]
    assert isinstance(right, DynamicsResult)
    F = right.F.copy()
    F[0, 2] += 1e-11 * places[INVERSE].size.force
    got = outcomes(point, places[INVERSE], CLOSED, replace(right, F=F))
    assert got.pop("F") == SILENT
    assert set(got.values()) == {ACCURATE}
    method = Method("6x6", FORWARD, with_reactions=False)
    a = found[method]
    assert isinstance(a, Accelerated)
    a.platform[0, 4] += 1e-10 * places[FORWARD].size.of("alpha")
    assert outcomes(point, places[FORWARD], method, a) == {"a": ACCURATE, "alpha": SILENT}


def test_a_wrong_model_is_silent(engine_name: str, hexapod: Scene, point: Point, places: dict[str, Place]) -> None:
    """The engine is asked about a platform that is lighter by 1e-9 of itself."""
    platform = hexapod.platform.model_copy(update={"mass": hexapod.platform.mass * (1 - 1e-9)})
    other = point._replace(scene=hexapod.model_copy(update={"platform": platform}))
    (found,) = answers(engine_name, [other])
    assert outcomes(point, places[INVERSE], KKT, found[KKT])["F"] == SILENT


def test_refusals_and_answers_without_truth(point: Point, places: dict[str, Place]) -> None:
    (found,) = answers("analytic", [point])
    refused = list(judge(point, places[INVERSE], CLOSED, Failure("too steep"), 0.0))
    assert {(row["outcome"], row["reason"]) for row in refused} == {(REFUSED, "too steep")}
    assert all(np.isfinite(row["input_sensitivity"]) and np.isnan(row["max_rel_error"]) for row in refused)
    unknown = list(judge(point, Failure("singular pose"), CLOSED, found[CLOSED], 0.0))
    assert {row["outcome"] for row in unknown} == {SILENT}
    assert all("singular pose" in row["reason"] and row["condition"] > 1 for row in unknown)
    both = judge(point, Failure("singular pose"), CLOSED, Failure("singular too"), 0.0)
    assert {row["outcome"] for row in both} == {REFUSED}


def test_least_sensitivity_is_rounding(places: dict[str, Place]) -> None:
    """M_n is a hundred thousandth of the scale: what inputs move it by is far below the last digit of the scale."""
    place = places[INVERSE]
    assert place.truth.sensitivity["M_n"] / place.size.of("M_n") < 2.0**-60
    assert place.sensitivity("M_n") == 2.0**-53
    assert place.sensitivity("F") > 2.0**-53


@pytest.mark.parametrize(
    ("family", "name", "value"),
    [
        ("scale", "scale_light_legs", 1e-14),
        ("scale", "scale_light_platform", 1e-20),
        ("steep", "steep_moving_thin", 1e-9),
        ("parallel", "parallel_yaw", 1e-6),
    ],
)
def test_no_tolerance_excuses_the_formulas(family: str, name: str, value: float) -> None:
    """However hard the point: accelerations the wrong way round, forces off by a twentieth."""
    case = next(c for c in load_family(family) if c.name == name)
    assert isinstance(case, Case)
    point = case.at(value)
    (found,) = answers("analytic", [point])
    states_nothing = AnalyticEngine.states_nothing
    for problem, truth in ((INVERSE, certain_inverse(point)), (FORWARD, certain_forward(point))):
        place, method = Place.of(point, truth), Method("closed_form", problem, problem == INVERSE)
        answer = found[method]
        right = {r["outcome"] for r in judge(point, place, method, answer, 0.0, method.route in states_nothing)}
        assert right == {ACCURATE}
        if isinstance(answer, Accelerated):
            answer = answer._replace(platform=-3.0 * answer.platform)
        else:
            assert isinstance(answer, DynamicsResult)
            answer = replace(answer, F=1.05 * answer.F)
        wrong = {r["quantity"]: r["outcome"] for r in judge(point, place, method, answer, 0.0, True)}
        assert SILENT in {wrong["F" if problem == INVERSE else "a"]}


def test_a_refusal_has_the_rows_of_an_answer(engine_name: str, point: Point, places: dict[str, Place]) -> None:
    (found,) = answers(engine_name, [point])
    for method, answer in found.items():
        place = places[method.problem]
        refused = outcomes(point, place, method, Failure("no"))
        assert list(refused) == list(outcomes(point, place, method, answer))
        assert set(refused.values()) == {REFUSED}


def judged(family: str, name: str, value: float, engine: str, method: Method) -> tuple[Point, Place, Answer]:
    """A hard point with its truth and one answer."""
    case = next(c for c in load_family(family) if c.name == name)
    assert isinstance(case, Case)
    point = case.at(value)
    (found,) = answers(engine, [point])
    answer = found[method]
    assert not isinstance(answer, Failure), answer
    return point, Place.of(point, certain_forward(point)), answer


@pytest.mark.parametrize("engine_name", ["dart"], indirect=True)
def test_dart_says_how_far_velocities_are_rounded_over_its_step(engine_name: str) -> None:
    """In slow units of time velocities are far above accelerations; its step in seconds stays."""
    method = Method("native", FORWARD)
    point, place, answer = judged("scale", "scale_time", 1e5, engine_name, method)
    assert SILENT not in outcomes(point, place, method, answer).values()
    assert isinstance(answer, DynamicsResult)
    assert SILENT in outcomes(point, place, method, replace(answer, amplification=1e6)).values()


@pytest.mark.parametrize("engine_name", ["pinocchio"], indirect=True)
def test_hard_loops_say_how_far_a_steep_leg_s_inertia_is_rounded(engine_name: str) -> None:
    method = Method("kkt", FORWARD, with_reactions=False)
    point, place, answer = judged("steep", "steep_moving_thin", 1e-4, engine_name, method)
    assert set(outcomes(point, place, method, answer).values()) == {DEGRADED}
    assert isinstance(answer, Accelerated)
    assert SILENT in outcomes(point, place, method, answer._replace(growth=1.0)).values()
