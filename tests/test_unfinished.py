"""Nights under way: what is kept when they end early, and what becomes of them."""

from __future__ import annotations

import errno
import json
import os
import shutil
import subprocess
import sys
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from stewart_crosscheck.crosscheck import nightly as module
from stewart_crosscheck.crosscheck import unfinished
from stewart_crosscheck.crosscheck.nightly import begin, finish, work
from stewart_crosscheck.crosscheck.supervise import Outcome
from stewart_crosscheck.crosscheck.unfinished import Attempt, Plan, Record, ResumeError, Unfinished, hidden
from stewart_crosscheck.crosscheck.unit import Key, Unit, row
from stewart_crosscheck.reports import OutputError, load_night

PLAN = Plan(
    run_id="x", started=datetime(2026, 1, 1, tzinfo=UTC), units=["a", "b"], whole=False, baseline=Path("base"),
    versions={}, code={}, machine={},
)  # fmt: skip


ENDED = Record(attempts=[Attempt(how="ended", status=0, seconds=1.0, reason="", crashed=[])])


def some_units(*names: str) -> dict[str, Unit]:
    """Units of one row each, which need no engine."""
    key = Key("", "analytic", "closed_form", "", "F")
    return {
        name: Unit(name, ("scenes",), 60.0, lambda: [key], lambda folder: [row(key, 1e-15, 1e-13, 3e-15, "pass")])
        for name in names
    }


