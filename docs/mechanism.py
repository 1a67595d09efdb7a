"""Draw docs/mechanism.svg, the picture of the README: `.venv/bin/python docs/mechanism.py`.

Points, axes, angles and the two forces are those of the built-in scene at t = 0; only the bodies' shapes are invented.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Wedge

from stewart_crosscheck import analytic
from stewart_crosscheck.crosscheck.trajectory import from_scene
from stewart_crosscheck.models.scene import load_scene

BASE, GUIDE, ROD, PLATFORM, HULL = "#8660ad", "#7fb2e0", "#f2a93b", "#2a9d77", "#f1f3f5"
INK, GREY, ANGLE, FORCE = "#1d2126", "#5f6870", "#0b7a3e", "#d0142c"
GUIDE_END = 0.54  # drawn length of a guide [m]
NEWTON = 0.0023  # drawn length of a force [m/N]
Shift = tuple[float, float]  # of a text, in points of type

SCENE = load_scene("hexapod")
START = from_scene(SCENE, samples=2)
X, Y, Z = np.eye(3)
C_P = START.position[0]
PINS = C_P + np.array(SCENE.platform.pins) @ START.rotation[0].T


class Leg:
    """Leg i from its joint coordinates: O = O_o = O_n, x_o, the guide's axes x, y, z, the tip at L along y."""

    def __init__(self, i: int) -> None:
        self.q_o, self.q_n, self.q_s = (float(START.q[f"{name}{i}"][0]) for name in "ons")
        self.O, self.L = np.array(SCENE.hull.pins[i - 1]), self.q_s + SCENE.leg.a
        self.x_o, self.z = np.cos(self.q_o) * X - np.sin(self.q_o) * Z, np.sin(self.q_o) * X + np.cos(self.q_o) * Z
        self.x = np.cos(self.q_n) * self.x_o + np.sin(self.q_n) * Y
        self.y = np.cross(self.z, self.x)
        assert np.allclose(self.at(self.L), PINS[i - 1]), f"leg {i} does not end at its platform pin"

    def at(self, distance: float) -> np.ndarray:
        """Point on the leg's axis."""
        return self.O + distance * self.y


class Part:
    """Half of the picture: orthographic, y_r up, seen from an azimuth (from z_r to x_r) and an elevation in degrees."""

    def __init__(self, ax: Axes, azimuth: float, elevation: float, title: str) -> None:
        (sa, se), (ca, ce) = np.sin(np.radians((azimuth, elevation))), np.cos(np.radians((azimuth, elevation)))
        self.ax, self.matrix = ax, np.array([[ca, 0.0, -sa], [-sa * se, ce, -ca * se]]).T
        ax.set_aspect("equal", anchor="S")
        ax.set_axis_off()
        ax.set_title(title, y=0, pad=-20, color=GREY, fontsize=11)

    def view(self, points: Any) -> Any:
        """World points in the picture."""
        return np.asarray(points) @ self.matrix

    def line(self, *points: Any, color: str = INK, lw: float = 1.2, zorder: float = 1, **style: Any) -> None:
        """Polyline."""
        self.ax.plot(*self.view(points).T, color=color, lw=lw, zorder=zorder, clip_on=False, **style)

    def tube(self, start: Any, end: Any, color: str, width: float, zorder: float) -> None:
        """A body: a thick line with an outline."""
        self.line(start, end, lw=width + 1.8, zorder=zorder, solid_capstyle="round")
        self.line(start, end, color=color, lw=width, zorder=zorder, solid_capstyle="round")

    def disc(self, centre: Any, radius: float, fc: str, ec: str, zorder: float) -> None:
        """Horizontal disc."""
        t = np.linspace(0.0, 2 * np.pi, 49)[:, None]
        circle = self.view(centre + radius * (np.cos(t) * X + np.sin(t) * Z))
        self.ax.fill(*circle.T, fc=fc, ec=ec, lw=0.9, zorder=zorder, clip_on=False)

    def pins(self, *points: Any, size: float) -> None:
        """Centres of joints."""
        self.line(*points, ls="", marker="o", ms=size, mfc="white", mec=INK, mew=1.0, zorder=12)

    def mass_centre(self, at: Any, radius: float) -> None:
        """The usual sign of a centre of mass."""
        for k, fc in enumerate((INK, "white") * 2):
            self.ax.add_patch(Wedge(self.view(at), radius, 90 * k, 90 * k + 90, fc=fc, ec=INK, lw=0.8, zorder=12))

    def label(self, at: Any, text: str, shift: Shift, color: str = INK, **style: Any) -> None:
        """Text at a point of the picture, shifted by so many points of type."""
        style = {"fontsize": 13, "ha": "center", "va": "center", "zorder": 20, "annotation_clip": False, **style}
        self.ax.annotate(text, at, shift, textcoords="offset points", color=color, **style)

    def head(self, start: Any, end: Any, color: str, lw: float, style: str = "-|>") -> None:
        """Arrow between points of the picture."""
        props = dict(arrowstyle=style, color=color, lw=lw, shrinkA=0, shrinkB=0, mutation_scale=8 + 3 * lw)
        self.ax.annotate("", end, start, arrowprops=props, annotation_clip=False, zorder=9)

    def arrow(self, start: Any, along: Any, text: str, shift: Shift, color: str = INK, lw: float = 1.8) -> None:
        """Vector of the world, its name at its end."""
        self.head(self.view(start), self.view(start + along), color, lw)
        self.label(self.view(start + along), text, shift, color)

    def arc(self, at: Any, start: Any, to: Any, q: float, radius: float, text: str, shift: Shift) -> None:
        """Angle |q| from one axis towards another."""
        t = np.linspace(0.0, abs(q), 41)[:, None]
        points = at + radius * (np.cos(t) * start + np.sin(t) * to)
        self.line(*points[:-3], color=ANGLE, lw=1.5, zorder=8)
        self.head(self.view(points[-6]), self.view(points[-1]), ANGLE, 1.5)
        self.label(self.view(points[20]), text, shift, ANGLE)

    def dimension(self, p: Any, q: Any, offset: float, text: str, shift: Shift = (0, 0)) -> None:
        """Dimension line beside the stretch that it measures."""
        p, q = self.view((p, q))
        side = offset * (q - p)[::-1] * (-1, 1) / np.linalg.norm(q - p)
        for end in (p, q):
            self.ax.plot(*np.transpose([end + 0.3 * side, end + 1.06 * side]), color=GREY, lw=0.7, zorder=1)
        self.head(p + side, q + side, GREY, 1.0, "<|-|>")
        self.label((p + q) / 2 + side, text, shift, bbox={"fc": "white", "ec": "none", "pad": 1.0})


