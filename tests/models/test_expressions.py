"""Expressions against Python's own arithmetic, their derivatives against differences, hostile input."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trackbench.models.angle_components import turns_at_cut
from trackbench.models.compiled_expressions import Program
from trackbench.models.expression_derivatives import derivative
from trackbench.models.expression_trees import (
    FUNCTIONS,
    OPERATIONS,
    ExpressionError,
    Node,
    in_order,
    number,
    operate,
    parse,
    variable,
)

NAMES = {name: variable(name) for name in ("x", "y", "z", "k")} | {"r": number(28.0)}
X = np.random.default_rng(4).normal(size=(3, 200))
NUMPY: dict[str, Any] = {
    **{name: getattr(np, name) for name in FUNCTIONS if hasattr(np, name)},
    **{"atan2": np.arctan2, "min": np.minimum, "max": np.maximum, "pi": np.pi, "r": 28.0, "k": 3},
}
EXPRESSIONS = [
    "x*(r - z) - y",
    "sin(x)*cos(x) + tan(y/2)",
    "exp(-x**2/2)*log(abs(y) + 1)",
    "atan2(y, x) - atan2(x, -y)",
    "sqrt(x**2 + y**2)/(1 + z**2)",
    "min(x, y)*max(z, 2*x)",
    "x**3 - (x**2 + 1)**-2",
    "(abs(x) + 1)**y",
    "x/2 + 25*x/(1 + x**2) + 8*cos(1.2*k)",
    "-x**2 + +y",
    "2**x",
    "(x**2 + 1)**1.5 + (x**2)**0.5",
    "pi*x - 3e-1",
    "cos(0)*x + sin(pi/2)",
    "abs(x - y)",
]
HOSTILE = [
    "",
    " ",
    "__import__('os')",
    "x.__class__",
    "x.real",
    "x[0]",
    "[x]",
    "{x}",
    "{'x': 1}",
    "(x, y)",
    "x, y",
    "x if y else z",
    "lambda: 1",
    "(lambda: 1)()",
    "[a for a in x]",
    "x < y",
    "not x",
    "x and y",
    "~x",
    "x // y",
    "x % y",
    "x @ y",
    "x << 2",
    "x ^ 2",
    "x := 1",
    "x = 1",
    "x; y",
    "x\ny",
    "#x",
    "'x'",
    "b'x'",
    'f"{x}"',
    "True",
    "None",
    "...",
    "1j",
    "nan",
    "inf",
    "1e999",
    "10**400",
    "9**9**9**9",
    "1/0",
    "log(0)",
    "sqrt(-1)",
    "9" * 500,
    "-" * 900 + "x",
    "(" * 300 + "x" + ")" * 300,
    "x" * 1001,
    "eval('1')",
    "exec",
    "print",
    "open('a')",
    "sin",
    "sin(sin)",
    "sin()",
    "sin(x, y)",
    "sin(x=1)",
    "sin(*x)",
    "f(**x)",
    "atan2(x)",
    "min(x)",
    "u",
    "await x",
    "yield x",
    "(x",
    "x y",
    "x +",
    "\x00",
    "x\u2028y",
]


def values(node: Node, x: np.ndarray) -> np.ndarray:
    (value,) = Program([node], ("x", "y", "z"), ("k",))(*x, 3.0)
    return np.broadcast_to(np.asarray(value), x.shape[1:])


@pytest.mark.parametrize("text", EXPRESSIONS)
def test_values_are_those_of_numpy(text: str) -> None:
    expected = eval(text, {}, NUMPY | dict(zip("xyz", X, strict=True)))
    np.testing.assert_allclose(values(parse(text, NAMES), X), expected, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("text", EXPRESSIONS)
@pytest.mark.parametrize("i", range(3))
def test_derivatives_are_the_limits_of_differences(text: str, i: int) -> None:
    node, h = parse(text, NAMES), 1e-6 * np.eye(3)[i][:, None]
    expected = (values(node, X + h) - values(node, X - h)) / 2e-6
    np.testing.assert_allclose(
        values(derivative(node, "xyz"[i]), X), expected, rtol=1e-4, atol=1e-6
    )


@pytest.mark.parametrize("text", HOSTILE)
def test_what_is_no_arithmetic_is_refused_in_a_line(text: str) -> None:
    with pytest.raises(ExpressionError) as raised:
        parse(text, NAMES)
    assert len(str(raised.value).splitlines()) == 1


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("x + u", "column 5: unknown name 'u'; known: k, pi, r, x, y, z"),
        (
            "x * t",
            "column 5: unknown name 't'; known: k, pi, r, x, y, z; at equal intervals the time is k * T "
            "with `parameters: {T: 2}`",
        ),
        ("1 + sinh(x)", "column 5: unknown function 'sinh'"),
        ("2*(x", "column 3: this is not an arithmetic expression"),
        ("y*x^2", "column 5: write a power as x**2"),
        ("y + cos(x, y)", "column 5: cos has 1 argument, not 2"),
        ("x*10**400", "column 3: this has no finite value"),
    ],
)
def test_a_mistake_has_its_column(text: str, what: str) -> None:
    with pytest.raises(ExpressionError) as raised:
        parse(text, NAMES)
    assert what in str(raised.value)


def test_equal_parts_are_computed_once_and_memory_is_reused_without_harm() -> None:
    """The outputs, one of them a part of another, and the variables keep their values."""
    texts = ("x*y + z", "sin(x*y + z) + cos(x*y + z)", "(x*y + z)*(x*y + z) - x*y", "x")
    program = Program([parse(text, NAMES) for text in texts], ("x", "y", "z"), ("k",))
    before = X.copy()
    x, y, z = X
    u = x * y + z
    for value, expected in zip(
        program(*X, 3.0), (u, np.sin(u) + np.cos(u), u * u - x * y, x), strict=True
    ):
        np.testing.assert_allclose(value, expected, rtol=1e-12, atol=1e-14)
    np.testing.assert_array_equal(X, before)
    assert len(program._instructions) == 8  # * + cos-and-sin, its two members, +, * -


EXPONENTS = ("0", "1", "1.0", "2", "3", "16", "-1", "-2", "0.5", "n", "k")
"""Of powers: numbers, the parameter n, which is 1, and the number of the step."""
TREES = st.recursive(
    st.sampled_from(["x", "y", "z", "0.5", "k", "n"]),
    lambda inner: st.one_of(
        st.tuples(st.sampled_from(["({} + {})", "({} - {})", "({}*{})", "({}/{})"]), inner, inner),
        st.tuples(st.sampled_from([f"({{}})**{e}" for e in EXPONENTS]), inner),
        st.tuples(st.sampled_from(["min({}, {})", "max({}, {})", "atan2({}, {})"]), inner, inner),
        st.tuples(st.sampled_from(["sin({})", "abs({})", "sqrt({})", "exp({})", "-({})"]), inner),
    ).map(lambda tree: tree[0].format(*tree[1:])),
    max_leaves=8,
)


def plain(node: Node, variables: dict[str, Any]) -> Any:
    """Return a node's value without shared parts and reused memory."""
    if not node.arguments:
        return variables[node.name] if node.name else node.value
    parts = [plain(a, variables) for a in node.arguments]
    return OPERATIONS[node.operation](*(np.copy(a) if np.ndim(a) else a for a in parts))


