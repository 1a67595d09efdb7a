"""Ten thousand broken scene files, some hundred broken trajectories: one clear message each, or a load that works."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Iterator
from importlib import resources
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from mutations import broken, mutated

from stewart_crosscheck.crosscheck import cli, trajectory_csv
from stewart_crosscheck.crosscheck.trajectory import Trajectory, TrajectoryError, from_file, from_scene
from stewart_crosscheck.crosscheck.trajectory_csv import POSE, RATES
from stewart_crosscheck.models import Scene, SceneError, load_scene, scene_names
from stewart_crosscheck.models.reading import printable

SCENES = [(resources.files("stewart_crosscheck.models") / "scenes" / f"{n}.toml").read_text() for n in scene_names()]
HEXAPOD = SCENES[scene_names().index("hexapod")]
LONGEST, MOST_LINES = 400, 11
"""Characters of a line beside the file's name, and lines, of a message."""
HANGS = 60
"""Seconds of one file, some ten thousand times what it takes."""


AT_A_TIME = 10
"""Files of one example: to begin one takes as long as to make a file."""


def many(files: int, strategy: st.SearchStrategy[bytes], check: Callable[[bytes], None]) -> None:
    """Check so many files, always the same ones, one of which may not take long."""

    @settings(
        max_examples=files // AT_A_TIME, deadline=None, derandomize=True, database=None, phases=(Phase.generate,),
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
    )  # fmt: skip
    @given(drawn=st.lists(strategy, min_size=AT_A_TIME, max_size=AT_A_TIME))
    def every(drawn: list[bytes]) -> None:
        for data in drawn:
            signal.alarm(HANGS)
            check(data)

    every()


@pytest.fixture
def memory() -> Iterator[Path]:
    """A file that lies in memory: ten thousand times a disk takes longer than all the rest."""
    descriptor = os.memfd_create("broken.toml")
    yield Path(f"/proc/self/fd/{descriptor}")
    os.close(descriptor)


@pytest.fixture(autouse=True)
def alarm() -> Iterator[None]:
    """Whoever takes too long is told from who works."""

    def hang(number: int, frame: object) -> None:
        raise AssertionError(f"no answer within {HANGS} s")

    before = signal.signal(signal.SIGALRM, hang)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


def require_message(path: Path, error: Exception) -> str:
    """A message whose lines name the file and the field, and which a terminal may be shown."""
    lines = str(error).split("\n")
    assert len(lines) <= MOST_LINES
    for line in lines:
        assert line.startswith(f"{printable(path)}: ")
        rest = line.removeprefix(f"{printable(path)}: ")
        assert len(rest) <= LONGEST
        assert rest.isprintable()
        assert any(word in rest for word in ("expected", "is needed"))
        assert (
            ": " in rest or rest.startswith(("got ", "platform.pins has", "forces.legs has")) or "fields more" in rest
        )
    return str(error)


def load(path: Path, data: bytes) -> Scene | None:
    path.write_bytes(data)
    try:
        return load_scene(path)
    except SceneError as e:
        require_message(path, e)
    return None


