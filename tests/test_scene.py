"""The scene schema: what a good file gives, and a message that names file and field for every kind of bad one."""

from __future__ import annotations

import re
from importlib import resources
from pathlib import Path

import pytest
from conftest import parameters
from pydantic import ValidationError

from stewart_crosscheck.models import Scene, SceneError, load_scene, scene_names
from stewart_crosscheck.models.scene import parse_scene
from stewart_crosscheck.models.tables import Platform

HEXAPOD = (resources.files("stewart_crosscheck.models") / "scenes" / "hexapod.toml").read_text(encoding="utf-8")

ROD_MASS = "rod = { mass = 2.8"
PIN_2, PIN_LINE = "[-0.127, -0.032, 0.339]", "    [-0.127, -0.032, 0.339],\n"
INERTIA_1, INERTIA_2 = "[0.083, 2.42, 0.112]", "    [-0.047, 0.112, 1.57],\n"
GUIDE = "guide = { mass = 3.4, com = 0.21, J_x = 0.229, J_y = 0.0094 }"
POSITION_1 = "    { c0 = 0.943, terms = [[0.061, 2.9, 1.3]] },\n"
BASE = "base = { mass = 2.1, J_z = 0.0117 }\n"


def edited(old: str, new: str) -> str:
    assert HEXAPOD.count(old) >= 1, f"hexapod.toml has no {old!r} any more"
    return HEXAPOD.replace(old, new, 1)


def with_table(text: str) -> str:
    return edited("[hull]\n", f"{text}\n[hull]\n")


def refusal(path: Path, text: str | bytes) -> str:
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(SceneError) as e:
        load_scene(path)
    lines = str(e.value).splitlines()
    assert all(line.startswith(f"{path}: ") for line in lines), "every line names the file"
    return "\n".join(line.removeprefix(f"{path}: ") for line in lines)


# --- Good files -------------------------------------------------------------------------------------------------------


