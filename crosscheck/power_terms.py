"""Faults in the formulas: every term and every sign of `analytic.stewart`, found in its text, each with a factor.

A term is

- an operand of a sum or difference, of scalars (``+``, ``-``) or of vectors (``add``, ``sub``);
- what stands behind a minus sign;
- a product, quotient, scalar or vector product that is a whole value: assigned, returned, or handed on;
- a bare component of a vector beside components that are worked out, as ``s`` in ``(co * c, s, -so * c)``.

Indices and conditions are none, and classes hold none: they are types.  The functions are changed in place, so that
whoever holds one of them runs the changed one; without a fault every operation is the one of the text.
"""

from __future__ import annotations

import ast
import contextlib
import functools
import inspect
import re
from collections.abc import Callable, Iterator
from types import CodeType, ModuleType
from typing import Any, NamedTuple

import numpy as np

from ..analytic import backends, stewart

SUMS = ("add", "sub")
PRODUCTS = ("mul", "dot", "cross", "apply", "apply_transposed")
"""Functions of `stewart` that add vectors, and that multiply: what they are given are factors."""

_MARK = "_term"


class Site(NamedTuple):
    """A term: its place among all, the function that holds it, its line, the equation named there, and its text."""

    number: int
    function: str
    line: int
    equation: str
    text: str


def _sum(node: ast.AST) -> bool:
    """Whether an expression is a sum or a difference."""
    if isinstance(node, ast.BinOp):
        return isinstance(node.op, ast.Add | ast.Sub)
    return isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in SUMS


def _negative(node: ast.AST) -> bool:
    return isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub)


def _signed(node: ast.AST) -> bool:
    """Whether a minus sign leads: ``-a``, ``-a * b / c``."""
    while isinstance(node, ast.BinOp) and not _sum(node):
        node = node.left
    return _negative(node)


def _product(node: ast.AST) -> bool:
    if isinstance(node, ast.BinOp):
        return not _sum(node)
    return isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in PRODUCTS


class _Marker(ast.NodeTransformer):
    """Wraps every term of a function into a call of `_MARK` with its number."""

    def __init__(self, function: str, equations: dict[int, str], first: int) -> None:
        self.function, self.equations, self.first = function, equations, first
        self.found: list[Site] = []

    def _marked(self, node: ast.expr) -> ast.expr:
        inner = node.value if isinstance(node, ast.Starred) else node
        number = self.first + len(self.found)
        line = node.lineno
        self.found.append(Site(number, self.function, line, self.equations.get(line, ""), ast.unparse(node)))
        call = ast.Call(ast.Name(_MARK, ast.Load()), [ast.Constant(number), self._inside(inner)], [])
        return ast.Starred(call, ast.Load()) if isinstance(node, ast.Starred) else call

    def _inside(self, node: ast.expr) -> ast.expr:
        """An expression that is a term already, or a factor: its own terms alone."""
        if _sum(node) or _negative(node):
            return self.visit(node)
        if isinstance(node, ast.BinOp):
            node.left, node.right = self._inside(node.left), self._inside(node.right)
            return node
        if _product(node):
            assert isinstance(node, ast.Call)
            node.args = [self._inside(a) for a in node.args]
            return node
        return self.visit(node)

    def _operand(self, node: ast.expr, leads: bool) -> ast.expr:
        """An operand of a sum.  A leading sum is the same sum; behind a minus sign the term is marked already."""
        if (leads and _sum(node)) or _signed(node):
            return self._inside(node)
        return self._marked(node)

    def visit_BinOp(self, node: ast.BinOp) -> ast.expr:
        if _sum(node):
            node.left, node.right = self._operand(node.left, True), self._operand(node.right, False)
            return node
        return self._inside(node) if _signed(node) else self._marked(node)

    def visit_Call(self, node: ast.Call) -> ast.expr:
        if _sum(node):
            node.args = [self._operand(a, k == 0) for k, a in enumerate(node.args)]
            return node
        if _product(node):
            return self._marked(node)
        if isinstance(node.func, ast.Name) and node.func.id == "range":
            return node
        self.generic_visit(node)
        return node

    def visit_UnaryOp(self, node: ast.UnaryOp) -> ast.expr:
        if isinstance(node.op, ast.USub):
            node.operand = self._marked(node.operand)
        return node

    def visit_Tuple(self, node: ast.Tuple) -> ast.expr:
        worked_out = any(_product(e) or _sum(e) or _negative(e) for e in node.elts)
        bare = (ast.Name, ast.Attribute)
        if isinstance(node.ctx, ast.Load) and worked_out:
            node.elts = [self._marked(e) if isinstance(e, bare) else self.visit(e) for e in node.elts]
            return node
        self.generic_visit(node)
        return node

    def visit_Subscript(self, node: ast.Subscript) -> ast.expr:
        node.value = self.visit(node.value)
        return node

    def visit_Compare(self, node: ast.Compare) -> ast.expr:
        return node

    def visit_Raise(self, node: ast.Raise) -> ast.stmt:
        return node