@pytest.mark.parametrize(
    ("strategy", "files"), [(mutated(SCENES), 6000), (broken(SCENES), 4000)], ids=["words", "bytes"]
)
def test_a_broken_scene_file_is_one_clear_message(
    strategy: st.SearchStrategy[bytes], files: int, memory: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    outcomes: list[bool] = []
    many(files, strategy, lambda data: outcomes.append(load(memory, data) is not None))
    assert len(outcomes) >= files
    assert 0.05 < np.mean(outcomes) < 0.5  # both happen
    assert not list(tmp_path.iterdir())


def rows(trajectory: Trajectory) -> str:
    """A trajectory file."""
    parts = [getattr(trajectory, name) for name in ("position", "quaternion", "velocity", "angular_velocity")]
    table = np.column_stack([trajectory.t, *parts, trajectory.acceleration, trajectory.angular_acceleration])
    return "\n".join([",".join((*POSE, *RATES)), *(",".join(map(repr, row)) for row in table.tolist())]) + "\n"


@pytest.mark.parametrize("make", [mutated, broken])
def test_a_broken_trajectory_file_is_one_clear_message(
    make: Callable[[list[str]], st.SearchStrategy[bytes]], memory: Path, hexapod: Scene
) -> None:
    outcomes: list[bool] = []

    def check(data: bytes) -> None:
        memory.write_bytes(data)
        try:
            from_file(hexapod, memory)
        except TrajectoryError as e:
            message = str(e)
            assert message.startswith(f"{memory}")
            assert message.isprintable()
            assert len(message) < 800
            assert any(word in message for word in ("expected", "singular pose"))
        outcomes.append(True)

    text = rows(from_scene(hexapod, 8))
    poses = "\n".join(",".join(line.split(",")[: len(POSE)]) for line in text.splitlines())
    many(400, make([text, poses]), check)
    assert len(outcomes) >= 400


# --- What would take hours, or all of the memory ----------------------------------------------------------------------

MB = 1_000_000


def inside(old: str, new: str) -> str:
    """The hexapod's file with a part replaced."""
    assert old in HEXAPOD
    return HEXAPOD.replace(old, new, 1)


HUGE = {
    "a key of half a million parts": ("a." * (MB // 2 - 10) + "a = 1", "a key of more than 8 parts"),
    "the same with spaces": ("a" + " . a" * (MB // 4 - 10) + "=1", "a key of more than 8 parts"),
    "the same of quoted parts": ('"a".' * (MB // 4 - 10) + "a = 1", "a key of more than 8 parts"),
    "a header of parts": ("[" + "a." * (MB // 2 - 10) + "a]", "a key of more than 8 parts"),
    "unknown keys": ("".join(f"k{i}=1\n" for i in range(MB // 10)), "fields more are not as expected"),
    "a string without end": ('a = "' + "x" * (MB - 10), "Unterminated string"),
    "quotes": ('"' * (MB - 10), "got no TOML"),
    "brackets": ("a=" + "[" * (MB - 10), "brackets too deep"),
    "an integer": ("schema = 0x" + "f" * (MB - 20), "schema: got a value too long to be shown, expected 1"),
    "an integer for a mass": (inside("27.3", "0x" + "f" * 9999), "platform.mass: got a value too long to be shown"),
    "tables in a name": (inside('"hexapod"', "[{ a.a = " * 99 + "1" + " }]" * 99), "name: got "),
    "pins": (
        inside("    [0.947, 0.061, 0.683],\n", "[0.947, 0.061, 0.683],\n" * 40_000),
        "got 40005 entries, expected at",
    ),
    "pins of text": (inside("    [0.947, 0.061, 0.683],\n", '["a"],' * 20_000), "hull.pins[0][0]: got 'a'"),
    "terms": (
        inside("[0.052, 3.7, 0.4]", "[1.0, 1.0, 1.0]," * 50_000),
        "terms: got 50000 entries, expected at most 1000",
    ),
    "a key that is long": (inside("mass = 27.3", "m" * 900_000 + " = 27.3"), "...: unknown key"),
    "more than fits": (HEXAPOD + "#" * MB, "got more than 1 MB, expected a readable TOML file"),
}


@pytest.mark.parametrize("name", HUGE)
def test_a_huge_file_is_refused_at_once(name: str, tmp_path: Path) -> None:
    text, got = HUGE[name]
    path = tmp_path / "huge.toml"
    path.write_text(text)
    signal.alarm(HANGS)
    with pytest.raises(SceneError) as e:
        load_scene(path)
    assert got in require_message(path, e.value)


def test_keys_of_a_scene_and_dots_elsewhere_are_no_long_keys(tmp_path: Path) -> None:
    dots = "a.b.c.d.e.f.g.h.i.j.k.l"
    text = f"# {dots}\n" + inside("[leg]\n", f"[leg] # '{dots}\n")
    assert load(tmp_path / "dots.toml", text.encode()) is not None


@pytest.mark.parametrize("load_it", [load_scene, lambda path: from_file(load_scene("hexapod"), path)])
def test_a_device_without_end_is_refused(load_it: Callable[[Path], object]) -> None:
    signal.alarm(HANGS)
    with pytest.raises((SceneError, TrajectoryError), match="expected"):
        load_it(Path("/dev/zero"))


def test_a_trajectory_has_an_end(hexapod: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trajectory_csv, "MOST_ROWS", 7)
    text = rows(from_scene(hexapod, 8))
    (tmp_path / "long.csv").write_text(text)
    with pytest.raises(TrajectoryError, match=r"long.csv: got more than 7 rows, expected fewer$"):
        from_file(hexapod, tmp_path / "long.csv")
    (tmp_path / "short.csv").write_text("\n".join(text.split("\n")[:8]))
    assert len(from_file(hexapod, tmp_path / "short.csv").t) == 7


# --- The command ------------------------------------------------------------------------------------------------------


@pytest.fixture
def command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture) -> Callable:
    """The command in this process, in an empty folder: status, stdout, stderr."""
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")

    def call(*args: str) -> tuple[object, str, str]:
        monkeypatch.setattr(sys, "argv", ["crosscheck", *args])
        with pytest.raises(SystemExit) as e:
            cli.main()
        return e.value.code, *capfd.readouterr()

    return call


BAD = {
    "escape in a key": inside("mass = 27.3", '"\\u001b[2J" = 1'),
    "line in a key": inside("mass = 27.3", '"a\\nb" = 1'),
    "right to left": inside("mass = 27.3", '"\\u202e" = 1'),
    "escape in a name": inside('"hexapod"', '"\\u001b[31mred"'),
    "markup in a name": inside('"hexapod"', '"[red]x[/]"'),
    "path in a name": inside('"hexapod"', '"../x"'),
    "absolute path in a name": inside('"hexapod"', '"/etc/passwd"'),
    "HTML in a name": inside('"hexapod"', '"<b>bold</b>"'),
    "empty name": inside('"hexapod"', '""'),
    "65 characters": inside('"hexapod"', '"' + "x" * 65 + '"'),
    "line after a name": inside('"hexapod"', '"hexapod\\n"'),
    "null in a name": inside('"hexapod"', '"hexa\\u0000pod"'),
    "escape in the file": HEXAPOD + "\x1b[2J",
    "null in the file": HEXAPOD + "\x00",
    "not a number": inside("27.3", "nan"),
    "endless": inside("27.3", "inf"),
    "long": inside("27.3", '"' + "x" * 10_000 + '"'),
    "deep": inside("27.3", "[" * 200 + "]" * 200),
    "five legs": inside("    [0.947, 0.061, 0.683],\n", ""),
}


@pytest.mark.parametrize("sub", ["run", "simulate", "models", "bench"])
@pytest.mark.parametrize("name", BAD)
def test_the_command_refuses_it_in_few_clean_lines(command: Callable, name: str, sub: str) -> None:
    Path("../bad.toml").write_text(BAD[name])
    status, out, err = command(sub, "../bad.toml", "--out", "new/out")
    assert (status, out) == (2, "")
    lines = err.splitlines()
    assert 1 <= len(lines) <= 3
    assert lines[0].startswith("crosscheck: ../bad.toml: ")
    assert all(line.isprintable() and len(line) < LONGEST for line in lines)
    assert not list(Path().iterdir())


NAMES = [
    "<script>alert(1)<script>.toml", "<b>.toml", "[red]x.toml", "a b.toml", "-rf.toml", ";rm -rf $HOME.toml",
    "a\nb.toml", "\x1b[31m.toml", "\u202etoml.toml", "na\u00efve \u0438\u043c\u044f.toml", "%s{0}.toml", "a\udcff.toml",
    "=1+1,x.toml",
]  # fmt: skip


@pytest.mark.parametrize("file", NAMES)
def test_a_file_may_bear_any_name(command: Callable, file: str) -> None:
    """What is no visible character is spelled out; a name that begins with a dash wants a folder before it."""
    Path(file).write_text(inside("27.3", "-27.3"))
    status, out, err = command("run", f"./{file}", "--engine", "analytic", "--samples", "1", "--out", "out")
    assert (status, out) == (2, "")
    assert err == f"crosscheck: {printable('./' + file)}: platform.mass: got -27.3, expected greater than 0\n"
    Path(file).write_text(HEXAPOD)
    scene = load_scene(f"./{file}")
    assert scene.source == printable(f"./{file}")
    assert scene.source.isprintable()
    assert [entry.name for entry in Path().iterdir()] == [file]


def test_a_run_of_a_file_with_a_wild_name(command: Callable) -> None:
    file = '<b>\x1b[31m[red]a\nb,".toml'
    Path(file).write_text(HEXAPOD)
    status, out, err = command("run", file, "--engine", "analytic", "--samples", "1", "--out", "o\x1b[1mut")
    assert status == 0
    assert '<b>\\x1b[31m[red]a\\nb,".toml: motion, 1 samples' in out.replace("\n", "")
    assert "\x1b[31m" not in out + err
    assert "results: o\\x1b[1mut" in out
    agreement = pd.read_csv(Path("o\x1b[1mut") / "agreement.csv")
    assert set(agreement["trajectory"]) == {'<b>\\x1b[31m[red]a\\nb,".toml: motion'}


def test_a_simulation_that_would_not_end_is_refused(command: Callable) -> None:
    Path("../long.toml").write_text(inside("duration = 2.0", "duration = 1e9"))
    status, _, err = command("simulate", "../long.toml")
    assert status == 2
    assert err.startswith("crosscheck: ../long.toml: motion.duration: got 1e+09 s, expected at most 3600 s")
    assert not list(Path().iterdir())