def test_a_built_in_scene_loads_by_name_and_by_path(hexapod: Scene, tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(HEXAPOD, encoding="utf-8")
    for scene in (load_scene(path), load_scene(str(path))):
        assert scene.model_dump() == hexapod.model_dump()
        assert scene.source == str(path)
    assert hexapod.source == "hexapod.toml"
    assert "hexapod" in scene_names()


@pytest.mark.parametrize("name", scene_names())
def test_every_built_in_scene_bears_the_name_of_its_file_and_is_determinate(name: str) -> None:
    scene = load_scene(name)
    assert scene.name == name
    assert scene.nv == scene.na + scene.nc


@pytest.mark.parametrize("text", ["\ufeff" + HEXAPOD, HEXAPOD.replace("\n", "\r\n")], ids=["byte order mark", "CRLF"])
def test_a_file_from_another_editor_is_the_same_scene(hexapod: Scene, tmp_path: Path, text: str) -> None:
    path = tmp_path / "mine.toml"
    path.write_bytes(text.encode())
    assert load_scene(path).model_dump() == hexapod.model_dump()


def test_hexapod_has_19_bodies_and_24_velocities(hexapod: Scene) -> None:
    leg = [("base", 2.1), ("guide", 3.4), ("rod", 2.8)]
    bodies = [(f"{kind}{i}", mass) for i in range(1, 7) for kind, mass in leg] + [("platform", 27.3)]
    assert list(hexapod.bodies) == bodies
    assert len(hexapod.bodies) == 19
    assert (hexapod.N, hexapod.nv, hexapod.na, hexapod.nc) == (6, 24, 6, 18)
    assert hexapod.quantities == ("F", "F_r", "F_s", "F_n", "F_o", "M_s", "M_n", "M_o")
    assert hexapod.coordinates == tuple(f"{c}{i}" for i in range(1, 7) for c in "ons")


def test_hexapod_joints_chain_each_leg_from_hull_to_platform(hexapod: Scene) -> None:
    for i in hexapod.legs:
        o, n, s, r = (j for j in hexapod.joints if j.leg == i)
        assert [j.name for j in (o, n, s, r)] == [f"o{i}", f"n{i}", f"s{i}", f"r{i}"]
        assert [j.type for j in (o, n, s, r)] == ["revolute", "revolute", "prismatic", "spherical"]
        assert (o.parent, o.child) == ("hull", f"base{i}")
        assert (n.parent, n.child) == (o.child, f"guide{i}")
        assert (s.parent, s.child) == (n.child, f"rod{i}")
        assert (r.parent, r.child) == ("platform", s.child)
        assert [j.actuated for j in (o, n, s, r)] == [False, False, True, False]
        assert [j.cut for j in (o, n, s, r)] == [False, False, False, True]
        assert [(j.force, j.moment) for j in (o, n, s, r)] == [
            ("F_o", "M_o"),
            ("F_n", "M_n"),
            ("F_s", "M_s"),
            ("F_r", None),
        ]
    assert len(hexapod.joints) == 24


def test_without_base_13_bodies_24_velocities_and_no_base_reaction() -> None:
    scene = parse_scene(edited(BASE, ""), "x.toml")
    assert len(scene.bodies) == 13
    assert not [b for b in scene.bodies if b.name.startswith("base")]
    assert (scene.nv, scene.na, scene.nc) == (24, 6, 18)
    assert scene.quantities == ("F", "F_r", "F_s", "F_n", "M_s", "M_n")
    hinges = [j for j in scene.joints if j.parent == "hull"]
    assert [(j.type, j.coordinates, j.child) for j in hinges] == [
        ("universal", (f"o{i}", f"n{i}"), f"guide{i}") for i in scene.legs
    ]


def test_parameters_are_the_numbers_of_the_file() -> None:
    load = "[load]\nforce = [1.0, 2.0, 3.0]\nmoment = [4.0, 5.0, 6.0]\npoint = [7.0, 8.0, 9.0]\n"
    P = parameters(parse_scene(with_table(load), "x.toml"))
    leg = P.leg
    assert (leg.m_o, leg.J_oz) == (2.1, 0.0117)
    assert (leg.m_n, leg.a_n, leg.J_nx, leg.J_ny) == (3.4, 0.21, 0.229, 0.0094)
    assert (leg.m_s, leg.a, leg.J_sx, leg.J_sz) == (2.8, 0.37, 0.0917, 0.0031)
    assert (P.p[1], P.O[1], P.g) == ((0.131, -0.063, 0.318), (0.538, -0.027, 0.731), (0.0, -9.81, 0.0))
    assert P.I_p == ((1.31, 0.083, -0.047), (0.083, 2.42, 0.112), (-0.047, 0.112, 1.57))
    assert P.m_p == 27.3
    assert (P.load.force, P.load.moment, P.load.point) == ((1.0, 2.0, 3.0), (4.0, 5.0, 6.0), (7.0, 8.0, 9.0))


def test_gravity_and_load_may_be_left_out(hexapod: Scene) -> None:
    scene = parse_scene(edited("gravity = [0.0, -9.81, 0.0]\n", ""), "x.toml")
    assert scene.gravity == (0.0, -9.81, 0.0)
    assert hexapod.load is None
    assert parameters(hexapod).load.force == (0.0, 0.0, 0.0)


def test_a_scene_never_changes(hexapod: Scene) -> None:
    with pytest.raises(ValidationError, match="frozen"):
        hexapod.name = "other"  # pyright: ignore[reportAttributeAccessIssue]


def test_a_changed_copy_lists_its_own_bodies_joints_and_numbers(hexapod: Scene) -> None:
    assert len(hexapod.bodies) == 19  # a list that was made before must not be handed on
    copy = hexapod.model_copy(update={"leg": hexapod.leg.model_copy(update={"base": None, "a": 0.5})})
    assert len(copy.bodies) == 13
    assert "F_o" not in copy.quantities
    assert (parameters(copy).leg.m_o, parameters(copy).leg.a) == (0.0, 0.5)


# --- Files that hold no scene -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("content", "got", "expected"),
    [
        (b"", "empty file", "expected a scene"),
        (b"# a comment\n\n", "empty file", "expected a scene"),
        (b"\xff\xfe\x00\x01", "bytes that are no text (at 0)", "expected a readable TOML file in UTF-8"),
        (b"\x00\x01\x02", "got no TOML", "expected a scene"),
        (b"hello world\n", "got no TOML", "at line 1, column 7"),
        (HEXAPOD.encode() + b"[leg]\n", "got no TOML", "Cannot declare ('leg',) twice"),
        (b"a = " + b"[" * 5000, "got no TOML", "expected a scene"),
        (b"a = " + b"1" * 5000, "got no TOML", "expected a scene"),
    ],
    ids=["empty", "comment", "not UTF-8", "binary", "text", "table twice", "nested too deep", "integer too long"],
)
def test_a_file_without_a_scene_is_refused(tmp_path: Path, content: bytes, got: str, expected: str) -> None:
    message = refusal(tmp_path / "bad.toml", content)
    assert got in message
    assert expected in message
    assert "expected a scene" in message or "expected a readable TOML file in UTF-8" in message


