"""C source to a library that is loaded: compiled once for this machine, and kept.

The compiler is the one that ``CC`` names, else the package `ziglang` (the extra ``fast``), else ``cc``.
"""

from __future__ import annotations

import ctypes
import functools
import hashlib
import importlib.util
import os
import platform
import shlex
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from platformdirs import user_cache_path

FLAGS = ("-std=c11", "-O3", "-march=native", "-fno-math-errno", "-fno-trapping-math", "-ffp-contract=fast")
"""No option changes the value of an operation but for fused ones, which round once less."""


class NoCompiler(RuntimeError):
    """There is no C compiler, or it did not do its work: the message says what was tried and what helps."""


def compiler() -> list[str]:
    """Command of the C compiler. Raises NoCompiler."""
    if os.environ.get("CC"):
        return shlex.split(os.environ["CC"])
    if importlib.util.find_spec("ziglang"):
        return [sys.executable, "-m", "ziglang", "cc"]
    if shutil.which("cc"):
        return ["cc"]
    raise NoCompiler(
        "the back end `compiled` found no C compiler: expected one named by CC, the package ziglang"
        " (pip install stewart-crosscheck[fast]) or a command cc"
    )


def _processor() -> str:
    """What ``-march=native`` depends on."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    return "\n".join([platform.machine(), *(line for line in lines if line.startswith(("flags", "model name")))][:3])


def _folder() -> Path:
    """Where compiled code is kept; one that ends with this process if that can not be written to."""
    folder = user_cache_path("stewart-crosscheck")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except OSError:
        return Path(_passing_folder().name)


@functools.cache
def _passing_folder() -> tempfile.TemporaryDirectory:
    return tempfile.TemporaryDirectory(prefix="stewart-crosscheck-")


def library(source: str) -> ctypes.CDLL:
    """Compiled C source, from earlier times if there is one. Raises NoCompiler."""
    command = [*compiler(), *FLAGS, "-shared", "-fPIC"]
    key = hashlib.sha256("\0".join([source, *command, _processor()]).encode()).hexdigest()[:32]
    folder = _folder()
    kept = folder / f"{key}.so"
    try:
        return ctypes.CDLL(str(kept))
    except OSError:  # not there, or damaged
        _compile(command, source, kept)
    try:
        return ctypes.CDLL(str(kept))
    except OSError as e:
        raise NoCompiler(f"what the C compiler {shlex.join(command)} made can not be loaded: {e}") from None


def _compile(command: list[str], source: str, kept: Path) -> None:
    own = {name: str(kept.parent / "zig") for name in ("ZIG_GLOBAL_CACHE_DIR", "ZIG_LOCAL_CACHE_DIR")}
    with tempfile.TemporaryDirectory(dir=kept.parent) as name:  # renamed when whole: two at once do no harm
        text, made = Path(name, "formulas.c"), Path(name, "formulas.so")
        text.write_text(source)
        command = [*command, "-o", str(made), str(text), "-lm"]
        try:
            done = subprocess.run(command, env={**own, **os.environ}, capture_output=True, text=True, check=False)
        except OSError as e:
            raise NoCompiler(f"the C compiler {command[0]} can not be run: {e.strerror or e}") from None
        if done.returncode or not made.exists():
            said = (done.stderr or done.stdout).strip().splitlines()
            raise NoCompiler(f"the C compiler {shlex.join(command)} failed: {said[-1] if said else done.returncode}")
        made.replace(kept)
