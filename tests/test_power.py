"""Detection power: what is planted, what is seen of it, and that the published figure is what `run` does."""

from __future__ import annotations

import functools
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stewart_crosscheck.crosscheck import bounds, cli, power_work
from stewart_crosscheck.crosscheck import run as run_module
from stewart_crosscheck.crosscheck.engine import load_engine, routes
from stewart_crosscheck.crosscheck.power_faults import Nothing, Number
from stewart_crosscheck.crosscheck.power_mistakes import MISTAKES
from stewart_crosscheck.crosscheck.power_parameters import MACHINE, at, parameters, wrong
from stewart_crosscheck.crosscheck.power_work import FORMULAS, GAP, Place, Seen, Smallest, seen, smallest
from stewart_crosscheck.crosscheck.tolerance import Tolerance
from stewart_crosscheck.crosscheck.trajectory import from_scene
from stewart_crosscheck.models import Scene, load_scene, scene_names, write_models
from stewart_crosscheck.models.tables import LoadTable

SAMPLES = 5


@pytest.fixture(scope="session")
def place(hexapod: Scene) -> Place:
    trajectory = from_scene(hexapod, SAMPLES)
    return Place(hexapod, trajectory, load_engine("reference")(hexapod).inverse_dynamics(trajectory))


def loaded(scene: Scene) -> Scene:
    load = LoadTable(force=(3.0, 0.0, -2.0), moment=(0.0, 0.5, 0.0), point=(0.1, 0.0, 0.2))
    return scene.model_copy(update={"load": load})


# --- Parameters -------------------------------------------------------------------------------------------------------

NO_MACHINE = {"schema_", "name", "topology", "motion", "initial", "forces"}
"""Fields of a scene that are no numbers of its machine: they name it, or move it."""


def leaves(x: Any, name: str = "") -> Iterator[str]:
    """Names of all numbers of plain data."""
    if isinstance(x, dict):
        for key, value in x.items():
            yield from leaves(value, f"{name}.{key}")
    elif isinstance(x, (list, tuple)):
        for i, value in enumerate(x):
            yield from leaves(value, f"{name}.{i}")
    elif isinstance(x, float):
        yield name.removeprefix(".")


@pytest.mark.parametrize("name", scene_names())
def test_every_number_of_a_scene_has_a_row(name: str) -> None:
    scene = loaded(load_scene(name))
    assert set(type(scene).model_fields) == {*MACHINE, *NO_MACHINE}, (
        "a new field is a number of the machine, or it is not"
    )
    expected = set(leaves(scene.model_dump(include=set(MACHINE))))
    below = {f"platform.inertia.{i}.{j}" for i in range(3) for j in range(i)}
    found = [".".join(map(str, p.path)) for p in parameters(scene)]
    assert len(found) == len(set(found))
    assert set(found) == expected - below
    assert len({p.name for p in parameters(scene)}) == len(found)


@pytest.mark.parametrize("name", ["hexapod", "planar3", "tsai2000"])
def test_a_fault_changes_one_number_by_its_share(name: str) -> None:
    scene = loaded(load_scene(name))
    before = {p.path: at(scene, p.path) for p in parameters(scene)}
    for parameter in parameters(scene):
        off = wrong(scene, parameter, 0.25)
        changed = {path for path, value in before.items() if at(off, path) != value}
        assert changed == {parameter.path}
        assert abs(at(off, parameter.path) - before[parameter.path]) == pytest.approx(0.25 * parameter.size)
        assert (parameter.share_of == "itself") == (before[parameter.path] != 0.0)
        if "inertia" in parameter.path:
            assert np.array_equal(np.array(off.platform.inertia), np.array(off.platform.inertia).T)


# --- The search -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("threshold", [3e-16, 7e-9, 0.0011, 0.2, 0.99])
@pytest.mark.parametrize("power", [1, 2, 0.5])
@pytest.mark.parametrize("noise", [0.0, 0.3])
def test_the_smallest_fault_is_bracketed_by_looks(threshold: float, power: float, noise: float) -> None:
    looks: dict[float, bool] = {}

    def look(d: float) -> Seen:
        share = max(noise, (d / threshold) ** power)
        looks[d] = share > 1.0
        return Seen(share, "F", looks[d])

    found = smallest(look, "")
    assert looks[found.detected]
    assert not looks[found.missed]
    assert GAP * found.detected <= found.missed <= threshold <= found.detected
    assert len(looks) < 20


def test_a_fault_that_is_refused_is_found_without_a_size() -> None:
    def look(d: float) -> Seen:
        return Seen(np.inf, "refusal", True, "open loop") if d > 2e-7 else Seen(0.1, "F", False)

    found = smallest(look, "")
    assert found.missed <= 2e-7 < found.detected
    assert found.reason == "open loop"