@pytest.mark.parametrize(
    ("name", "got"),
    [
        ("missing.toml", "No such file or directory"),
        ("folder", "Is a directory"),
        ("missing/scene.toml", "No such file or directory"),
        ("x" * 300, "File name too long"),
        ("null\0byte.toml", "null byte"),
    ],
    ids=["missing", "directory", "missing folder", "name too long", "null byte"],
)
def test_an_unreadable_path_is_named(tmp_path: Path, name: str, got: str) -> None:
    (tmp_path / "folder").mkdir()
    path = tmp_path / name
    with pytest.raises(SceneError, match=r"expected a readable TOML file") as e:
        load_scene(path)
    assert repr(str(path)).strip("'") in str(e.value)
    assert got in str(e.value)


def test_a_long_word_is_no_crash(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SceneError, match="File name too long, expected"):
        load_scene("x" * 300)


@pytest.mark.parametrize("name", ["hexapodd", "Hexapod", ""])
def test_an_unknown_name_lists_the_valid_ones(name: str) -> None:
    with pytest.raises(SceneError, match="got an unknown scene, expected one of ") as e:
        load_scene(name)
    assert repr(name) in str(e.value)
    assert all(valid in str(e.value).split("expected")[1] for valid in scene_names())


# --- Values that describe no mechanism --------------------------------------------------------------------------------

NUMBERS = [
    ("nan", "nan", "a finite number"),
    ("inf", "inf", "a finite number"),
    ("-inf", "-inf", "a finite number"),
    ("1e400", "inf", "a finite number"),
    ("1e200", "1e+200", "a number up to 1e+20"),
    ("-2.8", "-2.8", "greater than 0"),
    ("0.0", "0.0", "greater than 0"),
    ("0", "0", "greater than 0"),
    ("true", "True", "a valid number"),
    ("'2.8'", "'2.8'", "a valid number"),
    ("[2.8]", "[2.8]", "a valid number"),
    ("{ kg = 2.8 }", "a table", "a valid number"),
    ("2016-01-01", "2016", "a valid number"),
]


@pytest.mark.parametrize(("value", "got", "expected"), NUMBERS, ids=[n[0] for n in NUMBERS])
def test_a_mass_that_is_no_positive_number_is_refused(tmp_path: Path, value: str, got: str, expected: str) -> None:
    message = refusal(tmp_path / "bad.toml", edited(ROD_MASS, f"rod = {{ mass = {value}"))
    assert re.fullmatch(rf"leg\.rod\.mass: got .*{re.escape(got)}.*, expected {re.escape(expected)}", message)


POSITIVE = [
    ("base = { mass = 2.1", "leg.base.mass"),
    ("base = { mass = 2.1, J_z = 0.0117", "leg.base.J_z"),
    ("guide = { mass = 3.4", "leg.guide.mass"),
    ("guide = { mass = 3.4, com = 0.21, J_x = 0.229", "leg.guide.J_x"),
    ("rod = { mass = 2.8, J_x = 0.0917", "leg.rod.J_x"),
    ("[platform]\nmass = 27.3", "platform.mass"),
    ("duration = 2.0", "motion.duration"),
]


