"""The command `compare`, and what a night becomes for people and for build systems."""

from __future__ import annotations

import io
import os
import re
import subprocess
import sysconfig
from math import nan
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from junitparser import Error, Failure, JUnitXml, Skipped
from markdown_it import MarkdownIt
from nights import VERSIONS, check, night, times, write
from rich.console import Console

from stewart_crosscheck.crosscheck.cli_compare import compare as command
from stewart_crosscheck.reports import (
    FINDING_COLUMNS,
    HistoryError,
    Night,
    OutputError,
    compare,
    earlier,
    junit,
    load_night,
    print_regressions,
    summary,
    write_baseline,
)
from stewart_crosscheck.reports.history import printable
from stewart_crosscheck.reports.summary import MOST, code, markdown

CROSSCHECK = Path(sysconfig.get_path("scripts")) / "crosscheck"
HOSTILE = [
    "<script>alert(1)</script>", "a | b || c", "two\nlines\r\nand\tmore", "\x00\x07\x1b[31mred\x1b[0m",
    "`code` ``two``", "../../etc/passwd", "[link](javascript:alert(1))", "![x](y)", "&lt; &amp;", "]]>", "# title",
    "*b* __b__ ~~b~~", "[red]bold[/]", "\ud800\udfff\ufffe", "\\", "|", "`", '"quoted", with commas', "=1+1", "é → ∞",
]  # fmt: skip


def printed(before: Night, after: Night, *rest: Any) -> str:
    screen = Console(file=io.StringIO(), width=140, color_system=None)
    print_regressions(before, after, compare(before, after), screen, *rest)
    assert isinstance(screen.file, io.StringIO)
    return screen.file.getvalue()


def tables(text: str) -> list[list[list[str]]]:
    """Cells of the tables of Markdown, as a reader sees them."""
    found: list[list[list[str]]] = []
    for token in MarkdownIt("commonmark", {"html": True}).enable(["table", "strikethrough"]).parse(text):
        if token.type == "table_open":
            found.append([])
        elif token.type == "tr_open":
            found[-1].append([])
        elif token.type == "inline" and found and token.level > 3:
            assert {child.type for child in token.children or ()} <= {"text", "text_special", "code_inline"}, (
                token.content
            )
            found[-1][-1].append("".join(child.content for child in token.children or ()))
    return found


# --- The command --------------------------------------------------------------------------------------------------


