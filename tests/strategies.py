"""Random machines and motions for Hypothesis, drawn number by number: they shrink towards a plain machine at rest.

Lengths, masses and angles are integers over a power of two, or such a number times a power of two: they are exact,
also after the changes of `test_invariances`, and short in a scene file.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import tomli_w
from hypothesis import note, reject
from hypothesis import strategies as st

from stewart_crosscheck.crosscheck.trajectory import Trajectory, TrajectoryError, from_scene
from stewart_crosscheck.models import Scene

Draw = Callable[[st.SearchStrategy], Any]

SAMPLES = 3
"""Samples of a drawn motion: its ends and one between."""

DOWN = (0.0, -9.81, 0.0)

# Pins around two rings, a little turned against each other, at heights that are not equal.
HULL = np.array(
    [[0.9, 0.05, -0.2], [0.6, -0.05, 0.7], [-0.3, 0.0, 0.9], [-0.9, 0.1, 0.2], [-0.65, 0.0, -0.7], [0.25, 0.05, -0.9]]
)
PLATFORM = np.array(
    [[0.35, 0.0, 0.1], [0.25, 0.05, 0.25], [-0.1, 0.0, 0.35], [-0.35, 0.05, 0.1], [-0.25, 0.0, -0.3], [0.15, 0.0, -0.3]]
)
FLAT_HULL, FLAT_PLATFORM = (
    np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.2]]),
    np.array([[-0.3, 0.0], [-0.2, 0.1], [0.3, 0.0]]),
)


def numbers(low: float, high: float, bits: int = 8) -> st.SearchStrategy[float]:
    """Multiples of 2^-bits; they shrink to the one nearest to zero."""
    return st.integers(round(low * 2**bits), round(high * 2**bits)).map(lambda n: n / 2**bits)


def sizes(decades: float) -> st.SearchStrategy[float]:
    """Positive numbers, so many decades below and above 1, which they shrink to."""
    most = round(decades * 3.3)
    return st.builds(lambda e, m: 2.0**e * (1.0 + m), st.integers(-most, most), numbers(0, 1))


def vectors(size: float) -> st.SearchStrategy[list[float]]:
    return st.lists(numbers(-size, size), min_size=3, max_size=3)


def _rounded(x: np.ndarray) -> np.ndarray:
    return np.round(x * 256) / 256


def _pins(draw: Draw, plain: np.ndarray, spread: float, size: float) -> list[list[float]]:
    """Pins around plain ones [m]; two numbers of a row in the plane."""
    n = plain.size
    off = np.array(draw(st.lists(numbers(-spread, spread), min_size=n, max_size=n))).reshape(plain.shape)
    pins = size * (_rounded(plain) + off)
    return np.hstack([pins, np.zeros((len(pins), 3 - pins.shape[1]))]).tolist()


def _wave(draw: Draw, c0: float, amplitude: float) -> dict[str, Any]:
    """A component of a motion: up to two sines about c0."""
    term = st.tuples(numbers(-amplitude, amplitude, 12), numbers(0, 8), numbers(0, 6)).map(list)
    return {"c0": c0, "terms": draw(st.lists(term, max_size=2))}


def _leg(draw: Draw, size: float, spin: bool) -> dict[str, Any]:
    """Masses over six decades, a radius of gyration between a hundredth and a half of the machine."""

    def radius() -> float:
        return size * draw(numbers(0.01, 0.5))

    def moments(mass: float) -> tuple[float, float]:
        J = mass * radius() ** 2
        return J, J * draw(numbers(0, 1.9)) if spin else 0.0

    m_n, m_s, com = draw(sizes(3)), draw(sizes(3)), size * draw(numbers(-0.25, 0.5))
    (J_c, J_ny), (J_s, J_sz) = moments(m_n), moments(m_s)
    return {
        "a": size * draw(numbers(-0.5, 0.5)),
        "guide": {"mass": m_n, "com": com, "J_x": J_c + m_n * com**2, "J_y": J_ny},
        "rod": {"mass": m_s, "J_x": J_s, "J_z": J_sz},
    }


def _load(draw: Draw, size: float, weight: float, axes: str) -> dict[str, list[float]]:
    """Force at a point and moment, on the scale of the platform's weight; `axes` that the platform has."""
    kept = {"spatial": ((1, 1, 1), (1, 1, 1)), "planar": ((1, 1, 0), (0, 0, 1)), "point": ((1, 1, 0), (0, 0, 0))}[axes]
    scale = weight * draw(sizes(1))
    force, moment, point = (draw(vectors(1.0)) for _ in range(3))
    return {
        "force": [x * k * scale for x, k in zip(force, kept[0], strict=True)],
        "moment": [x * k * scale * size for x, k in zip(moment, kept[1], strict=True)],
        "point": [0.0, 0.0, 0.0] if axes == "point" else [x * k * size for x, k in zip(point, kept[0], strict=True)],
    }