@settings(max_examples=400, deadline=None)
@given(st.lists(TREES, min_size=1, max_size=3), st.sampled_from([1, 2, 3]))
def test_no_expression_changes_its_inputs(texts: list[str], k: int) -> None:
    """Random trees of read-only inputs have the values of a tree without reuse, bit for bit."""
    names = NAMES | {"n": number(1.0)}
    try:
        nodes = [parse(text, names) for text in texts]
    except ExpressionError:
        return  # a part without a finite value
    x = X.copy()
    x.flags.writeable = False
    with np.errstate(all="ignore"):
        got = Program(nodes, ("x", "y", "z"), ("k",))(*x, k)
        expected = [plain(node, dict(zip("xyz", x, strict=True)) | {"k": k}) for node in nodes]
    np.testing.assert_array_equal(x, X)
    for value, plainly in zip(got, expected, strict=True):
        np.testing.assert_array_equal(value, plainly)


def test_a_chain_of_parts_may_be_longer_than_the_stack() -> None:
    """900 parts, each the sine of the one above, against a program of a few lines."""
    names = dict(NAMES)
    node = parse("0.9*x", names)
    for i in range(900):
        names[f"a{i}"] = node
        node = parse(f"sin(a{i})", names)
    slope = derivative(node, "x")
    value, first, second = X[0] * 0.9, np.full(200, 0.9), np.zeros(200)
    for _ in range(900):
        first, second = np.cos(value) * first, np.cos(value) * second - np.sin(value) * first**2
        value = np.sin(value)
    np.testing.assert_allclose(values(node, X), value, rtol=1e-9)
    np.testing.assert_allclose(values(slope, X), first, rtol=1e-9)
    np.testing.assert_allclose(values(derivative(slope, "x"), X), second, rtol=1e-8, atol=1e-12)
    doubled = parse("x", names)
    for _ in range(60):  # shared parts: 2^60 paths
        doubled = operate("+", doubled, doubled)
    assert turns_at_cut(doubled) == 0.0
    assert len(in_order([doubled])) == 61


