"""The compiled back end without a clock: compilers that are missing or fail, what is kept, what is damaged."""

from __future__ import annotations

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import parameters

from stewart_crosscheck import analytic
from stewart_crosscheck.analytic import NoCompiler, c_code, compiler
from stewart_crosscheck.analytic.compiled import Compiled
from stewart_crosscheck.analytic.evaluate import DRIVING_FORCES
from stewart_crosscheck.analytic.traced import traced
from stewart_crosscheck.crosscheck.trajectory import Trajectory
from stewart_crosscheck.models import Scene

SOURCE = "double twice(double x) { return 2.0 * x; }\n"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty place for compiled code; what the compiler keeps for itself stays."""
    monkeypatch.setenv("ZIG_GLOBAL_CACHE_DIR", str(compiler._kept_folder() / "zig"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "stewart-crosscheck"


def script(path: Path, text: str) -> str:
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)
    return str(path)


def kept(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.so"))


def test_code_is_compiled_once_for_a_compiler(folder: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    compiler.library(SOURCE)
    (first,) = kept(folder)
    stamp = first.stat().st_mtime_ns
    compiler.library(SOURCE)
    assert first.stat().st_mtime_ns == stamp
    compiler.library(SOURCE.replace("2.0", "3.0"))
    assert len(kept(folder)) == 2
    real = " ".join(compiler.compiler())
    monkeypatch.setenv("CC", script(tmp_path / "another", f'exec {real} "$@"'))
    compiler.library(SOURCE)
    assert len(kept(folder)) == 3
    assert not [p for p in folder.iterdir() if p.name.startswith("tmp")]  # nothing is left behind


@pytest.mark.parametrize("length", [0, 100, 4096])
def test_damaged_code_is_compiled_again(length: int, folder: Path) -> None:
    """Loading it would end the process: it is not even tried, for it is not what was kept."""
    compiler.library(SOURCE)
    (one,) = kept(folder)
    size = one.stat().st_size
    one.replace(one.with_suffix(".old"))  # what is loaded stays as it is
    one.write_bytes(one.with_suffix(".old").read_bytes()[:length])
    assert compiler.library(SOURCE).twice
    assert abs(one.stat().st_size - size) < 100
    one.with_suffix(".sha256").unlink()
    assert compiler.library(SOURCE).twice
    assert one.with_suffix(".sha256").exists()


def test_two_at_once_do_no_harm(folder: Path) -> None:
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda _: compiler.library(SOURCE).twice, range(4)))
    assert len(found) == 4
    assert len(kept(folder)) == 1


def test_a_folder_that_can_not_be_written_to_is_done_without(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "file"
    file.write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(file))
    compiler.library(SOURCE)
    assert file.read_text() == ""


def test_without_a_compiler_the_message_says_what_helps(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setattr(compiler.importlib.util, "find_spec", lambda name: None)
    monkeypatch.setattr(compiler.shutil, "which", lambda name: None)
    with pytest.raises(NoCompiler, match=r"found no C compiler: .*pip install stewart-crosscheck\[fast\]"):
        compiler.library(SOURCE)
    monkeypatch.setattr(compiler.shutil, "which", lambda name: "/usr/bin/cc")
    assert compiler.compiler() == ["cc"]
    monkeypatch.undo()
    if not os.environ.get("CC"):
        assert compiler.compiler() == [sys.executable, "-m", "ziglang", "cc"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("echo what a pity >&2; exit 3", "failed: what a pity"),
        ("exit 0", "made no library"),
        ('while [ "$1" != -o ]; do shift; done; echo no library > "$2"', "can not be kept or loaded"),
    ],
)
def test_a_compiler_that_fails_is_named(
    text: str, message: str, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CC", script(tmp_path / "cc", text))
    with pytest.raises(NoCompiler, match=message):
        compiler.library(SOURCE)


def test_a_full_disk_and_a_folder_that_runs_nothing_are_done_without(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tried: list[Path] = []
    real = compiler._library

    def refusing(command: list[str], source: str, path: Path) -> Any:
        tried.append(path.parent)
        if path.parent == folder:
            raise OSError(28, "No space left on device")
        return real(command, source, path)

    monkeypatch.setattr(compiler, "_library", refusing)
    assert compiler.library(SOURCE).twice
    assert tried == [folder, compiler._passing_folder(os.getpid())]


def test_a_process_that_was_forked_leaves_the_passing_folder(tmp_path: Path) -> None:
    done = subprocess.run(
        [
            sys.executable,
            "-c",
            "import os, sys\n"
            "from stewart_crosscheck.analytic.compiler import _passing_folder\n"
            "folder = _passing_folder(os.getpid())\n"
            "if os.fork() == 0:\n    sys.exit(0)\n"
            "os.wait()\n"
            "print(folder.exists(), folder)\n",
        ],
        capture_output=True,
        text=True,
        check=True,
    )
    there, path = done.stdout.split()
    assert there == "True"
    assert not Path(path).exists()  # but it goes with the process that made it


def test_a_command_that_is_none_is_named(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", "gcc '")
    with pytest.raises(NoCompiler, match=r"CC: got \"gcc '\", expected a command: No closing quotation"):
        compiler.library(SOURCE)
    monkeypatch.setenv("CC", " ")
    assert compiler.compiler()[0] in (sys.executable, "cc")


def test_a_compiler_that_is_not_there_is_named(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", "/no/such/compiler")
    with pytest.raises(NoCompiler, match="/no/such/compiler can not be run: No such file"):
        compiler.library(SOURCE)


def test_a_wrong_operation_in_the_code_is_seen(
    hexapod: Scene, trajectory: Trajectory, monkeypatch: pytest.MonkeyPatch, folder: Path
) -> None:
    """What the tests of back ends compare is the compiled code and nothing else."""
    good = analytic.driving_forces(hexapod.parameters, trajectory.motion, "compiled")
    monkeypatch.setitem(c_code._EXPRESSIONS, "-", "{} + {}")
    wrong = np.zeros_like(good)
    Compiled(parameters(hexapod), DRIVING_FORCES).fill(trajectory.motion, wrong.T)
    assert np.abs(wrong - good).max() > 1.0


def test_machines_of_one_kind_share_their_code(hexapod: Scene) -> None:
    """Numbers are arguments: only what vanishes, or is equal, shapes the code."""
    P = parameters(hexapod)
    heavier = replace(P, m_p=2.0 * P.m_p)
    codes = {c_code.c_code(traced(Q, DRIVING_FORCES), range(6), DRIVING_FORCES.widths(Q)) for Q in (P, heavier)}
    assert len(codes) == 1
    assert traced(P, DRIVING_FORCES).parameters != traced(heavier, DRIVING_FORCES).parameters
