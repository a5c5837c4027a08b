"""Arithmetic expressions of a config: parsed to a tree of operations on arrays.

An expression such as ``x*(r - z) - y`` has numbers, names, ``+ - * / **``, parentheses and the functions
of `FUNCTIONS`. It is never run as Python. Values are computed with `trackbench.core.elementary`, so they
have the same bytes on every machine.
"""

import ast
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from operator import itemgetter
from typing import TypeAlias

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.elementary import arctan2, cos_sin, exp, log, power

Quantity: TypeAlias = Array | float
Value: TypeAlias = Quantity | tuple[Array, Array]
"""A value of a node; a tuple for the cosine and sine of an angle."""
MOST_CHARACTERS = 1000


class ExpressionError(ValueError):
    """A mistake in an expression, in one line with its column."""


@dataclass(frozen=True, slots=True, eq=False)
class Node:
    """A node of the tree: a number, the name of a variable, or an operation on other nodes."""

    operation: str
    arguments: tuple["Node", ...] = ()
    value: float = 0.0
    """the number, if the operation is ``number``"""
    name: str = ""
    """the variable, if the operation is ``name``"""


def _tangent(u: Quantity) -> Quantity:
    c, s = cos_sin(u)
    return s / c


def _angle(y: Quantity, x: Quantity) -> Quantity:
    return arctan2(*np.broadcast_arrays(y, x))


def _power(x: Quantity, y: Quantity) -> Quantity:
    """Compute ``x^y``: by multiplication for small whole y, a root for 1/2, else ``e^(y log x)``.

    A negative whole power is the reciprocal of the positive one.
    """
    if isinstance(y, np.ndarray):
        return power(x, y)
    if y == 2.0:
        return np.square(x)
    if y == 0.5:
        return np.sqrt(x)
    if y < 0.0 and float(y).is_integer():
        return 1.0 / power(x, -y)
    return power(x, y)


def _not_above(a: Quantity, b: Quantity) -> Quantity:
    return np.less_equal(a, b) * 1.0


Operation: TypeAlias = Callable[..., Value]
# Operations on values. The first group can write its result into memory that is no longer needed.
UFUNCS: dict[str, Operation] = {
    "+": np.add,
    "-": np.subtract,
    "*": np.multiply,
    "/": np.divide,
    "negative": np.negative,
    "sqrt": np.sqrt,
    "abs": np.abs,
    "min": np.minimum,
    "max": np.maximum,
    "sign": np.sign,
}
OPERATIONS: dict[str, Operation] = {
    **UFUNCS,
    "**": _power,
    "exp": exp,
    "log": log,
    "tan": _tangent,
    "atan2": _angle,
    "cos and sin": cos_sin,
    "first": itemgetter(0),
    "second": itemgetter(1),
    "not above": _not_above,
}
FUNCTIONS = {
    "sin": 1, "cos": 1, "tan": 1, "exp": 1, "log": 1, "sqrt": 1, "abs": 1, "atan2": 2, "min": 2, "max": 2
}  # fmt: skip
"""Functions of an expression, with their number of arguments."""
RESERVED_NAMES = ("k", "t", "T", "pi", *FUNCTIONS)
"""Names that users cannot give to components, parameters, inputs and parts of expressions."""

_BINARY: dict[type[ast.operator], str] = {
    ast.Add: "+",
    ast.Sub: "-",
    ast.Mult: "*",
    ast.Div: "/",
    ast.Pow: "**",
}


def parse(text: str | float, names: Mapping[str, Node]) -> Node:
    """Parse an expression of numbers, names, and pi.

    Parameters
    ----------
    text : str or float
        Expression.
    names : mapping of str to Node
        Nodes by name, each a `variable`, a `number` or a part.

    Returns
    -------
    Node
        Root of the expression's tree.

    Raises
    ------
    ExpressionError
        For whatever is not arithmetic of these names. Its message has the column.
    """
    text = str(text)
    if len(text) > MOST_CHARACTERS:
        raise ExpressionError(f"longer than {MOST_CHARACTERS} characters: name parts of it")
    try:
        tree = ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        column = error.offset if isinstance(error, SyntaxError) and error.offset else 1
        raise ExpressionError(f"column {column}: this is not an arithmetic expression") from None
    try:
        return _Parser({"pi": number(math.pi)} | dict(names)).node(tree)
    except RecursionError:
        raise ExpressionError("nested too deeply: name parts of it") from None


