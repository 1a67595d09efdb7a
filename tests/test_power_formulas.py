"""Faults in the formulas: every term is found, nothing changes without a fault, every public mistake is caught."""

from __future__ import annotations

import ast
import inspect
from dataclasses import replace

import numpy as np
import pytest

from stewart_crosscheck.analytic import inverse_dynamics, stewart
from stewart_crosscheck.crosscheck import power_terms
from stewart_crosscheck.crosscheck.engine import load_engine
from stewart_crosscheck.crosscheck.power_faults import Nothing, Term, coordinates
from stewart_crosscheck.crosscheck.power_mistakes import MISTAKES, Mistake
from stewart_crosscheck.crosscheck.power_terms import terms
from stewart_crosscheck.crosscheck.power_work import FORMULAS, Place, seen
from stewart_crosscheck.crosscheck.trajectory import from_scene
from stewart_crosscheck.models import load_scene

ROUTE = "closed_form"


@pytest.fixture(scope="module")
def places() -> dict[str, Place]:
    found = {}
    for name in ("hexapod", "planar3", "tsai2000"):
        scene = load_scene(name)
        trajectory = from_scene(scene, 11)
        found[name] = Place(scene, trajectory, load_engine("reference")(scene).inverse_dynamics(trajectory))
    return found


def number_of(function: str, text: str) -> int:
    return next(site.number for site in terms() if site.function == function and site.text == text)


# --- Terms ------------------------------------------------------------------------------------------------------------


def negated(node: ast.expr) -> ast.expr | None:
    """What stands behind the minus sign that leads a product, if one does."""
    while isinstance(node, ast.BinOp) and not isinstance(node.op, (ast.Add, ast.Sub)):
        node = node.left
    return node.operand if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub) else None


def test_every_operand_and_every_minus_sign_is_a_term() -> None:
    """By another walk: down the text, with the parents of every node, looking terms up by what they say."""
    known = {(site.function, site.text) for site in terms()}
    looked = 0
    for function in ast.parse(inspect.getsource(stewart)).body:
        if not isinstance(function, ast.FunctionDef):
            continue
        parent = {child: node for node in ast.walk(function) for child in ast.iter_child_nodes(node)}

        def aside(node: ast.AST, parent: dict[ast.AST, ast.AST] = parent) -> bool:
            """Whether it is in an index or a condition, or says what is wrong."""
            while node in parent:
                above = parent[node]
                if isinstance(above, ast.Subscript) and above.slice is node:
                    return True
                if isinstance(above, (ast.Compare, ast.Raise)):
                    return True
                node = above
            return False

        for node in ast.walk(function):
            operands: list[ast.expr] = []
            if isinstance(node, ast.BinOp) and isinstance(node.op, (ast.Add, ast.Sub)):
                operands = [node.left, node.right]
            elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in ("add", "sub"):
                operands = node.args
            elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
                operands = [node.operand]
            for k, operand in enumerate(operands):
                sums = isinstance(operand, ast.BinOp) and isinstance(operand.op, (ast.Add, ast.Sub))
                sums |= isinstance(operand, ast.Call) and ast.unparse(operand.func) in ("add", "sub")
                if aside(node) or (k == 0 and sums and not isinstance(node, ast.UnaryOp)):
                    continue  # the sum goes on: its own operands are looked at
                text = ast.unparse(negated(operand) or operand)
                assert (function.name, text) in known, f"{function.name}:{operand.lineno} {text}"
                looked += 1
    assert looked > 500


def test_terms_are_named_by_place_and_equation() -> None:
    assert [site.number for site in terms()] == list(range(len(terms())))
    site = terms()[number_of("leg_loads", "m_q * dot(k.x_n, g)")]
    line = inspect.getsource(stewart).splitlines()[site.line - 1]
    assert site.text in line
    assert site.equation == "(3)"


