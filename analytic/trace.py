"""A kind of number that remembers how it was made: run on it, the formulas become a list of operations.

Equal operations are one, numbers that do not move are worked out at once, and a divisor that serves twice is inverted
once.  The list is what a compiled back end is written from, and what operations are counted on.
"""

from __future__ import annotations

import math
import operator
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

_FOLD = {"+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv}


FIXED = ("number", "parameter")
"""Names of what does not move."""


class Operation(NamedTuple):
    """An operation on earlier ones, by their place in the list, or a leaf.

    ``name``: ``+ - * /``, ``neg sqrt abs``, ``larger`` (a > b), ``select`` (condition, a, b), ``number``, ``parameter``
    or ``input``.  ``value``: of a number or a parameter; of an input its place, as a float.
    """

    name: str
    operands: tuple[int, ...] = ()
    value: float = math.nan


class Traced:
    """One number of a trace; arithmetic with others or with floats adds operations."""

    __slots__ = ("place", "trace")

    def __init__(self, trace: Trace, place: int) -> None:
        self.trace, self.place = trace, place

    def __add__(self, other: Any) -> Traced:
        return self.trace.binary("+", self, other)

    def __radd__(self, other: Any) -> Traced:
        return self.trace.binary("+", other, self)

    def __sub__(self, other: Any) -> Traced:
        return self.trace.binary("-", self, other)

    def __rsub__(self, other: Any) -> Traced:
        return self.trace.binary("-", other, self)

    def __mul__(self, other: Any) -> Traced:
        return self.trace.binary("*", self, other)

    def __rmul__(self, other: Any) -> Traced:
        return self.trace.binary("*", other, self)

    def __truediv__(self, other: Any) -> Traced:
        return self.trace.binary("/", self, other)

    def __rtruediv__(self, other: Any) -> Traced:
        return self.trace.binary("/", other, self)

    def __neg__(self) -> Traced:
        return self.trace.negative(self)

    def __abs__(self) -> Traced:
        return self.trace._new("abs", (self.place,))

    def __float__(self) -> float:
        """Value of a number that does not move. Raises TypeError for others."""
        value = self.trace.fixed(self)
        if value is None:
            raise TypeError("a traced number that moves has no value: the text must not branch on it")
        return value

    def __gt__(self, other: float) -> bool:
        """Decided while tracing: only what does not move can be compared."""
        return float(self) > other


class Trace:
    """Operations in the order in which they were first needed."""

    def __init__(self) -> None:
        self.operations: list[Operation] = []
        self._places: dict[Operation, int] = {}

    def _new(self, name: str, operands: tuple[int, ...] = (), value: float = 0.0) -> Traced:
        operation = Operation(name, operands, value)
        place = self._places.setdefault(operation, len(self.operations))
        if place == len(self.operations):
            self.operations.append(operation)
        return Traced(self, place)

    def input(self, number: int) -> Traced:
        """Number of the motion, by its place."""
        return self._new("input", value=float(number))

    def parameter(self, value: float) -> Traced:
        """A number that does not move and may be another one for another machine; zero is left out for good."""
        return self._new("parameter" if value else "number", value=float(value) + 0.0)

    def lift(self, x: Any) -> Traced:
        """A float as a number of the trace."""
        return x if isinstance(x, Traced) else self._new("number", value=float(x) + 0.0)

    def fixed(self, x: Traced) -> float | None:
        """Value of a number that does not move."""
        operation = self.operations[x.place]
        return operation.value if operation.name in FIXED else None

    def negative(self, x: Traced) -> Traced:
        """The number -x; a sign moves outwards, where a sum or difference takes it up."""
        operation = self.operations[x.place]
        if (value := self.fixed(x)) is not None:
            return self._new(operation.name, value=-value)
        if operation.name == "neg":
            return Traced(self, operation.operands[0])
        return self._new("neg", (x.place,))

    def _unsigned(self, x: Traced) -> tuple[bool, Traced]:
        operation = self.operations[x.place]
        return (True, Traced(self, operation.operands[0])) if operation.name == "neg" else (False, x)

    def binary(self, name: str, a: Any, b: Any) -> Traced:
        """The sum, difference, product or quotient, unless it is known to be another number."""
        a, b = self.lift(a), self.lift(b)
        x, y = self.fixed(a), self.fixed(b)
        if x is not None and y is not None:
            names = {self.operations[a.place].name, self.operations[b.place].name}
            value = _FOLD[name](x, y)
            return self.parameter(value) if "parameter" in names else self.lift(value)
        if name in "+-":
            minus, b = self._unsigned(b)
            if y == 0.0:
                return a
            if x == 0.0:
                return b if minus == (name == "-") else self.negative(b)
            if minus == (name == "-"):
                signed, a = self._unsigned(a)
                return self._difference(b, a) if signed else self._sorted("+", a, b)
            return self._difference(a, b)
        (minus_a, a), (minus_b, b) = self._unsigned(a), self._unsigned(b)
        if x == 0.0 or (y == 0.0 and name == "*"):
            return self.lift(0.0)
        out = a if y == 1.0 else b if x == 1.0 and name == "*" else None
        if out is None:
            out = self._sorted("*", a, b) if name == "*" else self._new("/", (a.place, b.place))
        return self.negative(out) if minus_a != minus_b else out

    def _difference(self, a: Traced, b: Traced) -> Traced:
        """The difference a - b, as -(b - a) if that is known."""
        if (known := Operation("-", (b.place, a.place), 0.0)) in self._places:
            return self.negative(Traced(self, self._places[known]))
        return self._new("-", (a.place, b.place))

    def _sorted(self, name: str, a: Traced, b: Traced) -> Traced:
        """One operation, whichever operand comes first."""
        return self._new(name, (min(a.place, b.place), max(a.place, b.place)))

    def sqrt(self, x: Traced) -> Traced:
        """Square root."""
        return self._new("sqrt", (x.place,))

    def ordered(self, j: int, upper: list[Any], lower: list[Any]) -> tuple[list[Any], list[Any]]:
        """Two rows, exchanged where the second has the larger number in column j."""
        sizes = [abs(self.lift(row[j])) for row in (lower, upper)]
        exchange = self._new("larger", tuple(size.place for size in sizes))

        def choose(a: Any, b: Any) -> Traced:
            a, b = self.lift(a), self.lift(b)
            return a if a.place == b.place else self._new("select", (exchange.place, a.place, b.place))

        both = list(zip(upper[j:], lower[j:], strict=True))
        return [*upper[:j], *(choose(b, a) for a, b in both)], [*lower[:j], *(choose(a, b) for a, b in both)]


class Program(NamedTuple):
    """Operations, each on earlier ones, and the places of the results."""

    operations: list[Operation]
    results: list[int]

    @property
    def parameters(self) -> list[float]:
        """Values of the parameters, in the order of their operations."""
        return [op.value for op in self.operations if op.name == "parameter"]

    def counts(self) -> Counter[str]:
        """Operations by name, and ``flops``: sums, differences, products, quotients and square roots."""
        found = Counter(op.name for op in self.operations)
        found["flops"] = sum(found[name] for name in ("+", "-", "*", "/", "sqrt"))
        return found


def program(trace: Trace, results: Iterable[Any]) -> Program:
    """What the results need, with one inverse for each divisor that serves more than once."""
    places = [trace.lift(x).place for x in results]
    needed = _needed(trace.operations, places)
    divisors = Counter(op.operands[1] for k in needed if (op := trace.operations[k]).name == "/")
    out, at = Trace(), dict[int, Traced]()
    for k in needed:
        name, operands, value = trace.operations[k]
        if name == "/" and divisors[operands[1]] > 1:
            a, b = (at[i] for i in operands)
            at[k] = a * (1.0 / b)
        else:
            at[k] = out._new(name, tuple(at[i].place for i in operands), value)
    return _compact(out.operations, [at[k].place for k in places])


def _needed(operations: Sequence[Operation], places: Sequence[int]) -> list[int]:
    """Places of all that some results depend on, each after what it depends on and as late as that allows.

    Depth first: what belongs together stays together, and few numbers are kept in between.
    """
    order: dict[int, None] = {}
    for place in places:
        ahead = [place]
        while ahead:
            k = ahead[-1]
            missing = [i for i in operations[k].operands if i not in order]
            if k in order or not missing:
                order[ahead.pop()] = None
            else:
                ahead.extend(reversed(missing))
    return list(order)


def _compact(operations: Sequence[Operation], places: Sequence[int]) -> Program:
    """Only the operations that the results depend on."""
    kept = _needed(operations, places)
    new = {k: n for n, k in enumerate(kept)}
    return Program(
        [op._replace(operands=tuple(new[i] for i in op.operands)) for op in (operations[k] for k in kept)],
        [new[k] for k in places],
    )