def _inertia(draw: Draw, mass: float, size: float) -> list[list[float]]:
    """Of a body whose second moments are T T^T with a lower triangle T, which all have that are not flat."""
    T = np.diag([draw(numbers(0.02, 0.5)) for _ in range(3)])
    T[np.tril_indices(3, -1)] = [draw(numbers(-0.25, 0.25)) for _ in range(3)]
    second = mass * size**2 * (T @ T.T)
    return (np.trace(second) * np.eye(3) - second).tolist()


@st.composite
def hexapods(draw: Draw, extreme: float = 1.0) -> Scene:
    """With and without bases and spin inertia, standing or hanging, of any size; more `extreme` ones lie wilder."""
    size, mass = 2.0 ** draw(st.integers(-6, 6)), draw(sizes(3))
    spin, base = draw(st.booleans()), draw(st.booleans())
    up = draw(st.sampled_from([1.0, -1.0])) * draw(numbers(0.75, 1.5))
    middle = [0.0, up, 0.0]
    position = [size * (c + draw(numbers(-0.1 * extreme, 0.1 * extreme))) for c in middle]
    angles = [draw(numbers(-0.25 * extreme, 0.25 * extreme)) for _ in range(3)]
    gravity = draw(st.one_of(st.just(DOWN), vectors(10.0)))
    leg = _leg(draw, size, spin)
    if base:
        leg["base"] = {"mass": draw(sizes(3)), "J_z": draw(sizes(3)) * size**2 / 256}
    data: dict[str, Any] = {
        "schema": 1,
        "name": "drawn",
        "topology": "spatial",
        "gravity": gravity,
        "leg": leg,
        "platform": {
            "mass": mass,
            "inertia": _inertia(draw, mass, size),
            "pins": _pins(draw, PLATFORM, 0.1 * extreme, size),
        },
        "hull": {"pins": _pins(draw, HULL, 0.15 * extreme, size)},
        "motion": {
            "duration": 1.0,
            "position": [_wave(draw, c, 0.1 * size) for c in position],
            "orientation": {
                "kind": draw(st.sampled_from(["rotation_vector", "cardan_xyz"])),
                "components": [_wave(draw, c, 0.25) for c in angles],
            },
        },
    }
    if draw(st.booleans()):
        data["load"] = _load(draw, size, 10.0 * mass, "spatial")
    return Scene.model_validate(data)


@st.composite
def planar(draw: Draw, extreme: float = 1.0) -> Scene:
    """A bar on three legs or a point mass on two, turned anyhow in its plane."""
    size, mass, point = 2.0 ** draw(st.integers(-6, 6)), draw(sizes(3)), draw(st.booleans())
    N = 2 if point else 3
    x, y = (size * (c + draw(numbers(-0.2 * extreme, 0.2 * extreme))) for c in (0.5, 0.75))
    leg = _leg(draw, size, spin=False)
    platform: dict[str, Any] = {"mass": mass}
    motion: dict[str, Any] = {"duration": 1.0, "position": [_wave(draw, x, 0.1 * size), _wave(draw, y, 0.1 * size), {}]}
    if not point:
        platform["J_z"] = mass * (size * draw(numbers(0.05, 0.5))) ** 2
        platform["pins"] = _pins(draw, FLAT_PLATFORM, 0.1 * extreme, size)
        turn = _wave(draw, draw(numbers(-0.5 * extreme, 0.5 * extreme)), 0.25)
        motion["orientation"] = {"kind": "rotation_vector", "components": [{}, {}, turn]}
    gravity = draw(st.one_of(st.just(DOWN), vectors(10.0).map(lambda g: [*g[:2], 0.0])))
    data: dict[str, Any] = {
        "schema": 1,
        "name": "drawn",
        "topology": "planar",
        "gravity": gravity,
        "leg": leg,
        "platform": platform,
        "hull": {"pins": _pins(draw, FLAT_HULL[:N], 0.2 * extreme, size)},
        "motion": motion,
    }
    if draw(st.booleans()):
        data["load"] = _load(draw, size, 10.0 * mass, "point" if point else "planar")
    return Scene.model_validate(data)


def scenes(extreme: float = 1.0) -> st.SearchStrategy[Scene]:
    return st.one_of(hexapods(extreme), planar(extreme))


def motion_of(scene: Scene) -> Trajectory:
    """The samples of a drawn machine; one that passes a singular pose is no example."""
    try:
        return from_scene(scene, SAMPLES)
    except TrajectoryError:
        reject()


def as_toml(scene: Scene) -> str:
    """The scene as a file that `crosscheck run` takes."""
    return tomli_w.dumps(scene.model_dump(by_alias=True, exclude_none=True))


FIRST, LAST = f"# --- a scene file, for `crosscheck run FILE --samples {SAMPLES}` ---", "# --- its end ---"


def show(scene: Scene) -> None:
    """Let Hypothesis print the file with the failure of the example that holds this scene."""
    note(f"{FIRST}\n{as_toml(scene)}{LAST}")
