"""The checks bite: one number or sign changed in a model text or in the formulas, and `run` ends with 1 and names it.

Nothing is changed in the scene: truth and the other engines stay what they are.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from stewart_crosscheck.crosscheck import cli
from stewart_crosscheck.crosscheck import run as run_module
from stewart_crosscheck.models import write_models

ROOT = Path(__file__).parent.parent
FORCES = {"F", "F_r", "F_s", "F_n", "F_o"}


def changed(text: str, old: str, new: str, count: int = 1) -> str:
    """`text` with the first `count` occurrences changed; `old` must be there, or the test changes nothing."""
    assert old in text, old
    return text.replace(old, new, count)


def failed(output: str) -> dict[str, set[str]]:
    """Engine to quantities of the FAIL lines that `run` prints, its own solver's aside."""
    found: dict[str, set[str]] = {}
    for line in output.splitlines():
        if line.startswith("FAIL "):
            _, engine, route, quantity = line.split(":")[0].split()
            if route != "native":
                found.setdefault(engine, set()).add(quantity)
    return found


def run_cli(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture, out: Path, engine: str) -> tuple[int, str]:
    argv = ["crosscheck", "run", "--samples", "5", "--out", str(out), "--engine", engine, "--engine", "analytic"]
    monkeypatch.setattr(sys, "argv", argv)
    with pytest.raises(SystemExit) as e:
        cli.main()
    return int(e.value.code or 0), capsys.readouterr().out


# A leg whose hull pin moves carries the same forces: only its own loop can tell.
MJCF = {
    "mass of rod 3 by 1e-6": (
        'name="rod3">\n          <inertial mass="2.8"',
        'name="rod3">\n          <inertial mass="2.8000028"',
        FORCES,
    ),
    "inertia of guide 1 by 1e-6": ("0.07906000000000005 0.0094", "0.07906007906 0.0094", FORCES),
    "inertia of base 1 by 1e-6": ('"0.0117 0.0117 0.0117"', '"0.0117 0.0117000117 0.0117"', {"M_o"}),
    "platform pin 4 by 1e-6 m": ('pos="-0.362 -0.055 0.049"', 'pos="-0.362 -0.055 0.049001"', {*FORCES, "loop_pos"}),
    "hull pin 5 by 1e-6 m": ('pos="-0.197 -0.052 -0.612"', 'pos="-0.197001 -0.052 -0.612"', {"loop_pos"}),
    "sign of a hinge": (
        'name="n1" type="hinge" axis="0 0 1"',
        'name="n1" type="hinge" axis="0 0 -1"',
        {*FORCES, "loop_pos"},
    ),
    "sign of gravity": ('gravity="0.0 -9.81 0.0"', 'gravity="0.0 9.81 0.0"', FORCES),
}

URDF = {
    "mass of guide 1 by 1e-6": ('<mass value="3.4" />', '<mass value="3.4000034" />', FORCES),
    "inertia of rod 1 by 1e-6": ('ixx="0.0917"', 'ixx="0.0917000917"', FORCES),
    "product of inertia of the platform": ('ixy="0.083"', 'ixy="-0.083"', FORCES),
    "hull pin 6 by 1e-6 m": ('xyz="0.162 0.127 -1.251"', 'xyz="0.162 0.127001 -1.251"', {"loop_pos"}),
    "sign of a slide": ('<axis xyz="0 1 0" />', '<axis xyz="0 -1 0" />', {*FORCES, "loop_pos"}),
    "platform pin 2 of the loop list by 1e-6 m": ("-0.063,", "-0.063001,", {*FORCES, "loop_pos"}),
    "rod's length in the loop list by 1e-6 m": ("0.37,", "0.370001,", {*FORCES, "loop_pos"}),
}
CHANGES = [("mujoco", what) for what in MJCF] + [(e, what) for e in ("pinocchio", "dart") for what in URDF]