@pytest.mark.parametrize(("text", "field"), POSITIVE, ids=[p[1] for p in POSITIVE])
@pytest.mark.parametrize("value", ["0.0", "-1.0"])
def test_masses_transverse_moments_and_the_duration_must_be_positive(
    tmp_path: Path, text: str, field: str, value: str
) -> None:
    message = refusal(tmp_path / "bad.toml", edited(text, text.rpartition(" ")[0] + f" {value}"))
    assert f"{field}: got {value}, expected greater than 0" in message


@pytest.mark.parametrize(("old", "field"), [("J_y = 0.0094", "leg.guide.J_y"), ("J_z = 0.0031", "leg.rod.J_z")])
def test_inertia_about_the_long_axis_may_be_zero_but_not_negative_or_forgotten(
    tmp_path: Path, old: str, field: str
) -> None:
    key = old.split(" ")[0]
    assert parse_scene(edited(old, f"{key} = 0.0"), "x.toml").nv == 24
    assert (
        refusal(tmp_path / "bad.toml", edited(old, f"{key} = -1e-9")) == f"{field}: got -1e-09, expected zero or more"
    )
    forgotten = refusal(tmp_path / "bad.toml", edited(f", {old}", ""))
    assert forgotten == f"{field}: got nothing, expected this key: a spatial scene needs it"


FINITE = [
    ("a = 0.37", "a = nan", "leg.a"),
    ("com = 0.21", "com = inf", "leg.guide.com"),
    ("gravity = [0.0, -9.81", "gravity = [0.0, nan", "gravity[1]"),
    (PIN_2, "[-0.127, nan, 0.339]", "platform.pins[2][1]"),
    ("[-0.463, 0.018, 0.582]", "[-0.463, 0.018, -inf]", "hull.pins[2][2]"),
    (INERTIA_1, "[0.083, inf, 0.112]", "platform.inertia[1][1]"),
    ("c0 = 0.943", "c0 = nan", "motion.position[1].c0"),
    ("[[0.061, 2.9, 1.3]]", "[[0.061, inf, 1.3]]", "motion.position[1].terms[0][1]"),
    ("c0 = -0.043", "c0 = nan", "motion.orientation.components[1].c0"),
]


@pytest.mark.parametrize(("old", "new", "field"), FINITE, ids=[f[2] for f in FINITE])
def test_nan_and_infinity_are_refused_everywhere(tmp_path: Path, old: str, new: str, field: str) -> None:
    message = refusal(tmp_path / "bad.toml", edited(old, new))
    assert re.fullmatch(rf"{re.escape(field)}: got -?(nan|inf), expected a finite number", message)


LEVELS = [
    ("schema = 1\n", "colour"),
    ("[leg]\n", "leg.colour"),
    ("[platform]\n", "platform.colour"),
    ("[hull]\n", "hull.colour"),
    ("[motion]\n", "motion.colour"),
    ("[motion.orientation]\n", "motion.orientation.colour"),
]


@pytest.mark.parametrize(("table", "field"), LEVELS, ids=[f[1] for f in LEVELS])
def test_an_unknown_key_is_refused_in_every_table(tmp_path: Path, table: str, field: str) -> None:
    message = refusal(tmp_path / "bad.toml", edited(table, f"{table}colour = 'red'\n"))
    assert message == f"{field}: unknown key, expected none of this name"


INLINE = [
    ("base = { ", "leg.base"),
    ("guide = { ", "leg.guide"),
    ("rod = { ", "leg.rod"),
    ("{ c0 = 0.943", "motion.position[1]"),
]


@pytest.mark.parametrize(("start", "field"), INLINE, ids=[f[1] for f in INLINE])
def test_an_unknown_key_is_refused_in_every_inline_table(tmp_path: Path, start: str, field: str) -> None:
    message = refusal(tmp_path / "bad.toml", edited(start, start.replace("{ ", "{ colour = 1, ")))
    assert message == f"{field}.colour: unknown key, expected none of this name"