def test_what_is_never_seen_is_blind_with_its_reason() -> None:
    def look(digest: str) -> Smallest:
        return smallest(lambda d: Seen(0.2, "F", False, digest=digest), "right")

    assert np.isnan(look("right").detected)
    assert look("right").reason == power_work.NOTHING
    assert look("other").reason == "at 100 % its error is 0.2 of what is allowed"


# --- What the figure says ---------------------------------------------------------------------------------------------


def of(place: Place, engine: str, name: str) -> float:
    """The smallest fault of a number that an engine detects on any of its routes."""
    parameter = next(p for p in parameters(place.scene) if p.name == name)
    found = []
    for route in routes(load_engine(engine)):
        right = seen(place, engine, route, Nothing(), 0.0)
        assert not right.detected
        found.append(smallest(functools.partial(seen, place, engine, route, Number(parameter)), right.digest).detected)
    return min(found)


CHANGES = [
    ("mujoco", "leg.rod.mass", "hexapod.xml", 'mass="2.8"', 'mass="{}"', 2.8),
    ("pinocchio", "platform.inertia.xy", "hexapod.urdf", 'ixy="0.083"', 'ixy="{}"', 0.083),
    ("dart", "hull.pins[5].z", "hexapod.urdf", 'xyz="-0.197 -0.052 -0.612"', 'xyz="-0.197 -0.052 {}"', -0.612),
]


@pytest.mark.parametrize(("engine_name", "name", "file", "old", "new", "value"), CHANGES, indirect=["engine_name"])
def test_the_figure_is_what_run_does(
    engine_name: str, name: str, file: str, old: str, new: str, value: float, place: Place, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    """The same claim by another way: the model's text is changed by hand, and the command is run."""
    d = of(place, engine_name, name)
    for times, status in ((2.0, 1), (1 / 3, 0)):

        def written(scene: Scene, off: float = value * (1.0 + times * d)) -> dict[str, str]:
            models = write_models(scene)
            assert old in models[file]
            return models | {file: models[file].replace(old, new.format(repr(off)))}

        monkeypatch.setattr(run_module, "write_models", written)
        out = tmp_path / str(status)
        argv = ["crosscheck", "run", "--samples", str(SAMPLES), "--engine", engine_name, "--out", str(out)]
        monkeypatch.setattr(sys, "argv", argv)
        with pytest.raises(SystemExit) as e:
            cli.main()
        assert e.value.code == status


DOC = (Path(__file__).parent.parent / "docs" / "detection-power.md").read_text(encoding="utf-8")


def test_the_published_table_is_the_one_that_comes_out(hexapod: Scene) -> None:
    """A row for each number but the pins, which share two; some of the formulas' column within a factor of two."""
    published = {
        cells[1].strip(" `"): cells[2].strip() for line in DOC.splitlines() if len(cells := line.split("|")) > 8
    }
    alone = {p.name for p in parameters(hexapod) if "pins" not in p.path}
    assert alone <= set(published)
    assert {"platform.pins`, all 18", "hull.pins`, all 18"} <= set(published)
    trajectory = from_scene(hexapod)
    place = Place(hexapod, trajectory, load_engine("reference")(hexapod).inverse_dynamics(trajectory))
    for name in ("gravity.y", "leg.rod.J_z", "platform.inertia.xy"):
        assert 0.5 < of(place, FORMULAS, name) / float(published[name]) < 2.0
    assert all(m.states in DOC for m in MISTAKES)


def test_a_wider_tolerance_makes_the_figure_larger(place: Place, monkeypatch: pytest.MonkeyPatch) -> None:
    before = of(place, FORMULAS, "platform.mass")
    monkeypatch.setattr(bounds, "ROUND_OFF", Tolerance("round_off", 1e-11, "a hundred times what it is", 3e-15))
    assert 50.0 < of(place, FORMULAS, "platform.mass") / before < 200.0


def test_a_fault_reaches_the_model_of_one_engine_alone(place: Place) -> None:
    """An engine computes from its model files: a wrong scene in its hands, less the load, would prove nothing."""
    scene = loaded(place.scene)
    right = Place(scene, place.trajectory, place.truth)
    for parameter in parameters(scene):
        with Number(parameter).planted(right, "mujoco", 0.5) as given:
            if parameter.path[0] == "load":
                assert given.models == write_models(scene)
                assert at(given.scene, parameter.path) != at(scene, parameter.path)
            else:
                assert given.models != write_models(scene)
                assert given.scene is scene
        with Number(parameter).planted(right, FORMULAS, 0.5) as given:
            assert at(given.scene, parameter.path) != at(scene, parameter.path)
        assert given.trajectory is place.trajectory