def hexapod(part: Part) -> None:
    """The whole mechanism."""
    low, high = np.min(SCENE.hull.pins, axis=0) - 0.17, np.max(SCENE.hull.pins, axis=0) + 0.17
    corners = [(x, low[1], z) for x, z in ((low[0], low[2]), (high[0], low[2]), (high[0], high[2]), (low[0], high[2]))]
    part.ax.fill(*part.view(corners).T, fc=HULL, ec="#ced4da", zorder=0)
    part.label(part.view(corners[0]), "hull", (45, 2), GREY, fontsize=11)
    for i, number_side, pin_side in zip(SCENE.legs, (1, 1, 1, -1, -1, -1), (1, -1, 1, -1, -1, -1), strict=True):
        leg = Leg(i)
        foot = leg.O * (1, 0, 1) + low * Y
        part.disc(foot, 0.1, BASE, INK, 3)
        part.tube(foot, leg.O, BASE, 5, 4)
        part.tube(leg.at(GUIDE_END), leg.at(leg.L), ROD, 2.6, 5)
        part.tube(leg.O, leg.at(GUIDE_END), GUIDE, 6, 6)
        part.pins(leg.O, leg.at(leg.L), size=5)
        part.label(part.view(leg.at(0.32)), str(i), (11 * number_side, 3), weight="bold")
        part.label(part.view(leg.O), f"$O_{{o{i}}}$", (17 * pin_side, -1), fontsize=11)
    part.ax.fill(*part.view(PINS).T, fc=PLATFORM, alpha=0.45, lw=0, zorder=10)
    part.line(*PINS, PINS[0], color=PLATFORM, lw=2.4, zorder=11)
    part.mass_centre(C_P, 0.035)
    part.label(part.view(C_P), "$C_p$", (16, -2))
    for axis, name, shift in ((X, "$x_r$", (8, 6)), (Y, "$y_r$", (9, 5)), (Z, "$z_r$", (-1, -10))):
        part.arrow(0 * X, 0.27 * axis, name, shift, lw=1.4)
    part.label(part.view(0 * X), "$O_r$", (5, -13))
    g = np.array(SCENE.gravity) / np.linalg.norm(SCENE.gravity)
    part.arrow(C_P + 0.2 * Y + 0.8 * low * Z, 0.3 * g, "$g$", (11, 12), lw=2.2)