@dataclass(frozen=True)
class _Parser:
    """Translation of Python's syntax tree; what has no meaning here is refused."""

    names: Mapping[str, Node]

    def node(self, tree: ast.expr) -> Node:
        """Translate a tree to its node; raises ExpressionError."""
        node = self._translate(tree)
        if node.operation == "number" and not math.isfinite(node.value):
            raise _mistake(tree, "this has no finite value")
        return node

    def _translate(self, tree: ast.expr) -> Node:
        """Translate a tree to its node, which may be an infinite number; raises ExpressionError."""
        match tree:
            case ast.Constant(value=bool()):
                raise _mistake(tree, "a truth value is no number")
            case ast.Constant(value=int() | float() as value):
                return number(_as_float(tree, value))
            case ast.Name(id=name):
                return self._name(tree, name)
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return operate("negative", self.node(operand))
            case ast.UnaryOp(op=ast.UAdd(), operand=operand):
                return self.node(operand)
            case ast.BinOp(op=ast.BitXor()):
                raise _mistake(tree.right, "write a power as x**2, not as x^2")
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _BINARY:
                return operate(_BINARY[type(op)], self.node(left), self.node(right))
            case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]):
                return self._call(tree, name, arguments)
        raise _mistake(tree, "only numbers, names, + - * / ** ( ) and functions make an expression")

    def _name(self, tree: ast.expr, name: str) -> Node:
        """Return the node of a name; raises ExpressionError at ``tree`` if it is unknown."""
        if name in self.names:
            return self.names[name]
        if name in FUNCTIONS:
            raise _mistake(tree, f"{name} is a function: write {name}(...)")
        known = ", ".join(sorted(self.names))
        message = f"unknown name {name!r}; known: {known}"
        if name in ("T", "t", "dt", "time") and "k" in self.names:
            way_to_name_T = "" if "T" in self.names else " with `parameters: {T: 2}`"
            message += f"; at equal intervals the time is k * T{way_to_name_T}"
        raise _mistake(tree, message)

    def _call(self, tree: ast.expr, name: str, arguments: Sequence[ast.expr]) -> Node:
        """Return the node of a call of function ``name``; raises ExpressionError at ``tree``."""
        if name not in FUNCTIONS:
            raise _mistake(tree, f"unknown function {name!r}; known: {', '.join(FUNCTIONS)}")
        nodes = [self.node(argument) for argument in arguments]
        if name in ("min", "max") and len(nodes) > 2:
            # min(a, b, c) = min(min(a, b), c)
            node = nodes[0]
            for other in nodes[1:]:
                node = operate(name, node, other)
            return node
        if len(nodes) != FUNCTIONS[name]:
            n = FUNCTIONS[name]
            words = f"{name} has {n} argument{'s' * (n > 1)}, not {len(nodes)}"
            raise _mistake(tree, words)
        return operate(name, *nodes)


def _mistake(tree: ast.expr, message: str) -> ExpressionError:
    """Return an error with this message at the column where the tree begins."""
    return ExpressionError(f"column {tree.col_offset + 1}: {message}")


def _as_float(tree: ast.expr, value: float) -> float:
    """Return the value as a float; raises ExpressionError at ``tree`` if it is too large."""
    try:
        return float(value)
    except OverflowError:
        raise _mistake(tree, "this number is too large") from None


def number(value: float) -> Node:
    """Make the node of a number."""
    return Node("number", value=value)


def variable(name: str) -> Node:
    """Make the node of a variable."""
    return Node("name", name=name)


def is_constant(node: Node) -> bool:
    """Test whether a node is a number."""
    return node.operation == "number"


ZERO = number(0.0)
ONE = number(1.0)
TWO = number(2.0)


def operate(operation: str, *arguments: Node) -> Node:
    """Make the node of an operation.

    Parameters
    ----------
    operation : str
        One of `OPERATIONS`, or sin or cos.
    *arguments : Node
        Arguments of the operation.

    Returns
    -------
    Node
        The operation. If all arguments are numbers, it is computed, and the node is that of its value.
    """
    if operation in ("sin", "cos"):
        # Both come from one evaluation.
        pair = operate("cos and sin", *arguments)
        if pair.operation == "number pair":
            cosine, sine = pair.arguments
            return cosine if operation == "cos" else sine
        return Node("first" if operation == "cos" else "second", (pair,))
    if all(map(is_constant, arguments)):
        with np.errstate(all="ignore"):
            value = OPERATIONS[operation](*(a.value for a in arguments))
        if isinstance(value, tuple):
            return Node("number pair", tuple(number(float(v)) for v in value))
        return number(float(value))
    return Node(operation, arguments)


def in_order(nodes: Iterable[Node]) -> list[Node]:
    """List these nodes and all in them, each once and after its arguments, of a tree of any depth.

    Parameters
    ----------
    nodes : iterable of Node
        Roots of the trees.

    Returns
    -------
    list of Node
        All nodes of the trees.
    """
    ordered: dict[int, Node] = {}
    waiting = list(nodes)[::-1]
    while waiting:
        missing = [a for a in waiting[-1].arguments if id(a) not in ordered]
        if missing:
            waiting += missing[::-1]
        else:
            node = waiting.pop()
            ordered.setdefault(id(node), node)
    return list(ordered.values())
