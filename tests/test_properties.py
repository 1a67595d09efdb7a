"""Every engine and route agrees with certified truth on random machines, and a failing one is printed as a scene file.

`pytest tests/test_properties.py --hypothesis-profile long` draws a thousand examples of each, other ones every time.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest
from conftest import ENGINES, with_checks
from hypothesis import Phase, find, given, settings
from strategies import FIRST, LAST, SAMPLES, as_toml, hexapods, motion_of, planar, scenes, show

from stewart_crosscheck.crosscheck.compare import NO_BOUND, NO_DIGITS, agreement
from stewart_crosscheck.crosscheck.engine import REFERENCE, Engine, is_forward, load_engine
from stewart_crosscheck.crosscheck.trajectory import from_scene
from stewart_crosscheck.models import Scene, load_scene, write_models
from stewart_crosscheck.models.scene import parse_scene

every_engine = pytest.mark.parametrize("engine_name", ["analytic", *ENGINES], indirect=True)


def require_agreement(name: str, scene: Scene, models: Mapping[str, str] | None = None) -> None:
    """Judge both routes of an engine, which may read other models, and the truth itself as `crosscheck run` does."""
    trajectory = motion_of(scene)
    engines: dict[str, type[Engine]] = {name: load_engine(name), REFERENCE: load_engine(REFERENCE)}
    truth = engines[REFERENCE](scene).inverse_dynamics(trajectory)
    kind = engines[name]
    engine = kind(scene, models)
    results = {(name, kind.route): with_checks(scene, trajectory, kind, engine.inverse_dynamics(trajectory))}
    if is_forward(kind):
        assert isinstance(engine, kind)
        results[name, kind.forward_route] = engine.forward_dynamics(trajectory.without_accelerations(), truth.F)
    rows = agreement("id", scene, trajectory, engines, results | {(REFERENCE, "certified"): truth})
    wrong = rows[~rows["verdict"].isin(["pass", "unsupported"])]
    assert wrong.empty, wrong[["engine", "route", "quantity", "max_rel", "tolerance", "where"]].to_string()
    assert set(rows[rows["verdict"] == "unsupported"]["reason"]) <= {NO_BOUND, NO_DIGITS}


@every_engine
@given(scene=hexapods())
def test_every_route_agrees_on_a_hexapod(engine_name: str, scene: Scene) -> None:
    show(scene)
    require_agreement(engine_name, scene)


@every_engine
@given(scene=planar())
def test_every_route_agrees_in_the_plane(engine_name: str, scene: Scene) -> None:
    show(scene)
    require_agreement(engine_name, scene)


@given(scene=scenes())
def test_a_scene_survives_its_file(scene: Scene) -> None:
    assert parse_scene(as_toml(scene), "drawn.toml").model_dump() == scene.model_dump()


# --- What is drawn ----------------------------------------------------------------------------------------------------

KINDS: dict[str, Callable[[Scene], bool]] = {
    "with bases": lambda s: s.leg.base is not None,
    "without bases": lambda s: s.leg.base is None,
    "with spin": lambda s: s.leg.guide.J_y > 0 and s.leg.rod.J_z > 0,
    "without spin": lambda s: s.leg.guide.J_y == s.leg.rod.J_z == 0,
    "a below zero": lambda s: s.leg.a < 0,
    "a is zero": lambda s: s.leg.a == 0,
    "a above zero": lambda s: s.leg.a > 0,
    "guide's centre above its pin": lambda s: s.leg.guide.com < 0,
    "load": lambda s: s.load is not None and any(s.load.moment) and any(s.load.point),
    "inclined gravity": lambda s: s.gravity[0] * s.gravity[2] != 0,
    "hanging": lambda s: s.motion is not None and s.motion.position[1].c0 < 0,
    "at rest": lambda s: s.motion is not None and not any(c.terms for c in s.motion.position),
    "heavy legs": lambda s: s.leg.rod.mass > 100 * s.platform.mass,
    "heavy platform": lambda s: s.platform.mass > 100 * s.leg.rod.mass,
    "small": lambda s: np.ptp([p[0] for p in s.pins]) < 0.02,
    "cardan": lambda s: bool(s.motion and s.motion.orientation and s.motion.orientation.kind == "cardan_xyz"),
    "no pin opposite another": lambda s: min(abs(np.add(p, q)).max() for p in s.pins for q in s.pins) > 1e-3,
}
FLAT: dict[str, Callable[[Scene], bool]] = {
    "bar": lambda s: s.freedom == "planar",
    "point": lambda s: s.freedom == "point",
    "load": lambda s: s.load is not None and any(s.load.force),
    "moving": lambda s: s.motion is not None and len(s.motion.position[0].terms) == 2,
}
draws = settings(max_examples=1000, phases=[Phase.generate])


@pytest.mark.parametrize("kind", KINDS)
def test_hexapods_of_every_kind_are_drawn(kind: str) -> None:
    from_scene(find(hexapods(), KINDS[kind], settings=draws), SAMPLES)


@pytest.mark.parametrize("kind", FLAT)
def test_planar_machines_of_every_kind_are_drawn(kind: str) -> None:
    from_scene(find(planar(), FLAT[kind], settings=draws), SAMPLES)


# --- A failure --------------------------------------------------------------------------------------------------------


def with_heavier_rods(scene: Scene) -> dict[str, str]:
    """Models of the scene whose rods have one per mille more mass."""
    rod = scene.leg.rod.model_copy(update={"mass": scene.leg.rod.mass * 1.001})
    return write_models(scene.model_copy(update={"leg": scene.leg.model_copy(update={"rod": rod})}))


@pytest.mark.parametrize("engine_name", ["mujoco"], indirect=True)
def test_a_failing_scene_is_printed_as_a_file_that_run_takes(engine_name: str, tmp_path: Path) -> None:
    @settings(phases=[Phase.generate])  # what is found first is as good as the simplest, which takes a minute
    @given(scene=scenes())
    def property_(scene: Scene) -> None:
        show(scene)
        require_agreement(engine_name, scene, with_heavier_rods(scene))

    with pytest.raises(AssertionError) as failure:
        property_()
    message = "\n".join([str(failure.value), *failure.value.__notes__])
    assert "kkt        F" in message
    file = tmp_path / "failing.toml"
    file.write_text(message[message.index(FIRST) : message.index(LAST)])

    scene = load_scene(file)
    require_agreement(engine_name, scene)
    with pytest.raises(AssertionError, match="kkt"):
        require_agreement(engine_name, scene, with_heavier_rods(scene))
    argv = [sys.executable, "-m", "stewart_crosscheck.crosscheck", "run", file, "--engine", engine_name]
    argv += ["--samples", f"{SAMPLES}", "--out", tmp_path / "out"]
    done = subprocess.run(argv, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "all agree" in done.stdout
