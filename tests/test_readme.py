"""What the README says is true: its Python runs, its links lead somewhere, its table is the one that comes out."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

from stewart_crosscheck.crosscheck.compare import expected
from stewart_crosscheck.crosscheck.engine import engine_names, is_forward, load_engine
from stewart_crosscheck.crosscheck.run import run
from stewart_crosscheck.crosscheck.trajectory import from_scene
from stewart_crosscheck.models import Scene

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_python_of_the_readme_runs(tmp_path: Path) -> None:
    block = re.search(r"```python\n(.*?)```", README, re.DOTALL)
    assert block
    script = tmp_path / "example.py"
    script.write_text(block[1])
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, cwd=tmp_path, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("0 ")  # the status: all agree
    assert "fail" not in done.stdout


def test_links_lead_to_files() -> None:
    links = re.findall(r"\]\(([^)]+)\)", README)
    assert len(links) > 5
    for link in links:
        if not link.startswith("https://"):
            assert (ROOT / link).exists(), link


def verdict_tables() -> dict[tuple[str, str], dict[str, str]]:
    """Engine and route to quantity to what the cell says, of both tables; empty cells are left out."""
    found: dict[tuple[str, str], dict[str, str]] = {}
    names: list[str] = []
    keys: list[tuple[str, str]] = []
    for line in README.splitlines():
        cells = [cell.strip() for cell in re.split("[┃│]", line)[1:-1]]
        if line.startswith("┃") and cells[0] == "":
            names = [cell.split()[0] for cell in cells[2:]]
        elif line.startswith("┃"):
            keys = list(zip(names, cells[2:], strict=True))
            found |= {key: {} for key in keys}
        elif line.startswith("│"):
            for key, cell in zip(keys, cells[2:], strict=True):
                if cell:
                    found[key][cells[0]] = cell
    return found


def test_the_verdict_tables_have_every_engine_route_and_quantity(hexapod: Scene) -> None:
    shown = verdict_tables()
    engines = {name: load_engine(name) for name in engine_names()}
    inverse = [(name, e.route) for name, e in engines.items()]
    assert list(shown) == inverse + [(name, e.forward_route) for name, e in engines.items() if is_forward(e)]
    for (name, route), column in shown.items():
        assert list(column) == list(expected(hexapod, engines[name], route))
        for cell in column.values():
            error, _, allowed = cell.partition(" ≤ ")
            assert float(error) < (float(allowed) if allowed else 1e-13)


def test_the_numbers_of_the_verdict_tables_come_out(hexapod: Scene) -> None:
    """Within a factor of four: rounding differs between machines and versions, and by no more."""
    columns = ["engine", "route", "quantity", "max_rel", "tolerance"]
    agreement = run(hexapod, from_scene(hexapod)).agreement[columns]
    rows = {tuple(row[:3]): row[3:] for row in agreement.itertuples(index=False, name=None)}
    for key, column in verdict_tables().items():
        for quantity, cell in column.items():
            max_rel, tolerance = rows[*key, quantity]
            error, _, allowed = cell.partition(" ≤ ")
            assert 0.25 < float(error) / max_rel < 4.0, (key, quantity)
            if allowed:
                assert 0.25 < float(allowed) / tolerance < 4.0, (key, quantity)