def one_leg(part: Part, i: int) -> None:
    """Leg i with its frames, coordinates and forces."""
    leg, a_n, dynamics = Leg(i), SCENE.leg.guide.com, analytic.inverse_dynamics(SCENE.parameters, START.motion)
    O, C_s, tip, foot, axle = leg.O, leg.at(leg.q_s), leg.at(leg.L), leg.O - 0.42 * Y, 0.1 * leg.z
    part.disc(foot, 0.27, HULL, "#ced4da", 0)
    part.label(part.view(foot), "hull", (66, -4), GREY, fontsize=11)
    part.disc(foot, 0.11, BASE, INK, 2)
    part.tube(foot, O, BASE, 11, 3)
    part.tube(O - axle, O, BASE, 7, 3)
    part.tube(O, tip, ROD, 8, 4)
    part.tube(O, leg.at(GUIDE_END), GUIDE, 17, 5)
    part.tube(O, O + axle, BASE, 7, 6)
    near = [tip + 0.22 * (p - tip) / np.linalg.norm(p - tip) for p in (PINS[i - 2], C_P, PINS[i % SCENE.N])]
    part.ax.fill(*part.view([tip, *near]).T, fc=PLATFORM, alpha=0.45, lw=0, zorder=3)
    part.line(near[0], tip, near[2], color=PLATFORM, lw=2.4, zorder=3)
    part.pins(O, tip, size=8)
    part.mass_centre(leg.at(a_n), 0.025)
    part.mass_centre(C_s, 0.025)
    part.label(part.view(C_s), "$C_s$", (15, 8))
    part.label(part.view(tip), f"$O_{{r{i}}}$", (17, 4))
    part.label(part.view(O), f"$O_{{o{i}}} = O_{{n{i}}}$", (46, -22))

    for axis, name, shift in ((Y, "$y_r$", (0, 9)), (X, "$x_r$", (10, 3)), (leg.x_o, "$x_o$", (10, -3))):
        part.line(O, O + 0.6 * axis, ls=(0, (5, 3)))
        part.label(part.view(O + 0.6 * axis), name, shift)
    for axis, name, shift in ((leg.x, "$x_n$", (10, 4)), (leg.y, "$y_n$", (21, 4)), (leg.z, "$z_n$", (-5, -11))):
        part.arrow(O, 0.4 * axis, name, shift)
    part.arc(O, X, -np.sign(leg.q_o) * Z, leg.q_o, 0.5, "$q_o$", (12, 0))
    part.arc(O, leg.x_o, Y, leg.q_n, 0.28, "$q_n$", (13, -7))
    part.arc(O, Y, -leg.x_o, leg.q_n, 0.5, "$q_n$", (0, 10))
    part.dimension(O, leg.at(a_n), 0.11, "$a_n$", (-9, -7))
    part.dimension(O, C_s, 0.26, "$q_s$")
    part.dimension(C_s, tip, 0.26, "$a$")
    part.dimension(O, tip, 0.38, "$L$")
    F, F_r = NEWTON * dynamics.F[0, i - 1] * leg.y, NEWTON * dynamics.F_r[0, i - 1]
    part.arrow(leg.at(GUIDE_END + 0.06), F, "$F$", (24, -4), FORCE, 2.6)
    part.arrow(tip - F_r, F_r, "$F_r$", (-10, 23), FORCE, 2.6)


if __name__ == "__main__":
    mpl.rcParams.update({"svg.hashsalt": "stewart-crosscheck", "mathtext.fontset": "dejavusans"})
    figure = Figure(figsize=(10, 5), facecolor="white")
    left, right = figure.add_axes((0.02, 0.19, 0.51, 0.80)), figure.add_axes((0.54, 0.19, 0.43, 0.80))
    hexapod(Part(left, -66, 27, "the hexapod at $t = 0$"))
    angles = ", ".join(f"${q} = {np.degrees(getattr(Leg(1), q)):.0f}°$" for q in ("q_o", "q_n"))
    one_leg(Part(right, -34, 30, f"leg 1 at $t = 0$, seen from another side: {angles}"), 1)
    keys = (BASE, f"{SCENE.N} bases"), (GUIDE, f"{SCENE.N} guides"), (ROD, f"{SCENE.N} rods"), (PLATFORM, "1 platform")
    lines = [Line2D([], [], color=color, lw=7, label=text) for color, text in keys]
    figure.legend(handles=lines, loc="lower center", ncols=4, frameon=False, fontsize=12)
    figure.savefig(Path(__file__).with_suffix(".svg"), metadata={"Date": None})
