"""The command: exit statuses, messages, and result files as the contract has them."""

from __future__ import annotations

import hashlib
import importlib.util
import io
import json
import os
import re
import subprocess
import sys
import sysconfig
from collections.abc import Callable
from importlib import resources
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
import pytest
from conftest import ENGINES
from rich.console import Console

from stewart_crosscheck.crosscheck import cli
from stewart_crosscheck.crosscheck.engine import load_engine
from stewart_crosscheck.crosscheck.trajectory import POSE, RATES, from_scene
from stewart_crosscheck.models import Scene, scene_names, write_models
from stewart_crosscheck.reports import print_verdict

CROSSCHECK = Path(sysconfig.get_path("scripts")) / "crosscheck"
HEXAPOD = (resources.files("stewart_crosscheck.models") / "scenes" / "hexapod.toml").read_text(encoding="utf-8")
MISSING = [name for name, package in ENGINES.items() if importlib.util.find_spec(package) is None]

AGREEMENT_COLUMNS = [
    "run_id", "scene", "trajectory", "engine", "engine_version", "route", "setting", "quantity", "unit", "max_abs",
    "rms", "max_rel", "scale", "tolerance", "tolerance_name", "verdict", "us_per_sample",
]  # fmt: skip
SAMPLES_COLUMNS = ["engine", "route", "t", "leg", "quantity", "component", "value", "radius"]
QUANTITIES = ["F", "F_r", "F_s", "F_n", "F_o", "M_s", "M_n", "M_o"]
HULL = ["F_hull", "M_hull"]
CHECKS = ["loop_pos", "loop_vel", "loop_acc", "balance"]
NATIVE = ["a", "alpha"]
COMMANDS = [
    "run", "simulate", "bench", "stress", "nightly", "compare", "power", "audit", "models", "scenes", "engines",
]  # fmt: skip
ROUTES = {
    "analytic": ("closed_form",),
    "dart": ("kkt", "native"),
    "mujoco": ("kkt", "native"),
    "pinocchio": ("kkt", "native"),
    "reference": ("certified",),
}
EXTRA = {"kkt": CHECKS, "native": NATIVE}


ANSI = re.compile(r"\x1b\[[0-9;]*m")
"""Colours, which typer adds to its help where it sees GITHUB_ACTIONS."""


class Done(NamedTuple):
    """A command that has ended."""

    status: int
    out: str
    err: str


def crosscheck(cwd: Path, *args: str) -> Done:
    """The installed command, as a process."""
    done = subprocess.run([CROSSCHECK, *args], cwd=cwd, capture_output=True, text=True, timeout=120, check=False)
    return Done(done.returncode, done.stdout, done.stderr)


Command = Callable[..., Done]


@pytest.fixture
def command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture) -> Command:
    """The same in this process, in a folder of its own: a second less each, and a warning is an error."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("FORCE_COLOR", raising=False)  # a forced terminal is 80 wide and breaks tables

    def call(*args: str) -> Done:
        monkeypatch.setattr(sys, "argv", ["crosscheck", *args])
        with pytest.raises(SystemExit) as e:
            cli.main()
        assert isinstance(e.value.code, int)
        out, err = capfd.readouterr()
        return Done(e.value.code, ANSI.sub("", out), ANSI.sub("", err))

    return call


# --- A run ------------------------------------------------------------------------------------------------------------


class Run(NamedTuple):
    """A run's process and its files, numbers as text."""

    done: Done
    folder: Path
    agreement: pd.DataFrame
    samples: pd.DataFrame
    info: dict


def _read(done: Done, folder: Path) -> Run:
    agreement, samples = (
        pd.read_csv(folder / name, dtype=str, keep_default_na=False) for name in ("agreement.csv", "samples.csv")
    )
    return Run(done, folder, agreement, samples, json.loads((folder / "run.json").read_text(encoding="utf-8")))