class _Text(NamedTuple):
    """The terms of the formulas, and the code of every function with its terms marked."""

    sites: tuple[Site, ...]
    code: dict[str, CodeType]


def _equations(function: ast.FunctionDef, lines: list[str]) -> dict[int, str]:
    """Numbers of the equations by line: those in the comment behind a statement, else the first in the docstring."""
    numbers = re.compile(r"\(\d+\)(?:(?:-|, )\(\d+\))*")
    known = numbers.search(ast.get_docstring(function) or "")
    found: dict[int, str] = {}
    for node in ast.walk(function):
        if isinstance(node, ast.stmt) and node is not function:
            _, _, comment = lines[(node.end_lineno or node.lineno) - 1].partition("#")
            named = numbers.search(comment) or known
            name = named[0] if named else ""
            found |= dict.fromkeys(range(node.lineno, (node.end_lineno or node.lineno) + 1), name)
    return found


def code_of(module: ModuleType, function: ast.FunctionDef) -> CodeType:
    """Code of a changed function, as if it stood in its module."""
    tree = ast.fix_missing_locations(ast.Module([function], []))
    space = dict(vars(module))
    exec(compile(tree, inspect.getsourcefile(module) or module.__name__, "exec"), space)
    return space[function.name].__code__


@functools.cache
def _text() -> _Text:
    source = inspect.getsource(stewart)
    lines = source.splitlines()
    sites: list[Site] = []
    code: dict[str, CodeType] = {}
    for node in ast.parse(source).body:
        if isinstance(node, ast.FunctionDef):
            marker = _Marker(node.name, _equations(node, lines), len(sites))
            node.body = [marker.visit(statement) for statement in node.body]
            sites += marker.found
            if marker.found:
                code[node.name] = code_of(stewart, node)
    return _Text(tuple(sites), code)


def terms() -> tuple[Site, ...]:
    """Every term of the formulas."""
    return _text().sites


def times(factor: float, x: Any) -> Any:
    """A term times a number: a scalar, or vectors and their sequences component by component."""
    if isinstance(x, tuple | list):
        return tuple(times(factor, part) for part in x)
    if isinstance(x, Iterator):
        return (times(factor, part) for part in x)
    return factor * x


@contextlib.contextmanager
def swapped(module: ModuleType, code: dict[str, CodeType]) -> Iterator[None]:
    """Functions of a module with other code, in place; what is cached of them is forgotten before and after."""
    before = {name: getattr(module, name).__code__ for name in code}
    backends.forget()
    try:
        for name, new in code.items():
            getattr(module, name).__code__ = new
        yield
    finally:
        for name, old in before.items():
            getattr(module, name).__code__ = old
        backends.forget()


@contextlib.contextmanager
def faulty(number: int, d: float) -> Iterator[None]:
    """The formulas with one term times 1 + d; zero leaves every operation as it is."""

    def term(k: int, x: Any) -> Any:
        return times(1.0 + d, x) if k == number and d else x

    function = terms()[number].function
    with _marked(term, {function: _text().code[function]}):
        yield


@contextlib.contextmanager
def recorded() -> Iterator[dict[int, float]]:
    """The formulas as they are, and the largest size of every term worked out; infinite of what is no number."""
    found: dict[int, float] = {}

    def term(k: int, x: Any) -> Any:
        if isinstance(x, Iterator):
            x = list(x)
        found[k] = max(found.get(k, 0.0), size(x))
        return x

    with _marked(term, _text().code):
        yield found


def size(x: Any) -> float:
    """The largest number of a term; infinite if it is none yet."""
    if isinstance(x, tuple | list):
        return max(map(size, x), default=0.0)
    return float(np.max(np.abs(x))) if isinstance(x, float | int | np.ndarray) else np.inf


@contextlib.contextmanager
def _marked(term: Callable[[int, Any], Any], code: dict[str, CodeType]) -> Iterator[None]:
    """Functions with their terms marked, and what a mark does."""
    with swapped(stewart, code):
        setattr(stewart, _MARK, term)
        try:
            yield
        finally:
            delattr(stewart, _MARK)
