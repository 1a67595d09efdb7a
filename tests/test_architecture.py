"""The rules of the structure, read from the code's own imports."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PARTS = ("analytic", "models", "crosscheck", "reports")
ALLOWED = {
    "analytic": {"analytic"},
    "models": {"models", "analytic"},
    "crosscheck": set(PARTS),
    "reports": {"reports"},
}
MAY_IMPORT_FORMULAS = {
    "crosscheck/engines/analytic_.py",
    "crosscheck/trajectory.py",
    "crosscheck/benches/analytic_.py",  # times the formulas themselves
    "crosscheck/audit.py",  # puts the formulas' own table beside certified truth
    "crosscheck/power_terms.py",  # these plant faults in the formulas
    "crosscheck/power_faults.py",
    "crosscheck/power_mistakes.py",
}
NO_FORMULAS = {"analytic.integrate", "analytic.solve", "analytic.compiler"}
"""Time integration of any y' = f(t, y), linear systems with their condition, any C source: they know no mechanism."""


def imports(path: Path, root: Path = ROOT) -> set[str]:
    """Modules of the project that a file imports, as `part.module`, also inside functions and for types alone."""
    package = path.relative_to(root).with_suffix("").parts[:-1]
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom):
            base = list(package[: len(package) - node.level + 1]) if node.level else []
            module = [*base, *(node.module.split(".") if node.module else [])]
            found |= {".".join([*module, alias.name]) for alias in node.names} | {".".join(module)}
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
    found = {name.removeprefix("stewart_crosscheck.") for name in found}
    return {name for name in found if name.split(".")[0] in PARTS}


def sources() -> list[Path]:
    return [p for part in PARTS for p in sorted((ROOT / part).rglob("*.py"))]


@pytest.mark.parametrize("path", sources(), ids=lambda p: str(p.relative_to(ROOT)))
def test_imports_go_one_way(path: Path) -> None:
    name = path.relative_to(ROOT).as_posix()
    used = imports(path)
    assert {u.split(".")[0] for u in used} <= ALLOWED[name.split("/")[0]]
    formulas = {u for u in used if u.startswith("analytic") and not any(u.startswith(n) for n in NO_FORMULAS)}
    if name.startswith("crosscheck") and name not in MAY_IMPORT_FORMULAS:
        assert not formulas, "only the analytic engine and its sweep, the trajectory, the audit and planted faults may"
    if name in ("crosscheck/engines/reference_.py", "crosscheck/newton_euler.py", "crosscheck/balls.py"):
        assert not {u for u in used if "trajectory" in u}, "the reference does its own kinematics"


def test_the_reader_of_imports_sees_every_form(tmp_path: Path) -> None:
    file = tmp_path / "crosscheck" / "engines" / "x_.py"
    file.parent.mkdir(parents=True)
    file.write_text(
        "import numpy\nimport stewart_crosscheck.reports\nfrom stewart_crosscheck.analytic import stewart\n"
        "def f():\n    from ... import analytic\n    from ..trajectory import Trajectory\n"
    )
    assert imports(file, tmp_path) >= {"reports", "analytic.stewart", "analytic", "crosscheck.trajectory.Trajectory"}


def test_every_module_of_moderate_length() -> None:
    """Only the formulas may be long."""
    long = {p.name: n for p in sources() if (n := len(p.read_text().splitlines())) > 300}
    assert set(long) <= {"stewart.py"}


def test_formulas_use_nothing_but_arithmetic() -> None:
    """One text for floats, arrays and balls: no module of mathematics is imported by the formulas."""
    tree = ast.parse((ROOT / "analytic" / "stewart.py").read_text())
    modules = {a.name for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names}
    modules |= {n.module for n in ast.walk(tree) if isinstance(n, ast.ImportFrom) and n.module}
    assert modules == {"__future__", "collections.abc", "dataclasses", "typing"}


def test_reactions_of_every_adapter_pass_through_wrench() -> None:
    """The wrenches that a method `assemble` returns are those of a converter of `wrench`, called on raw numbers."""
    for name in ("mujoco", "pinocchio", "dart"):
        tree = ast.parse((ROOT / "crosscheck" / "engines" / f"{name}_.py").read_text())
        method = next(n for n in ast.walk(tree) if isinstance(n, ast.FunctionDef) and n.name == "assemble")
        returned = [n.value for n in ast.walk(method) if isinstance(n, ast.Return)]
        wrenches = [ast.unparse(r.args[2]) for r in returned if isinstance(r, ast.Call) and len(r.args) > 2]
        assert len(returned) == 2
        assert len(wrenches) == 1
        assert wrenches[0].startswith(f"wrench.from_{name}(")