@pytest.mark.parametrize(
    ("text", "turns"),
    [
        ("atan2(y, x)", 1.0),
        ("atan2(y, x) - z", 1.0),
        ("2 * atan2(y, x) / 4", 0.5),
        ("1 / atan2(y, x)", 0.0),
        ("z / atan2(y, x)", 0.0),
        ("atan2(z, sqrt(x**2 + y**2))", 0.0),
    ],
)
def test_only_an_angle_times_a_number_jumps_by_turns(text: str, turns: float) -> None:
    assert turns_at_cut(parse(text, NAMES)) == turns


def test_nested_functions_have_a_value_or_a_line() -> None:
    text = "sin(" * 150 + "x" + ")" * 150
    value = X[0]
    for _ in range(150):
        value = np.sin(value)
    np.testing.assert_allclose(values(parse(text, NAMES), X), value, rtol=1e-10)


@pytest.mark.parametrize("k", [1, 2, 16, 17, 18, 41])
@pytest.mark.parametrize(
    "text", ["(-1)**k", "(-0.5)**k", "x**k", "x**17", "x**(-17)", "(y - 3)**t"]
)
def test_whole_powers_of_negative_numbers(text: str, k: int) -> None:
    """Values, and derivatives by x, against Python's own powers of single numbers."""
    names = NAMES | {"t": variable("t")}
    node = parse(text, names)
    x = -np.abs(X) - 0.2
    t = 2.0 * k
    programs = [Program([n], ("x", "y", "z"), ("k", "t")) for n in (node, derivative(node, "x"))]
    value, slope = (np.broadcast_to(program(*x, k, t)[0], x[0].shape) for program in programs)
    for i in range(0, x.shape[1], 37):
        a, b = float(x[0, i]), float(x[1, i])
        scope = {"x": a, "y": b, "k": k, "t": t}
        assert value[i] == pytest.approx(eval(text, scope), rel=1e-11)
        exponent = {"x**k": k, "x**17": 17, "x**(-17)": -17}.get(text, 0)
        assert slope[i] == pytest.approx(exponent * a ** (exponent - 1.0), rel=1e-11)


def test_the_derivative_of_the_power_zero_of_zero_is_zero() -> None:
    """It is v u^(v - 1) u', in which 0 times 0^-1 is no number."""
    node = derivative(parse("x**(k - 1) + y", NAMES), "x")
    program = Program([node], ("x", "y"), ("k",))
    x = np.array([0.0, 2.0])
    slopes = [np.broadcast_to(program(x, x, k)[0], x.shape).tolist() for k in (1.0, 2.0, 3.0)]
    assert slopes == [[0.0, 0.0], [1.0, 1.0], [0.0, 4.0]]