@pytest.mark.parametrize("name", ["hexapod", "planar3", "tsai2000"])
def test_without_a_fault_every_bit_is_the_same(name: str, places: dict[str, Place]) -> None:
    place = places[name]
    P, motion = place.scene.parameters, place.trajectory.motion
    want = inverse_dynamics(P, motion).numbers.copy()
    with power_terms.recorded() as values:
        got = inverse_dynamics(P, motion).numbers.copy()
        again = from_scene(place.scene, len(place.trajectory.t))
    assert len(values) > 100
    assert got.tobytes() == want.tobytes()
    for x, y in ((again.q, place.trajectory.q), (again.v, place.trajectory.v), (again.a, place.trajectory.a)):
        assert all(np.array_equal(x[c], y[c]) for c in y)
    some = next(iter(values))
    with power_terms.faulty(some, 0.0):
        assert inverse_dynamics(P, motion).numbers.tobytes() == want.tobytes()
    with power_terms.faulty(some, 1e-3):
        assert inverse_dynamics(P, motion).numbers.tobytes() != want.tobytes()
    assert inverse_dynamics(P, motion).numbers.tobytes() == want.tobytes(), "nothing stays behind"


def test_a_fault_is_one_term_times_its_factor() -> None:
    (x, y, z), b = (2.0, 3.0, 5.0), (7.0, 11.0, 13.0)
    with power_terms.faulty(number_of("dot", "a[1] * b[1]"), 0.5):
        assert stewart.dot((x, y, z), b) == 2.0 * 7.0 + 1.5 * 3.0 * 11.0 + 5.0 * 13.0
    with power_terms.faulty(number_of("sub", "b[2]"), -2.0):
        assert stewart.sub((x, y, z), b) == (-5.0, -8.0, 18.0)
    assert stewart.dot((x, y, z), b) == 112.0


@pytest.mark.parametrize(
    ("function", "text", "quantity"),
    [
        ("leg_kinematics", "A_y", "loop_acc"),
        ("leg_kinematics", "leg.a", "loop_pos"),
        ("hinge_rates", "k.nu", "loop_acc"),
    ],
)
def test_shared_kinematics_are_seen_by_the_loops_of_other_engines(
    function: str, text: str, quantity: str, places: dict[str, Place]
) -> None:
    """Joint coordinates that the formulas themselves do not use are seen by nobody else."""
    place, number = places["hexapod"], number_of(function, text)
    assert number in coordinates(place)
    found = seen(place, "pinocchio", "kkt", Term(number), 1e-9)
    assert found.detected
    assert found.quantity == quantity


# --- Mistakes ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mistake", MISTAKES, ids=lambda m: m.name)
def test_every_public_mistake_is_caught(mistake: Mistake, places: dict[str, Place]) -> None:
    found = seen(places["hexapod"], FORMULAS, ROUTE, mistake, 1.0)
    assert found.detected
    assert 1e6 < found.share < np.inf, "a text that cannot run is no mistake"
    assert not seen(places["hexapod"], FORMULAS, ROUTE, mistake, 0.0).detected


def test_a_symmetric_machine_hides_mistakes(places: dict[str, Place]) -> None:
    """A platform that never turns, with equal moments of inertia, sees less than half of them."""
    seen_by = [m.name for m in MISTAKES if seen(places["tsai2000"], FORMULAS, ROUTE, m, 1.0).detected]
    assert 0 < len(seen_by) < len(MISTAKES) / 2


def test_four_codes_and_their_mistakes() -> None:
    assert len({m.code for m in MISTAKES}) == 4
    assert len({m.name for m in MISTAKES}) == len(MISTAKES)


def test_a_mistake_whose_text_is_gone_is_an_error(places: dict[str, Place]) -> None:
    gone = replace(MISTAKES[0], changes=(("no such text", "another"),))
    with pytest.raises(ValueError, match="got 0 times 'no such text', expected 1"):
        seen(places["hexapod"], FORMULAS, ROUTE, gone, 1.0)


def test_a_mistake_that_changes_nothing_is_not_caught(places: dict[str, Place]) -> None:
    right = seen(places["hexapod"], FORMULAS, ROUTE, Nothing(), 0.0)
    null = Mistake("null", "nobody", "nothing is wrong", "dot", (("a[0] * b[0]", "b[0] * a[0]"),))
    found = seen(places["hexapod"], FORMULAS, ROUTE, null, 1.0)
    assert not found.detected
    assert found.digest == right.digest