OPTIONAL = [
    ("[load]\ncolour = 1", "load.colour: unknown key, expected none of this name"),
    ("[load]\nforce = [0.0, nan, 0.0]", "load.force[1]: got nan, expected a finite number"),
    ("[load]\npoint = [0.0, 1.0]", "load.point[2]: got nothing, expected one entry more"),
    (
        "[initial]\nposition = [0.0, 1.0, 0.0]\norientation = { kind = 'euler', angles = [0.0, 0.0, 0.0] }",
        "initial.orientation.kind: got 'euler', expected 'cardan_xyz' or 'rotation_vector'",
    ),
    (
        "[initial]\nposition = [0.0, 1.0, 0.0]\norientation = { kind = 'cardan_xyz', angles = [0.0, 0.0, inf] }",
        "initial.orientation.angles[2]: got inf, expected a finite number",
    ),
    ("[forces]\nlegs = [{ c0 = 61.0 }]", "forces.legs has 1 rows, expected one per leg: 6"),
    ("[forces]\nlegs = [" + "{}, " * 7 + "]", "forces.legs has 7 rows, expected one per leg: 6"),
]


@pytest.mark.parametrize(("table", "message"), OPTIONAL, ids=[m[1].split(":")[0] for m in OPTIONAL])
def test_a_wrong_optional_table_is_refused(tmp_path: Path, table: str, message: str) -> None:
    assert refusal(tmp_path / "bad.toml", with_table(table)) == message


SHAPES = [
    (PIN_2, "[-0.127, -0.032]", "platform.pins[2][2]: got nothing, expected one entry more"),
    (PIN_2, "[-0.127, -0.032, 0.339, 0.0]", "platform.pins[2]: got 4 entries, expected at most 3"),
    (PIN_2, "0.339", "platform.pins[2]: got 0.339, expected an array"),
    (PIN_LINE, "", "platform.pins has 5 rows, hull.pins 6: one pin per leg is needed"),
    (INERTIA_2, "", "platform.inertia[2]: got nothing, expected one entry more"),
    (INERTIA_1, "[0.083, 2.42]", "platform.inertia[1][2]: got nothing, expected one entry more"),
    ("gravity = [0.0, -9.81, 0.0]", "gravity = -9.81", "gravity: got -9.81, expected an array"),
    (POSITION_1, "", "motion.position[2]: got nothing, expected one entry more"),
    ("[[0.061, 2.9, 1.3]]", "[[0.061, 2.9]]", "motion.position[1].terms[0][2]: got nothing, expected one entry more"),
    (GUIDE, "guide = 3.4", "leg.guide: got 3.4, expected a table"),
    (GUIDE, "", "leg.guide: got nothing, expected this key"),
    ("mass = 27.3\n", "", "platform.mass: got nothing, expected this key"),
    ("schema = 1\n", "", "schema: got nothing, expected this key"),
]


@pytest.mark.parametrize(
    ("old", "new", "message"), SHAPES, ids=[f"{s[2].split(':')[0]} {i}" for i, s in enumerate(SHAPES)]
)
def test_a_wrong_shape_is_refused(tmp_path: Path, old: str, new: str, message: str) -> None:
    assert refusal(tmp_path / "bad.toml", edited(old, new)) == message


def test_no_pins_at_all_are_refused(tmp_path: Path) -> None:
    text = re.sub(r"^pins = \[\n.*?^\]", "pins = []", HEXAPOD, flags=re.M | re.S)
    message = refusal(tmp_path / "bad.toml", text)
    assert "platform.pins: got 0 entries, expected at least 1" in message
    assert "hull.pins: got 0 entries, expected at least 1" in message


IMPOSSIBLE = [
    (
        INERTIA_1,
        "[0.084, 2.42, 0.112]",
        r"platform\.inertia: got \[0\]\[1\] = 0.083 and \[1\]\[0\] = 0.084, expected a symm",
    ),
    ("2.42", "2.88", r"platform\.inertia: got principal moments .*, expected none above the sum of the others"),
    ("1.57", "-1.57", r"platform\.inertia: got principal moments -1\.5.*, expected three positive ones"),
    ("1.57", "0.0", r"platform\.inertia: got principal moments -0\.0.*, expected three positive ones"),
    ("J_z = 0.0031", "J_z = 0.184", r"leg\.rod\.J_z: got 0\.184, expected at most 2 J_x = 0\.1834 "),
    ("J_y = 0.0094", "J_y = 0.159", r"leg\.guide\.J_y: got 0\.159, expected at most .* = 0\.07906 "),
    ("J_x = 0.229", "J_x = 0.1499", r"leg\.guide\.J_x is about O_n: got 0\.1499, expected more than .* = 0\.14994"),
    ("com = 0.21", "com = -0.26", r"leg\.guide\.J_x is about O_n: got 0\.229, expected more than .* = 0\.22984"),
]


