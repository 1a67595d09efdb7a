"""What the README says is true: its Python runs, its links lead somewhere, its table is the one that comes out."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

from stewart_crosscheck.crosscheck.compare import expected
from stewart_crosscheck.crosscheck.engine import engine_names, load_engine
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


def test_the_verdict_table_has_every_engine_and_quantity(hexapod: Scene) -> None:
    heads = next(line for line in README.splitlines() if line.startswith("┃"))
    shown = [cell.split()[0] for cell in heads.split("┃") if cell.strip()]
    assert shown == engine_names()
    rows = {line.split("│")[1].strip(): line.split("│")[3:-1] for line in README.splitlines() if line.startswith("│")}
    for name, column in zip(shown, zip(*rows.values(), strict=True), strict=True):
        filled = {quantity for quantity, cell in zip(rows, column, strict=True) if cell.strip()}
        assert filled == set(expected(hexapod, load_engine(name)))
        assert all(float(cell) < 1e-13 for cell in column if cell.strip())


def test_the_numbers_of_the_verdict_table_come_out(hexapod: Scene) -> None:
    """Within a factor of four: rounding differs between machines and versions, and by no more."""
    heads = next(line for line in README.splitlines() if line.startswith("┃"))
    names = [cell.split()[0] for cell in heads.split("┃") if cell.strip()]
    rows = run(hexapod, from_scene(hexapod)).agreement.set_index(["quantity", "engine"])["max_rel"]
    for line in README.splitlines():
        if line.startswith("│"):
            quantity, _, *cells = (cell.strip() for cell in line.split("│")[1:-1])
            for name, cell in zip(names, cells, strict=True):
                if cell:
                    assert 0.25 < float(cell) / rows[quantity, name] < 4.0, (quantity, name)