@pytest.fixture(scope="module")
def full(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Every engine, three samples."""
    cwd = tmp_path_factory.mktemp("full")
    return _read(crosscheck(cwd, "run", "--samples", "3", "--out", "results"), cwd / "results")


@pytest.fixture(scope="module")
def one(tmp_path_factory: pytest.TempPathFactory, hexapod: Scene) -> Run:
    """One engine, a trajectory file of one row, the default folder."""
    cwd = tmp_path_factory.mktemp("one")
    trajectory = from_scene(hexapod, 21)
    row = [trajectory.t, *trajectory.position.T, *trajectory.quaternion.T, *trajectory.velocity.T]
    row += [*trajectory.angular_velocity.T, *trajectory.acceleration.T, *trajectory.angular_acceleration.T]
    text = ",".join((*POSE, *RATES)) + "\n" + ",".join(repr(float(x[7])) for x in row) + "\n"
    (cwd / "motion.csv").write_text(text)
    done = crosscheck(cwd, "run", "hexapod", "--engine", "analytic", "--trajectory", "motion.csv")
    (folder,) = (cwd / "runs").iterdir()
    return _read(done, folder)


def test_a_run_of_every_engine_agrees(full: Run) -> None:
    assert full.done.status == (3 if MISSING else 0), full.done.err
    assert ("not all agree" if MISSING else "all agree") in full.done.out
    assert "Traceback" not in full.done.out + full.done.err
    assert {entry.name for entry in full.folder.iterdir()} == {
        "agreement.csv",
        "margins.csv",
        "samples.csv",
        "run.json",
    }
    assert {entry.name for entry in full.folder.parent.iterdir()} == {"results"}


@pytest.mark.parametrize("nt", [1000, 1010])
def test_beyond_a_thousand_samples_numbers_are_those_of_the_truth_and_the_summary_says_so(
    nt: int, command: Command, tmp_path: Path
) -> None:
    done = command("run", "pointmass2", "--engine", "analytic", "--samples", str(nt), "--out", "out")
    assert done.status == 0
    truth = json.loads((tmp_path / "out" / "run.json").read_text())["truth"]
    said = (
        f"certified truth: {truth['samples']} of {nt} samples (seed {truth['seed']}), the worst conditioned among them;"
        " errors are taken there, and samples.csv holds these; gaps of the loops and balance are checked at all"
    )
    assert (said in " ".join(done.out.split())) == (nt > 1000)
    table = pd.read_csv(tmp_path / "out" / "samples.csv")
    times = table.groupby("engine")["t"].agg(lambda t: len(set(t))).to_dict()
    assert times == {"analytic": truth["samples"], "reference": truth["samples"]}
    assert 1000 <= truth["samples"] <= 1002
    same = table.pivot(index=["t", "leg", "quantity", "component"], columns="engine", values="value")
    assert not same.isna().any(axis=None)  # the same samples of both


def test_agreement_has_the_columns_of_the_contract_in_order(full: Run, one: Run) -> None:
    assert list(full.agreement.columns) == AGREEMENT_COLUMNS
    assert list(one.agreement.columns) == AGREEMENT_COLUMNS


def test_agreement_has_every_engine_and_quantity_and_no_other_row(full: Run) -> None:
    want = [
        (engine, route, q)
        for engine, routes in ROUTES.items()
        for route in routes
        for q in [*QUANTITIES[route == "native" :], *HULL, *EXTRA.get(route, [])]
    ]
    rows = full.agreement[["engine", "route", "quantity"]].itertuples(index=False, name=None)
    assert list(rows) == want
    assert len(want) == 62 + 3 * 11


def test_every_row_of_agreement_has_a_verdict_and_numbers(full: Run) -> None:
    for _, row in full.agreement.iterrows():
        assert row["verdict"] == ("error" if row["engine"] in MISSING else "pass")
        if row["verdict"] == "pass":
            numbers = row[["max_abs", "rms", "max_rel", "scale", "tolerance", "us_per_sample"]].astype(float)
            assert np.isfinite(numbers).all()
            assert 0 <= numbers["rms"] <= numbers["max_abs"]
            assert numbers["max_rel"] == numbers["max_abs"] / numbers["scale"]
            assert numbers["max_rel"] <= numbers["tolerance"]
            assert row["engine_version"]
            assert row["setting"]
            assert row["tolerance_name"]
    assert set(full.agreement["scene"]) == {"hexapod"}
    assert set(full.agreement["trajectory"]) == {"hexapod.toml: motion"}


def test_samples_have_the_columns_and_one_row_per_component(full: Run) -> None:
    assert list(full.samples.columns) == SAMPLES_COLUMNS
    scalars = [(q, "-") for q in ("F", "L", "dL", "power")]
    vectors = [(q, c) for q in QUANTITIES[1:] for c in "xyz"]
    t = ["0", "1", "2"]
    assert [*full.samples.groupby(["engine", "route"], sort=False).groups] == [
        (engine, route) for engine, routes in ROUTES.items() if engine not in MISSING for route in routes
    ]
    for (_, route), rows in full.samples.groupby(["engine", "route"]):
        keys = list(rows[["t", "leg", "quantity", "component"]].itertuples(index=False, name=None))
        native = route == "native"  # which is handed the driving forces
        of_legs = vectors if native else scalars + vectors
        want = [(k, leg, q, c) for k in t for leg in "123456" for q, c in of_legs]
        want += [(k, "0", q, c) for k in t for q in HULL + (NATIVE if native else []) for c in "xyz"]
        assert sorted(keys) == sorted(want)
        assert len(keys) == 3 * (6 * 21 + 12 if native else 6 * 25 + 6)
    assert set(full.samples["engine"]) == set(ROUTES) - set(MISSING)


def test_samples_are_float64_with_17_digits(full: Run, hexapod: Scene) -> None:
    for column in ("t", "value"):
        assert all(f"{float(text):.17g}" == text for text in full.samples[column])
    # Ball arithmetic gives the same midpoints in every process: what is read back is what was computed, bit for bit.
    truth = load_engine("reference")(hexapod).inverse_dynamics(from_scene(hexapod, 3))
    rows = full.samples[full.samples["engine"] == "reference"]
    for name, want in (("F", truth.F), ("L", truth.L), ("dL", truth.dL)):
        np.testing.assert_array_equal(rows[rows["quantity"] == name]["value"].astype(float), want.ravel())


def test_only_the_reference_has_a_radius(full: Run) -> None:
    certified = full.samples["engine"] == "reference"
    assert set(full.samples[~certified]["radius"]) == {""}
    radius = full.samples[certified]["radius"].astype(float)
    assert (radius >= 0).all()
    assert (radius < 1e-12).all()  # N, N m, m, W: half a unit in the last place of some hundred is 1e-14
    assert (radius[full.samples["quantity"] == "F"] > 0).all()


def test_power_is_driving_force_times_rate_of_length(full: Run, one: Run) -> None:
    for run in (full, one):
        scalar = (run.samples["component"] == "-") & (run.samples["route"] != "native")
        values = run.samples[scalar].astype({"value": float})
        table = values.pivot(index=["engine", "t", "leg"], columns="quantity", values="value")
        np.testing.assert_array_equal(table["power"], table["F"] * table["dL"])
        assert (table["power"] != 0).all()


def test_run_json_tells_versions_machine_seed_command_and_hashes(full: Run) -> None:
    info = full.info
    assert set(info) == {
        "run_id", "started", "seconds", "command", "versions", "machine", "scene", "trajectory", "truth", "models",
        "failed", "crashed", "status",
    }  # fmt: skip
    assert {info["run_id"]} == set(full.agreement["run_id"])
    assert info["command"][1:] == ["run", "--samples", "3", "--out", "results"]
    assert info["status"] == full.done.status
    assert set(info["failed"]) == set(MISSING)
    packages = {"python", "numpy", "scipy", "pandas", "stewart-crosscheck", "mujoco", "pin", "dartpy", "python-flint"}
    assert packages <= set(info["versions"])
    assert set(info["machine"]) == {"system", "processor", "model", "cores", "usable_cores", "memory_gib"}
    assert info["truth"] == {"samples": 3, "of": 3, "seed": info["truth"]["seed"]}
    assert isinstance(info["truth"]["seed"], int)
    text = (resources.files("stewart_crosscheck.models") / "scenes" / "hexapod.toml").read_bytes()
    assert info["scene"]["sha256"] == hashlib.sha256(text).hexdigest()
    assert re.fullmatch(r"[0-9a-f]{64}", info["trajectory"]["rows_sha256"])
    assert (info["scene"]["name"], info["trajectory"]["samples"]) == ("hexapod", 3)


def test_one_engine_still_has_the_reference_beside_it(one: Run) -> None:
    assert one.done.status == 0, one.done.err
    rows = list(one.agreement[["engine", "quantity"]].itertuples(index=False, name=None))
    assert rows == [(engine, q) for engine in ("analytic", "reference") for q in QUANTITIES + HULL]
    assert set(one.samples["engine"]) == {"analytic", "reference"}
    assert len(one.samples) == 2 * (6 * 25 + 6)


def test_the_default_folder_is_runs_and_the_run_id(one: Run) -> None:
    assert one.folder.name == one.info["run_id"]
    assert f"results: {Path('runs') / one.info['run_id']}" in one.done.out
    assert {entry.name for entry in one.folder.parent.parent.iterdir()} == {"motion.csv", "runs"}


def test_a_trajectory_file_is_named_in_the_results(one: Run) -> None:
    assert set(one.agreement["trajectory"]) == {"motion.csv"}
    assert one.info["trajectory"]["source"] == "motion.csv"
    assert "motion.csv, 1 samples" in one.done.out


def test_the_module_is_the_same_command(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "stewart_crosscheck.crosscheck", "run", "nothing"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == tuple(crosscheck(tmp_path, "run", "nothing")[i] for i in (0, 2))
    assert done.returncode == 2


# --- Unusable input ---------------------------------------------------------------------------------------------------


def pins(n: int) -> str:
    """hexapod.toml with n legs: rows dropped or repeated with a shift."""

    def change(block: re.Match[str]) -> str:
        rows = block[2].splitlines(keepends=True)
        more = [row.replace("[0.", "[0.1").replace("[-0.", "[-0.1") for row in rows]
        return block[1] + "".join([*rows, *more][:n]) + "]"

    return re.sub(r"(^pins = \[\n)(.*?)^\]", change, HEXAPOD, flags=re.M | re.S)


def crowd(folder: Path) -> None:
    """Everything that the commands below name."""
    files = {
        "mass.toml": HEXAPOD.replace("rod = { mass = 2.8", "rod = { mass = -2.8"),
        "broken.toml": "schema = ",
        "still.toml": HEXAPOD.split("[motion]")[0],
        "five.toml": pins(5),
        "eight.toml": pins(8),
        "empty.csv": "",
        "text.csv": ",".join(POSE) + "\n" + "0,0,1,0,1,0,0,left\n",
        "file": "",
        "full/entry": "",
    }
    for name, text in files.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")


UNUSABLE = {
    "run --engine bullet": "--engine: got an unknown engine 'bullet', expected one of analytic, dart, mujoco, ",
    "run nothing": "'nothing': got an unknown scene, expected one of ",
    "run missing.toml": "missing.toml: No such file or directory, expected a readable TOML file",
    "run mass.toml": "mass.toml: leg.rod.mass: got -2.8, expected greater than 0",
    "run broken.toml": "broken.toml: got no TOML, expected a scene: Invalid value (at end of document)",
    "run full": "full: Is a directory, expected a readable TOML file",
    "run still.toml": "still.toml: motion: missing, expected a [motion] table or a trajectory file",
    "run five.toml": "five.toml: hull.pins: got 5 legs, expected 6: .* overdetermined",
    "run eight.toml": "eight.toml: hull.pins: got 8 legs, expected 6: .* underdetermined",
    "run --samples 0": "Invalid value for '--samples': got '0', expected a whole number from 1 to 1000000",
    "run --samples -3": "Invalid value for '--samples': got '-3', expected a whole number from 1 to 1000000",
    "run --samples abc": "Invalid value for '--samples': got 'abc', expected a whole number from 1 to 1000000",
    "run --samples 2.5": "Invalid value for '--samples': got '2.5', expected a whole number from 1 to 1000000",
    "run --samples 99999999999999999999": "Invalid value for '--samples': got '99999999999999999999', expected a whole",
    "run --samples 3 --trajectory text.csv": "Invalid value for '--samples': got it together with --trajectory",
    "run --trajectory missing.csv": "missing.csv: No such file or directory, expected a readable CSV file",
    "run --trajectory empty.csv": "empty.csv: got an empty file, expected a header t, p_x, ",
    "run --trajectory text.csv": "text.csv: line 2: q_z: got 'left', expected a finite number",
    "run --out file": "--out file: got a file, expected a folder that does not exist or is empty",
    "run --out full": "--out full: got a folder that is not empty, expected one that does not exist or is empty",
    "run --out file/below": "--out file/below: Not a directory, expected a folder that can be written to",
    "run --colour": "No such option: --colour",
    "run hexapod hexapod": "Got unexpected extra argument",
    "run --engine": "Option '--engine' requires an argument",
    "audit hexapod": "Got unexpected extra argument",
    "audit --out file": "--out file: got a file, expected a folder that does not exist or is empty",
    "bench nothing": "'nothing': got an unknown scene, expected one of ",
    "bench --engine bullet": "--engine: got an unknown engine 'bullet', expected one of analytic, dart, mujoco, ",
    "bench still.toml": "still.toml: motion: missing, expected a [motion] table or a trajectory file",
    "bench five.toml": "five.toml: hull.pins: got 5 legs, expected 6: .* overdetermined",
    "bench --out full": "--out full: got a folder that is not empty, expected one that does not exist or is empty",
    "bench --samples 3": "No such option: --samples",
    "stress --family nothing": "--family: got an unknown family of cases 'nothing', expected one of ",
    "stress --engine bullet": "--engine: got an unknown engine 'bullet', expected one of analytic, dart, mujoco, ",
    "stress --out full": "--out full: got a folder that is not empty, expected one that does not exist or is empty",
    "stress hexapod": "Got unexpected extra argument",
    "fly": "No such command 'fly'",
    "models": "Missing argument 'scene'",
    "models hexapod": "Missing option '--out'",
    "models nothing --out new": "'nothing': got an unknown scene, expected one of ",
    "models mass.toml --out new": "mass.toml: leg.rod.mass: got -2.8, expected greater than 0",
    "models hexapod --out full": "--out full: got a folder that is not empty, expected ",
    "models hexapod --out file/below": "--out file/below: Not a directory, expected ",
    "scenes hexapod": "Got unexpected extra argument",
    "engines --colour": "No such option: --colour",
}


@pytest.mark.parametrize("line", UNUSABLE)
def test_unusable_input_is_status_2_and_one_message_and_nothing_written(
    command: Command, tmp_path: Path, line: str
) -> None:
    crowd(tmp_path)
    before = sorted(tmp_path.rglob("*"))
    status, out, err = command(*line.split())
    assert status == 2
    assert out == ""
    assert err.startswith("crosscheck: ")
    assert len(err.splitlines()) == 1
    pattern = UNUSABLE[line]
    start, _, end = pattern.partition(".* ")
    assert err.startswith(f"crosscheck: {start}")
    assert err.rstrip("\n").endswith(end)
    assert "Traceback" not in err
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("line", ["run mass.toml --out new/results", "run --out file/below"])
def test_unusable_input_is_the_same_as_a_process(tmp_path: Path, line: str) -> None:
    crowd(tmp_path)
    before = sorted(tmp_path.rglob("*"))
    done = crosscheck(tmp_path, *line.split())
    assert (done.status, done.out) == (2, "")
    assert len(done.err.splitlines()) == 1
    assert sorted(tmp_path.rglob("*")) == before


def test_a_folder_runs_that_cannot_be_made_is_seen_before_the_work(command: Command, tmp_path: Path) -> None:
    (tmp_path / "runs").write_text("")
    status, out, err = command("run", "--samples", "2")
    assert (status, out) == (2, "")
    assert err == "crosscheck: --out runs/RUN_ID: Not a directory, expected a folder that can be written to\n"


def test_an_error_of_ours_is_status_4_with_a_traceback(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    """The word that the tests above do not find is there when it should be."""

    def broken() -> list[str]:
        raise ZeroDivisionError("ours")

    monkeypatch.setattr(cli, "scene_names", broken)
    status, _, err = command("scenes")
    assert status == 4
    assert err.startswith("crosscheck: internal error, please report it")
    assert "Traceback" in err
    assert "ZeroDivisionError: ours" in err


# --- The other commands -----------------------------------------------------------------------------------------------


def test_models_writes_the_files_that_write_models_gives(command: Command, tmp_path: Path, hexapod: Scene) -> None:
    status, out, err = command("models", "hexapod", "--out", "new/models")
    assert (status, err) == (0, "")
    files = {path.name: path.read_text(encoding="utf-8") for path in (tmp_path / "new" / "models").iterdir()}
    assert files == write_models(hexapod)
    assert out.splitlines() == [str(Path("new/models") / name) for name in write_models(hexapod)]


def test_scenes_lists_every_built_in_scene(command: Command) -> None:
    status, out, err = command("scenes")
    assert (status, err) == (0, "")
    assert all(name in out for name in scene_names())
    row = next(line for line in out.splitlines() if "hexapod" in line)
    assert "19" in row
    assert "24 = 6 + 18" in row
    assert ", ".join(QUANTITIES) in row


def test_engines_lists_every_engine_with_route_and_version(command: Command) -> None:
    status, out, err = command("engines")
    assert (status, err) == (0, "")
    for name, routes in ROUTES.items():
        row = next(line for line in out.splitlines() if f" {name} " in line)
        assert f" {', '.join(routes)} " in row
        assert "missing" in row if name in MISSING else re.search(r"\d+\.\d+", row)


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_help_with_an_example(command: Command, name: str) -> None:
    status, out, err = command(name, "--help")
    assert (status, err) == (0, "")
    assert f"Example: crosscheck {name}" in out


@pytest.mark.parametrize("args", [(), ("--help",)], ids=["nothing", "--help"])
def test_help_names_every_command(command: Command, args: tuple[str, ...]) -> None:
    status, out, _ = command(*args)
    assert status == 0
    assert all(re.search(rf"^\W*{name} ", out, flags=re.M) for name in COMMANDS)


def test_the_help_test_covers_every_command() -> None:
    assert {c.callback.__name__ for c in cli.app.registered_commands if c.callback} == set(COMMANDS)


def test_a_reader_that_has_gone_is_no_error(tmp_path: Path) -> None:
    """`crosscheck scenes | head -0`: no traceback, and the status is that of the command."""
    process = subprocess.Popen(
        [CROSSCHECK, "scenes"], cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    assert process.stderr is not None
    process.stdout.close()  # long before the first line: the imports take half a second
    with process.stderr:
        err = process.stderr.read()
    assert (process.wait(timeout=60), err) == (0, "")


def test_a_command_without_descriptors_says_so(tmp_path: Path) -> None:
    command = f"ulimit -n 12; exec {CROSSCHECK} run --engine analytic --samples 1"
    done = subprocess.run(["bash", "-c", command], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (4, "crosscheck: cannot go on: Too many open files\n")
    assert not list(tmp_path.iterdir())


def test_a_broken_installation_is_no_disagreement(tmp_path: Path) -> None:
    (tmp_path / "pebble.py").write_text("raise ImportError('broken')")
    done = subprocess.run(
        [sys.executable, "-m", "stewart_crosscheck.crosscheck", "scenes"],
        env=os.environ | {"PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 4
    assert done.stderr == "crosscheck: internal error, broken installation: ImportError: broken\n"


def test_margins_are_those_of_the_rows_of_agreement(full: Run) -> None:
    margins = pd.read_csv(full.folder / "margins.csv", keep_default_na=False)
    shared = ["engine", "route", "quantity", "verdict"]
    assert margins[shared].equals(full.agreement[shared])
    ran = full.agreement["verdict"] != "error"
    assert (pd.to_numeric(margins["margin"][ran]) <= 1.0).all()
    assert margins["where"][ran].str.contains(", t = ").all()
    row = full.agreement[["engine", "quantity"]].eq(["analytic", "F"]).all(axis=1)
    error, scale, tolerance = full.agreement.loc[row, ["max_abs", "scale", "tolerance"]].astype(float).to_numpy()[0]
    # a well-conditioned machine has one tolerance at all samples
    assert float(margins.loc[row, "margin"].iloc[0]) == pytest.approx(error / (scale * tolerance), rel=1e-12)


@pytest.mark.parametrize("width", [40, 80, 200])
def test_no_number_is_cut_on_a_narrow_terminal(width: int, full: Run) -> None:
    agreement = pd.read_csv(full.folder / "agreement.csv").assign(where="", reason="")
    agreement["engine_version"] = agreement["engine_version"].fillna("")
    text = io.StringIO()
    print_verdict(agreement, Console(file=text, width=width))
    rows = [line for line in text.getvalue().splitlines() if line.startswith("│")]
    shown = [cell for row in rows for cell in re.findall(r" (\d\.\de[-+]\d\d|error) ", row)]
    assert len(shown) == len(agreement)
    assert {row.split()[1] for row in rows} == set(agreement["quantity"])


def test_a_wider_tolerance_is_announced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    text = (resources.files("stewart_crosscheck.models") / "scenes" / "hexapod.toml").read_text()
    scene = tmp_path / "close.toml"
    # legs 2 and 5 nearly in one line
    text = text.replace("[-0.211, -0.047, -0.287]", "[0.1311, -0.063, 0.317]").replace(
        "[-0.197, -0.052, -0.612]", "[0.5382, -0.027, 0.7311]"
    )
    scene.write_text(text)
    argv = ["crosscheck", "run", str(scene), "--engine", "analytic", "--samples", "2", "--out", str(tmp_path / "out")]
    monkeypatch.setattr(sys, "argv", argv)
    with pytest.raises(SystemExit) as e:
        cli.main()
    assert e.value.code == 0
    assert "the tolerance of forces and moments is wider at 2 of 2 samples" in " ".join(capsys.readouterr().out.split())