@pytest.mark.parametrize(("old", "new", "message"), IMPOSSIBLE, ids=[f"{i[1]} for {i[0][:12]}" for i in IMPOSSIBLE])
def test_an_inertia_that_no_body_has_is_refused(tmp_path: Path, old: str, new: str, message: str) -> None:
    assert re.match(message, refusal(tmp_path / "bad.toml", edited(old, new)))


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("2.42", "2.84"),
        ("J_z = 0.0031", "J_z = 0.1834"),
        ("J_y = 0.0094", "J_y = 0.158"),
        ("J_x = 0.229", "J_x = 0.155"),
    ],
)
def test_an_inertia_just_within_the_limits_is_accepted(old: str, new: str) -> None:
    """The limits of the test above are where the message says, not somewhere below."""
    assert parse_scene(edited(old, new), "x.toml").N == 6


WORDS = [
    ("schema = 1", "schema = 2", "schema: got 2, expected 1"),
    ("schema = 1", "schema = true", "schema: got True, expected 1"),
    ("schema = 1", "schema = 1.0", "schema: got 1.0, expected 1"),
    ("schema = 1", "schema = '1'", "schema: got '1', expected 1"),
    ('"spatial"', '"flat"', "topology: got 'flat', expected 'spatial' or 'planar'"),
    ('"cardan_xyz"', '"euler"', "motion.orientation.kind: got 'euler', expected 'cardan_xyz' or 'rotation_vector'"),
    ('name = "hexapod"', "name = 3", "name: got 3, expected a valid string"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "message"), WORDS, ids=[w[1] for w in WORDS])
def test_a_wrong_word_is_refused(tmp_path: Path, old: str, new: str, message: str) -> None:
    assert refusal(tmp_path / "bad.toml", edited(old, new)) == message


def test_a_name_too_long_for_a_file_is_refused(tmp_path: Path) -> None:
    message = refusal(tmp_path / "bad.toml", edited('name = "hexapod"', f'name = "{"x" * 65}"'))
    assert message.endswith("expected a letter, then up to 63 letters, digits, _ and -")


@pytest.mark.parametrize("name", ["two words", "a/b", "../up", "", "6legs", "hexapod\\n", "é"])
def test_a_name_that_makes_no_file_name_is_refused(tmp_path: Path, name: str) -> None:
    message = refusal(tmp_path / "bad.toml", edited('name = "hexapod"', f'name = "{name}"'))
    assert message == f"name: got '{name}', expected a letter, then up to 63 letters, digits, _ and -"


def test_every_wrong_field_is_named_in_one_go(tmp_path: Path) -> None:
    text = edited(ROD_MASS, "rod = { mass = -1").replace("27.3", "nan").replace("duration = 2.0", "duration = 'x'")
    fields = [line.split(":")[0] for line in refusal(tmp_path / "bad.toml", text).splitlines()]
    assert fields == ["leg.rod.mass", "platform.mass", "motion.duration"]


@pytest.mark.parametrize(("largest", "possible"), [(2.0, True), (2.0 + 1e-11, False)])
def test_the_triangle_inequality_leaves_room_for_rounding_alone(largest: float, possible: bool) -> None:
    platform = {"mass": 1.0, "inertia": [[1.0, 0, 0], [0, largest, 0], [0, 0, 1.0]], "pins": [[0.0, 0.0, 0.0]]}
    if possible:
        assert Platform.model_validate(platform).tensor[1][1] == largest
    else:
        with pytest.raises(ValidationError, match="triangle inequality"):
            Platform.model_validate(platform)