@pytest.fixture
def done(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Units whose command was run: it leaves an empty folder."""
    names: list[str] = []

    def attempt(unit: Unit, folder: Path) -> Record:
        names.append(unit.name)
        (folder / "1").mkdir()
        return ENDED

    monkeypatch.setattr(module, "attempt", attempt)
    return names


def a_night(final: Path, units: dict[str, Unit]) -> Unfinished:
    return begin(final, units, datetime(2026, 1, 1, tzinfo=UTC), "20260101T000000Z-nightly-0000", Path("base"))


def let_go(night: Unfinished) -> None:
    """As when its process ends."""
    os.close(night.lock)


def no_room(after: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """A disk that is full after so many records."""
    right, left = unfinished.write_whole, [after]

    def write_whole(path: Path, text: str) -> None:
        left[0] -= 1
        if left[0] < 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        right(path, text)

    monkeypatch.setattr(unfinished, "write_whole", write_whole)


def test_a_night_is_hidden_until_it_is_whole(tmp_path: Path, done: list[str]) -> None:
    units, final = some_units("a", "b"), tmp_path / "runs" / "night"
    night = a_night(final, units)
    work(night, units)
    assert [p.name for p in final.parent.iterdir()] == [".night.unfinished"]
    report = finish(night, units, None)
    assert [p.name for p in final.parent.iterdir()] == ["night"]
    assert report.status == 0
    found = load_night(final)
    assert found.info["units"]["a"]["attempts"] == 1
    assert found.checks["unit"].tolist() == done == ["a", "b"]


@pytest.mark.parametrize("here", [True, False])
def test_a_night_in_a_folder_that_is_empty(
    here: bool, tmp_path: Path, done: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """What somebody works in, or a mount, stays the folder that it is: it may be another file system."""
    final = tmp_path / "night"
    final.mkdir()
    inode = final.stat().st_ino
    if here:
        monkeypatch.chdir(final)
    finish(a_night(Path(".") if here else final, some_units("a")), some_units("a"), None)
    assert (final.stat().st_ino == inode) == here
    assert load_night(final).folder == final
    assert [p.name for p in tmp_path.iterdir()] == ["night"]


def test_a_night_is_on_the_disk_before_it_has_its_name(
    tmp_path: Path, done: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    synced: list[str] = []
    monkeypatch.setattr(unfinished, "sync", lambda path: synced.append(path.name))
    night = a_night(tmp_path / "night", some_units("a"))
    finish(night, some_units("a"), None)
    assert {"checks.csv", "times.csv", "run.json", "units", ".night.unfinished"} <= set(synced)
    assert synced.index(".night.unfinished") < len(synced) - 1
    assert synced[-1] == tmp_path.name, "the rename itself"


def test_a_folder_is_a_night_only_when_all_is_there(
    tmp_path: Path, done: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    right, moved = shutil.move, list[str]()
    monkeypatch.setattr(shutil, "move", lambda path, to: (moved.append(Path(path).name), right(path, to)))
    (tmp_path / "night").mkdir()
    monkeypatch.chdir(tmp_path / "night")
    finish(a_night(Path("."), some_units("a")), some_units("a"), None)
    assert len(moved) == 7
    assert moved[-1] == "run.json"


def test_a_night_under_a_name_that_is_a_link_or_goes_up(tmp_path: Path, done: list[str]) -> None:
    (tmp_path / "there").mkdir()
    (tmp_path / "link").symlink_to("there")
    finish(a_night(tmp_path / "link", some_units("a")), some_units("a"), None)
    assert (tmp_path / "link").is_symlink()
    assert load_night(tmp_path / "there").checks["unit"].tolist() == []
    finish(a_night(tmp_path / "none" / ".." / "night", some_units("a")), some_units("a"), None)
    assert load_night(tmp_path / "night")


def test_two_that_begin_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The second one finds the first one's folder, and leaves it alone."""
    right = unfinished.require_free

    def meanwhile(final: Path) -> None:
        right(final)
        monkeypatch.setattr(unfinished, "require_free", right)
        Unfinished.begin(final, PLAN)

    monkeypatch.setattr(unfinished, "require_free", meanwhile)
    with pytest.raises(OutputError, match=r"an unfinished night lies in .*; finish it with --resume, or remove it$"):
        Unfinished.begin(tmp_path / "night", PLAN)
    assert (hidden(tmp_path / "night") / "plan.json").exists()


def test_what_had_not_begun_is_passed_by(tmp_path: Path) -> None:
    let_go(Unfinished.begin(tmp_path / "1-night", PLAN))
    hidden(tmp_path / "2-night").mkdir()
    assert Unfinished.resume(None, tmp_path).final == tmp_path / "1-night"
    with pytest.raises(ResumeError, match=r"got no plan\.json; remove the folder and start anew$"):
        Unfinished.resume(tmp_path / "2-night", tmp_path)


def test_what_is_done_is_not_done_again(tmp_path: Path, done: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    units, lines = some_units("a", "b", "c"), list[str]()
    night = a_night(tmp_path / "night", units)
    with monkeypatch.context() as full:
        no_room(2, full)
        with pytest.raises(OutputError, match=r"units/c: No space left on device; what was done is kept: --resume "):
            work(night, units)
    let_go(night)
    again = module.resume(tmp_path / "night", tmp_path)
    work(again, units, done=lines.append)
    assert done == ["a", "b", "c", "c"]
    assert [line.endswith("(done before)") for line in lines] == [True, True, False]


def test_a_disk_that_is_full_for_a_unit_is_no_result_of_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def supervise(arguments: tuple[str, ...], log: Path, seconds: float, memory: int) -> Outcome:
        log.write_text(
            f"dart kkt done\ncrosscheck: --out {arguments[-1]}: No space left on device; nothing was written\n"
        )
        return Outcome("ended", 2, 1.0, "")

    monkeypatch.setattr(module, "supervise", supervise)
    night = a_night(tmp_path / "night", some_units("a"))
    with pytest.raises(OutputError, match=r"units/a: No space left on device; .*; what was done is kept: "):
        work(night, some_units("a"))
    assert night.records() == {}


def test_a_disk_that_is_full_in_the_evening(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    no_room(0, monkeypatch)
    with pytest.raises(OutputError, match=r"No space left on device; nothing was written$"):
        a_night(tmp_path / "night", some_units("a"))
    assert list(tmp_path.iterdir()) == []


def test_a_disk_that_is_full_in_the_morning(tmp_path: Path, done: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    units = some_units("a")
    night = a_night(tmp_path / "night", units)
    work(night, units)
    right = Path.write_text

    def write_text(path: Path, *args: Any, **kwargs: Any) -> int:
        if path.name == "junit.xml":
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return right(path, *args, **kwargs)

    with monkeypatch.context() as full:
        full.setattr(Path, "write_text", write_text)
        with pytest.raises(OutputError, match=r"No space left on device; what was done is kept there, and --resume "):
            finish(night, units, None)
    assert not (tmp_path / "night").exists()
    let_go(night)
    again = module.resume(None, tmp_path)
    work(again, units)
    assert finish(again, units, None).night.folder == tmp_path / "night"
    assert done == ["a"]
    assert load_night(tmp_path / "night").checks["verdict"].tolist() == ["pass"]


def test_a_folder_that_cannot_be_written_to() -> None:
    with pytest.raises(OutputError, match=r"^--out /proc/night: .*expected a folder that can be written to$"):
        a_night(Path("/proc/night"), some_units("a"))


def test_a_folder_that_was_filled_meanwhile(tmp_path: Path, done: list[str]) -> None:
    units = some_units("a")
    night = a_night(tmp_path / "night", units)
    work(night, units)
    (tmp_path / "night").mkdir()
    (tmp_path / "night" / "mine").write_text("keep")
    with pytest.raises(OutputError, match=r"got a folder that is not empty"):
        finish(night, units, None)
    assert [p.name for p in (tmp_path / "night").iterdir()] == ["mine"]
    assert night.records().keys() == {"a"}


def test_a_night_that_somebody_works_at_is_not_resumed(tmp_path: Path) -> None:
    first = Unfinished.begin(tmp_path / "1-night", PLAN)
    with pytest.raises(ResumeError, match=r"another process is at work there$"):
        Unfinished.resume(None, tmp_path)
    second = Unfinished.begin(tmp_path / "2-night", PLAN)
    let_go(first)
    assert Unfinished.resume(None, tmp_path).final == tmp_path / "1-night", "the newer one is under way"
    let_go(second)
    assert Unfinished.resume(None, tmp_path).final == tmp_path / "2-night"


def test_a_lock_ends_with_its_process(tmp_path: Path) -> None:
    script = (
        "import os; from pathlib import Path; from stewart_crosscheck.crosscheck.unfinished import Plan, Unfinished\n"
        f"plan = Plan.model_validate_json({PLAN.model_dump_json()!r})\n"
        f"night = Unfinished.begin(Path({str(tmp_path / 'night')!r}), plan)\n"
        "os.kill(os.getpid(), 9)"
    )
    assert subprocess.run([sys.executable, "-c", script], check=False).returncode == -9
    assert Unfinished.resume(None, tmp_path).plan == PLAN


def test_nothing_to_resume(tmp_path: Path) -> None:
    with pytest.raises(ResumeError, match=rf"^--resume: got no unfinished night in {tmp_path}$"):
        Unfinished.resume(None, tmp_path)
    with pytest.raises(ResumeError, match=r"^--resume: got no unfinished night for "):
        Unfinished.resume(tmp_path / "night", tmp_path)


@pytest.mark.parametrize("text", ["", "{", "[]", '{"units": 1}', "[" * 100_000])
def test_a_plan_that_cannot_be_read(text: str, tmp_path: Path) -> None:
    let_go(Unfinished.begin(tmp_path / "night", PLAN))
    (hidden(tmp_path / "night") / "plan.json").write_text(text)
    with pytest.raises(ResumeError, match=r"plan\.json: .*; remove the folder and start anew$"):
        Unfinished.resume(None, tmp_path)


def test_a_record_that_was_cut_is_none(tmp_path: Path) -> None:
    night = Unfinished.begin(tmp_path / "night", PLAN)
    for name in PLAN.units:
        night.unit(name).mkdir()
        night.record(name, ENDED)
    assert set(night.records()) == {"a", "b"}
    for text in ('{"attempts":', "{}", "[]", '{"attempts": []}'):
        (night.unit("a") / "unit.json").write_text(text)
        assert set(night.records()) == {"b"}, text


@pytest.mark.parametrize(("what", "name"), [("versions", "mujoco"), ("code", "sha256"), ("machine", "model")])
def test_a_night_has_one_set_of_versions(what: str, name: str, tmp_path: Path, done: list[str]) -> None:
    let_go(a_night(tmp_path / "night", some_units("a")))
    path = hidden(tmp_path / "night") / "plan.json"
    plan = json.loads(path.read_text())
    plan[what][name] = "3.0"
    path.write_text(json.dumps(plan))
    with pytest.raises(ResumeError, match=rf"{what}: {name}: got .*, expected '3.0' as in the evening: start a new"):
        module.resume(None, tmp_path)