@pytest.mark.parametrize(("engine_name", "what"), CHANGES, indirect=["engine_name"])
def test_a_change_in_a_model_text_is_caught(
    engine_name: str, what: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    old, new, quantities = (MJCF if engine_name == "mujoco" else URDF)[what]

    def written(scene):
        models = write_models(scene)
        name = next(n for n, text in models.items() if old in text and n.endswith(".xml") == (engine_name == "mujoco"))
        return models | {name: changed(models[name], old, new)}

    monkeypatch.setattr(run_module, "write_models", written)
    status, output = run_cli(monkeypatch, capsys, tmp_path / "out", engine_name)
    assert status == 1
    assert set(failed(output)) == {engine_name}
    assert failed(output)[engine_name] >= quantities


# --- Formulas ---------------------------------------------------------------------------------------------------------

FORMULAS = {
    "(2) mass by 1e-6": ("F_is = leg.m_s * (k.A_y", "F_is = 1.000001 * leg.m_s * (k.A_y", {"F"}),
    "(3) sign of gravity": ("k.dq_n + m_q * dot(k.x_n, g)", "k.dq_n - m_q * dot(k.x_n, g)", FORCES),
    "(3) J_y by 1e-6": ("M_in = M_in + J_y * k.c", "M_in = M_in + 1.000001 * J_y * k.c", {"F_r"}),
    "(4) sign of the base's inertia": ("(leg.J_oz * h.ddq_o + k.c * J_y", "(-leg.J_oz * h.ddq_o + k.c * J_y", FORCES),
    "(5) inertia by 1e-6": ("J_q = leg.J_nx + leg.J_sx", "J_q = 1.000001 * leg.J_nx + leg.J_sx", FORCES),
    "(7) mass by 1e-6": ("right_7 = sub(mul(P.m_p,", "right_7 = sub(mul(1.000001 * P.m_p,", FORCES),
    "(8) sign of the gyroscopic moment": ("cross(w_P, apply(P.I_p, w_P))", "cross(apply(P.I_p, w_P), w_P)", FORCES),
    "(8) lever by 1e-6 m": ("*cross(k.r, k.y_n)))", "*cross(add(k.r, (1e-6, 0.0, 0.0)), k.y_n)))", FORCES),
    "(24) mass by 1e-6": ("F_s = sub(mul(leg.m_s,", "F_s = sub(mul(1.000001 * leg.m_s,", {"F_s", "F_n", "F_o"}),
    "(25) sign of a_n": ("sub(mul(leg.a_n, ddy_n), g)", "sub(mul(-leg.a_n, ddy_n), g)", {"F_n", "F_o"}),
    "(26) mass by 1e-6": ("F_o = sub(F_n, mul(leg.m_o, g))", "F_o = sub(F_n, mul(1.000001 * leg.m_o, g))", {"F_o"}),
    "(27) arm by 1e-6": ("M_s_x = leg.J_sx * k.u - leg.a", "M_s_x = leg.J_sx * k.u - 1.000001 * leg.a", {"M_s"}),
    "(28) inertia by 1e-6": ("M_n = sub(mul(-J_y * h.e", "M_n = sub(mul(-1.000001 * J_y * h.e", {"M_n"}),
    "(29) sign": ("M_o = mul(-(J_y * h.e + k.c", "M_o = mul(-(J_y * h.e - k.c", {"M_o"}),
}


def run_with_formulas(folder: Path, old: str, new: str, *engines: str) -> tuple[int, str]:
    """`run` on a copy of the whole tree whose formulas are changed, in a fresh interpreter."""
    package = folder / "stewart_crosscheck"
    for part in ("analytic", "models", "crosscheck", "reports"):
        shutil.copytree(ROOT / part, package / part, ignore=shutil.ignore_patterns("__pycache__"))
    text = package / "analytic" / "stewart.py"
    text.write_text(changed(text.read_text(), old, new))
    argv = [sys.executable, "-m", "stewart_crosscheck.crosscheck", "run", "--samples", "5", "--out", "out"]
    argv += [word for engine in engines for word in ("--engine", engine)]
    done = subprocess.run(
        argv, cwd=folder, env=os.environ | {"PYTHONPATH": str(folder)}, capture_output=True, text=True
    )
    return done.returncode, done.stdout + done.stderr


@pytest.mark.parametrize("what", FORMULAS)
def test_a_change_in_a_formula_is_caught(what: str, tmp_path: Path) -> None:
    old, new, quantities = FORMULAS[what]
    status, output = run_with_formulas(tmp_path, old, new, "analytic")
    assert status == 1, output
    assert set(failed(output)) == {"analytic"}
    assert failed(output)["analytic"] >= quantities


def test_the_copy_agrees_when_nothing_is_changed_and_is_the_one_that_runs(tmp_path: Path) -> None:
    status, output = run_with_formulas(tmp_path, "r = apply(R, p)", "print('the copy'); r = apply(R, p)", "analytic")
    assert status == 0, output
    assert "the copy" in output


@pytest.mark.parametrize("engine_name", ["mujoco"], indirect=True)
@pytest.mark.parametrize(
    ("old", "new", "quantities"),
    [
        ("r = apply(R, p)", "r = add(apply(R, p), (1e-6, 0.0, 0.0))", {"loop_pos", "F"}),
        ("dq_n = -dot(V, x_n) / L", "dq_n = -1.000001 * dot(V, x_n) / L", {"loop_vel", "F"}),
        ("u=(dot(A, z_n) - 2.0", "u=(dot(A, z_n) - 1.999999", {"loop_acc", "F"}),
    ],
    ids=["position", "rate", "acceleration"],
)
def test_a_mistake_in_the_shared_kinematics_is_caught_by_the_engines_own_loops(
    old: str, new: str, quantities: set[str], engine_name: str, tmp_path: Path
) -> None:
    """The joint coordinates come from the formulas: a mistake there reaches every engine, and none of them closes."""
    status, output = run_with_formulas(tmp_path, old, new, "analytic", engine_name)
    assert status == 1, output
    assert failed(output)[engine_name] >= quantities
    assert "F" in failed(output)["analytic"]
    assert "reference" not in failed(output)
