"""Measure the parts of `crosscheck run`, for docs/profile.md: `.venv/bin/python docs/profile.py`."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from time import perf_counter

from rich.console import Console

from stewart_crosscheck.crosscheck import compare
from stewart_crosscheck.crosscheck.engine import DynamicsResult, engine_names
from stewart_crosscheck.crosscheck.processes import Workers
from stewart_crosscheck.crosscheck.run import choose_engines, run
from stewart_crosscheck.crosscheck.trajectory import from_scene
from stewart_crosscheck.models import load_scene, write_models
from stewart_crosscheck.reports import print_verdict, write_run

TIMES = 5
CLI = "import stewart_crosscheck.crosscheck.cli"
ENGINE = """
from stewart_crosscheck.crosscheck import processes
from stewart_crosscheck.models import load_scene
processes.load_engine({!r})(load_scene("hexapod"))
"""


def best(task: Callable[[], object]) -> float:
    """Least seconds of some tries: what other programs take on top is not the project's."""
    seconds = []
    for _ in range(TIMES):
        start = perf_counter()
        task()
        seconds.append(perf_counter() - start)
    return min(seconds)


def command(*args: str) -> Callable[[], object]:
    """A fresh interpreter."""
    return lambda: subprocess.run([sys.executable, *args], check=True, capture_output=True)


def in_new_folder(task: Callable[[Path], object]) -> Callable[[], object]:
    """A task that writes a folder."""

    def call() -> None:
        with tempfile.TemporaryDirectory() as folder:
            task(Path(folder) / "run")

    return call


def started_and_ended() -> None:
    """A process that does nothing."""
    with Workers[str](["none"], 60.0) as workers:
        workers.start("none", "", int)
        list(workers.ended())


def parts() -> dict[str, float]:
    """Seconds by part."""
    crosscheck = ("-m", "stewart_crosscheck.crosscheck")
    scene = load_scene("hexapod")
    trajectory = from_scene(scene)
    report = run(scene, trajectory)
    engines, results = choose_engines([]), report.results
    found = {
        "crosscheck run": best(in_new_folder(lambda folder: command(*crosscheck, "run", "--out", str(folder))())),
        "crosscheck --help": best(command(*crosscheck, "--help")),
        "crosscheck scenes": best(command(*crosscheck, "scenes")),
        "interpreter": best(command("-c", "pass")),
        "interpreter and imports of the command": best(command("-c", CLI)),
        "scene, trajectory, model files": best(lambda: (from_scene(load_scene("hexapod")), write_models(scene))),
        "a process, started and ended": best(started_and_ended),
    }
    for name in engine_names():
        found[f"{name}: interpreter, imports, model"] = best(command("-c", ENGINE.format(name)))
    for (name, route), result in results.items():
        if isinstance(result, DynamicsResult):
            found[f"{name} {route}"] = result.seconds
    found |= {
        "import of pandas": best(command("-c", "import pandas")) - found["interpreter"],
        "comparison": best(lambda: compare.agreement("", scene, trajectory, engines, results)),
        "writing": best(
            in_new_folder(lambda folder: write_run(folder, report.agreement, report.samples(), report.info))
        ),
        "printing": best(lambda: print_verdict(report.agreement, Console(quiet=True))),
    }
    return found


if __name__ == "__main__":  # engines run in processes of their own
    for part, seconds in parts().items():
        print(f"| {part} | {seconds:.2f} |")