def test_compare_writes_what_it_found(tmp_path: Path) -> None:
    history = tmp_path / "runs"
    a = write(history, 0, check(), check(engine="dart"))
    row = check(error=3e-11, engine_version="4.1.0")
    newer = VERSIONS | {"mujoco": "4.1.0"}
    write(history, 1, row, check(engine="dart"), versions=newer)
    b = write(history, 2, row, check(engine="dart"), versions=newer)
    (history / "20261101T050000Z-nightly-dead").mkdir()
    done = subprocess.run(
        [CROSSCHECK, "compare", a, b, "--out", tmp_path / "out"], capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 1, done.stderr
    assert {p.name for p in (tmp_path / "out").iterdir()} == {"regressions.csv", "junit.xml", "summary.md", "run.json"}
    table = pd.read_csv(tmp_path / "out" / "regressions.csv", keep_default_na=False)
    assert list(table.columns) == FINDING_COLUMNS
    first = table.iloc[0]
    assert (first["severity"], first["what"], first["ratio"]) == ("fail", "error worse", "30")
    assert first["since"] == "20261102T030000Z-nightly-0001"
    assert first["suspect"] == "mujoco 4.0.0 → 4.1.0"
    text = (tmp_path / "out" / "summary.md").read_text()
    for words in (
        "RED: error worse 1; warnings 0; checks 2; against 20261101T030000Z-nightly-0000",
        "30 times the error before",
        "crosscheck run hexapod --engine mujoco",
        "20261101T050000Z-nightly-dead: run.json: No such file or directory, expected a file of a finished night",
    ):
        assert words in done.stdout
        assert words in text
    assert JUnitXml.fromfile(str(tmp_path / "out" / "junit.xml")).failures == 1


@pytest.mark.parametrize(
    ("row", "expected"),
    [
        (check(), 0),
        (check(error=5e-12), 0),
        (check(error=5e-11), 1),
        (check(verdict="fail"), 1),
        (check(verdict="error"), 3),
    ],
)
def test_the_status_of_compare(tmp_path: Path, row: dict[str, Any], expected: int) -> None:
    a, b = write(tmp_path, 0, check()), write(tmp_path, 1, row)
    assert command(a, b, tmp_path / "out") == expected


def test_compare_takes_the_baseline(tmp_path: Path) -> None:
    write_baseline(tmp_path / "baseline", night(0, check()))
    b = write(tmp_path / "runs", 1, check(error=1e-10))
    assert command(tmp_path / "baseline", b, tmp_path / "out") == 1


def test_a_run_compared_with_itself_proves_nothing(tmp_path: Path) -> None:
    a = write(tmp_path, 0, check())
    write_baseline(tmp_path / "baseline", load_night(a))
    (tmp_path / "link").symlink_to(a)
    for other in (a, tmp_path / "link", tmp_path / "baseline"):
        with pytest.raises(HistoryError, match=r"that of .*, expected another: a run compared with itself"):
            command(other, a, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_what_is_no_night_is_refused_with_status_2(tmp_path: Path) -> None:
    a = write(tmp_path, 0, check())
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "run.json").write_text('{"run_id": "a run of the hexapod"}')
    done = subprocess.run(
        [CROSSCHECK, "compare", a, tmp_path / "run", "--out", tmp_path / "out"],
        capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    assert done.returncode == 2
    assert done.stderr == (
        f"crosscheck: {tmp_path / 'run'}: run.json: kind: got None, expected 'nightly': a folder of a night\n"
    )
    assert not (tmp_path / "out").exists()
    with pytest.raises(HistoryError, match=r"run.json: No such file or directory, expected a file of a finished night"):
        command(tmp_path / "nowhere", a, tmp_path / "out")
    with pytest.raises(OutputError, match="expected one that does not exist or is empty"):
        command(a, a, a)


def test_nothing_is_changed_by_comparing(tmp_path: Path) -> None:
    a, b = write(tmp_path, 0, check()), write(tmp_path, 1, check(verdict="fail"))
    before = {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()}
    command(a, b, tmp_path / "out")
    assert {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file() and "out" not in p.parts} == before


# --- JUnit --------------------------------------------------------------------------------------------------------


def test_the_junit_file() -> None:
    after = night(
        1,
        check(),
        check(quantity="M_s", verdict="fail", error=3e-10, margin=3.0, reason="leg 2"),
        check(quantity="M_n", verdict="error", error=nan, margin=nan, reason="killed by signal 9"),
        check(unit="run-planar3", quantity="F", setting="soft", verdict="unsupported", reason="no such joint"),
        check(unit="run-planar3", quantity="a", error=5e-11),
        check(unit="run-planar3", quantity="b", verdict="silent"),
    )
    keys = after.checks[["unit", "quantity"]].to_dict("records")
    before = night(0, *(check(**{str(name): text for name, text in key.items()}) for key in keys))
    xml = JUnitXml.fromstring(junit(after, compare(before, after)))
    suites = {suite.name: {case.name: case for case in suite} for suite in xml}
    assert list(suites) == ["run-hexapod", "run-planar3", "regressions"]
    assert [len(cases) for cases in suites.values()] == [3, 3, 3]
    assert suites["run-hexapod"]["hexapod F"].result == []
    assert suites["run-hexapod"]["hexapod F"].classname == "run-hexapod.mujoco.kkt"
    (red,) = suites["run-hexapod"]["hexapod M_s"].result
    assert isinstance(red, Failure)
    assert (red.message, red.type) == ("fail: leg 2", "fail")
    assert "reproduce: crosscheck run hexapod --engine mujoco" in str(red.text).splitlines()
    (crash,) = suites["run-hexapod"]["hexapod M_n"].result
    assert isinstance(crash, Error)
    (skipped,) = suites["run-planar3"]["hexapod soft F"].result
    assert isinstance(skipped, Skipped)
    assert skipped.message == "unsupported: no such joint"
    assert suites["run-planar3"]["hexapod b"].result == []  # silent, and told as a regression
    worse = suites["regressions"]["hexapod b"].result[0]
    assert worse.message == "verdict worse: pass → silent"
    assert "since: this night" in str(worse.text).splitlines()
    assert "since: this night" in str(red.text).splitlines()  # what is red stands in its unit, and is counted once
    assert (xml.tests, xml.failures, xml.errors, xml.skipped) == (9, 4, 1, 1)


def test_a_good_night_has_no_failures() -> None:
    xml = JUnitXml.fromstring(junit(night(1, check()), compare(night(0, check()), night(1, check()))))
    assert (xml.tests, xml.failures, xml.errors) == (1, 0, 0)


# --- Hostile texts ------------------------------------------------------------------------------------------------


def hostile_nights() -> tuple[Night, Night]:
    """Every text of a row is hostile, one after the other."""
    names = (
        "unit",
        "scene",
        "engine",
        "engine_version",
        "route",
        "setting",
        "quantity",
        "reason",
        "where",
        "reproduce",
    )
    rows = [check(quantity=f"{k} {text}") for k, text in enumerate(HOSTILE)]
    worse = [row | {"verdict": "fail", "reason": text} for row, text in zip(rows, HOSTILE, strict=True)]
    for k, text in enumerate(HOSTILE):
        row = check(**{name: f"{text}{k}" for name in names})
        rows.append(row)
        worse.append(row | {"verdict": ("fail", "error", "unsupported")[k % 3]})
    facts: dict[str, Any] = {"versions": VERSIONS | {text: text for text in HOSTILE[:3]}}
    return night(0, *rows, times=times(1.0)), night(1, *worse, times=times(1.0, task="<b>|`"), **facts)


def test_hostile_texts_reach_junit_whole() -> None:
    before, after = hostile_nights()
    xml = JUnitXml.fromstring(junit(after, compare(before, after)))
    cases = [case for suite in xml for case in suite]
    messages = [case.result[0].message for case in cases if case.result]
    found = compare(before, after)
    others = (found["severity"] == "fail") & ~found["what"].isin(["fails", "did not run"])
    assert len(cases) == 2 * len(HOSTILE) + others.sum()
    for text in (
        "<script>alert(1)</script>",
        "a | b || c",
        "two\\nlines\\r\\nand\\tmore",
        "\\x1b[31mred",
        "]]>",
        "\\ud800",
    ):
        assert any(text in message for message in messages), text


def test_junit_survives_tables_that_were_never_written() -> None:
    """Control characters of tables in memory, which no file of ours holds."""
    before, after = night(0, check()), night(1, check(verdict="fail"))
    raw = after._replace(checks=after.checks.assign(reason="\x00\x1b\ud800", quantity="\x0b"))
    xml = JUnitXml.fromstring(junit(raw, compare(before, after)))
    assert "\\x00\\x1b\\ud800" in next(iter(next(iter(xml)))).result[0].message


def test_hostile_texts_do_not_leave_their_cell() -> None:
    before, after = hostile_nights()
    text = summary(before, after, compare(before, after), HOSTILE, HOSTILE)
    found = tables(text)
    assert len(found) == 5  # red, changed, new rows, history, units
    for table in found:
        assert {len(row) for row in table} == {len(table[0])}
    red = found[0]
    assert red[0][:3] == ["what", "rows", "worst row"]
    assert any("<script>alert(1)</script>" in cell for row in red for cell in row)
    assert any(row[-1] == "a | b || c1" for row in red)
    assert [row[0] for row in found[3][1:]][:2] == ["<script>alert(1)</script>", "a | b || c"]
    html = MarkdownIt("commonmark", {"html": True}).enable("table").render(text)
    assert not re.search(r"<(script|img|b|a)\b", html)
    assert "\x1b" not in text
    screen = printed(before, after, HOSTILE, HOSTILE)
    assert "\x1b" not in screen
    assert "  [red]bold[/]\n" in screen  # markup of the terminal stays a text


@pytest.mark.parametrize("text", HOSTILE)
def test_every_escape_is_read_as_the_text(text: str) -> None:
    (table,) = tables(f"| a | b |\n| --- | --- |\n| {markdown(text)} | {code(text)} |\n")
    assert [cell.strip() for cell in table[1]] == [printable(text).strip()] * 2


def test_paths_in_names_lead_nowhere(tmp_path: Path) -> None:
    row = check(unit="../../x", scene="/etc/passwd", engine="..")
    a, b = write(tmp_path / "h", 0, row), write(tmp_path / "h", 1, row | {"error": 1e-10})
    assert command(a, b, tmp_path / "out") == 1
    assert sorted(os.listdir(tmp_path)) == ["h", "out"]


# --- What people read ---------------------------------------------------------------------------------------------


def test_one_crash_is_one_line_and_every_kind_is_seen() -> None:
    quantities = [f"q{k:03d}" for k in range(300)]
    before = night(0, *(check(quantity=q) for q in quantities), *(check(engine="dart", quantity=q) for q in quantities))
    crash = [check(quantity=q, verdict="error", error=nan, reason="killed by signal 9") for q in quantities]
    worse = [check(engine="dart", quantity=q, error=1e-11 * (2 + k)) for k, q in enumerate(quantities)]
    after = night(1, *crash, *worse)
    red = tables(summary(before, after, compare(before, after)))[0][1:]
    assert [row[:3] for row in red] == [
        ["error worse", "300", "run-hexapod hexapod dart kkt q299"],
        ["did not run", "300", "run-hexapod hexapod mujoco kkt q000"],
    ]
    assert red[0][3:5] == ["1e-12 → 3e-09", "0.01 → 30"]
    assert red[1][6:8] == ["nothing changed: not reproducible?", "killed by signal 9"]


def test_a_long_list_says_how_much_was_left_out() -> None:
    rows = [check(engine=f"engine {k}") for k in range(MOST + 12)]
    before, after = night(0, *rows), night(1, *(row | {"verdict": "fail"} for row in rows))
    assert len(tables(summary(before, after, compare(before, after)))[0]) == MOST + 1
    assert "\n12 more in regressions.csv\n" in summary(before, after, compare(before, after))
    assert "12 more in regressions.csv" in printed(before, after)


def test_the_same_words_in_the_summary_and_on_the_terminal() -> None:
    before = night(0, check(), check(quantity="gone"), check(quantity="b"), check(quantity="c"), times=times(1.0))
    rows = [check(verdict="fail", error=1e-9), check(quantity="b", error=3e-12), check(quantity="c", error=1e-14)]
    after = night(1, *rows, check(quantity="new"), times=times(2.0), versions=VERSIONS | {"numpy": "2.5.0"})
    text, screen = (
        summary(before, after, compare(before, after), ["a bad entry"], ["a note"]),
        printed(before, after, ["a bad entry"], ["a note"]),
    )
    cells = {cell for table in tables(text) for row in table[1:] for cell in row if cell}
    for cell in cells:
        assert cell in screen, cell
    assert "RED: fails 1, gone 1; warnings 2; checks 4; against" in screen
    assert [row[0] for row in tables(text)[-1]] == ["unit", "run-hexapod", "bench-1"]
    assert tables(text)[-1][1] == ["run-hexapod", "3 pass, 1 fail", "", "1.5", "1"]
    for words in ("better: 1 rows", "a note", "a bad entry", "numpy", "too few repetitions"):
        assert words in text
        assert words in screen


def test_a_green_night_says_so() -> None:
    before, after = night(0, check()), night(1, check())
    text = summary(before, after, compare(before, after))
    assert text.splitlines()[2].startswith("**green: nothing worse; warnings 0; checks 1; against ")
    incomplete = night(1, check(verdict="error", reason="late"))
    assert "**INCOMPLETE: did not run 1;" in summary(before, incomplete, compare(before, incomplete))


def test_a_first_night_has_nothing_to_be_compared_with() -> None:
    after = night(0, check(), check(verdict="fail", quantity="M_s"))
    before = after._replace(checks=after.checks.iloc[:0], times=after.times.iloc[:0])
    text = summary(before, after, compare(before, after))
    assert "**RED: fails 1; warnings 1; checks 2; against nothing: no night was accepted before**" in text


def test_unreadable_entries_of_a_real_history_are_told(tmp_path: Path) -> None:
    a, b = write(tmp_path, 0, check()), write(tmp_path, 1, check())
    (a / "checks.csv").write_text("")
    past, unreadable = earlier(tmp_path, load_night(b).info["started"])
    assert not past
    text = summary(night(0, check()), load_night(b), compare(night(0, check()), load_night(b), past), unreadable)
    assert "## Not read from the history" in text
    assert "checks.csv: got 0 bytes that differ from what was written" in text
