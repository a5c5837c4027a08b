"""Derivatives of arithmetic expressions: sums and products without the terms that are zero."""

from trackbench.models.expression_trees import (
    ONE,
    TWO,
    ZERO,
    Node,
    in_order,
    is_constant,
    number,
    operate,
)


def _is_number(node: Node, value: float) -> bool:
    """Test whether a node is the number ``value``."""
    return is_constant(node) and node.value == value


def _sum(a: Node, b: Node) -> Node:
    """Return a node of the value ``a + b``, in which a zero is left out."""
    if _is_number(a, 0.0):
        return b
    if _is_number(b, 0.0):
        return a
    return operate("+", a, b)


def _difference(a: Node, b: Node) -> Node:
    """Return a node of the value ``a - b``, in which a zero is left out."""
    if _is_number(b, 0.0):
        # 0 - 0 is the second zero.
        return b if _is_number(a, 0.0) else a
    if _is_number(a, 0.0):
        return operate("negative", b)
    return operate("-", a, b)


def _product(a: Node, b: Node) -> Node:
    """Return a node of the value ``a b``, without a factor of one; ZERO if a factor is zero."""
    if _is_number(a, 0.0) or _is_number(b, 0.0):
        return ZERO
    if _is_number(a, 1.0):
        return b
    if _is_number(b, 1.0):
        return a
    return operate("*", a, b)


def _quotient(a: Node, b: Node) -> Node:
    """Return a node of the value ``a / b``; ZERO if a is zero."""
    return ZERO if _is_number(a, 0.0) else operate("/", a, b)


def derivative(node: Node, name: str) -> Node:
    """Differentiate an expression by a variable.

    Where `abs`, `min` or `max` have a kink it is the derivative of one side.

    Parameters
    ----------
    node : Node
        Expression.
    name : str
        Name of the variable.

    Returns
    -------
    Node
        Derivative. It is `ZERO` for an expression without the variable.
    """
    derivatives: dict[int, Node] = {}

    def differentiate(inner: Node) -> Node:
        """Return the derivative of a node within the expression, by those of its arguments."""
        if not inner.arguments:
            return ONE if inner.name == name else ZERO
        # An operation "cos and sin" computes both of u at once, as a pair. The operations "first" and
        # "second" take the cosine and the sine out of it.
        if inner.operation in ("first", "second"):
            # (cos u)' = -sin u u', (sin u)' = cos u u'
            (pair,) = inner.arguments
            du = derivatives[id(pair.arguments[0])]
            if inner.operation == "first":
                return _difference(ZERO, _product(Node("second", (pair,)), du))
            return _product(Node("first", (pair,)), du)
        u = inner.arguments[0]
        du = derivatives[id(u)]
        if len(inner.arguments) == 1:
            return _unary_derivative(inner, u, du)
        _, v = inner.arguments
        return _binary_derivative(inner, u, v, du, derivatives[id(v)])

    for inner in in_order([node]):
        derivatives[id(inner)] = differentiate(inner)
    return derivatives[id(node)]


def _unary_derivative(node: Node, u: Node, du: Node) -> Node:
    """Differentiate a function of u, whose derivative is du.

    Cosine and sine are not among them. `derivative` handles these: they are the operations "first" and
    "second", which take one of both out of the pair that the operation "cos and sin" computes.
    """
    match node.operation:
        case "negative":
            return _difference(ZERO, du)
        case "exp":
            return _product(node, du)
        case "log":
            return _quotient(du, u)
        case "sqrt":
            return _quotient(du, _product(TWO, node))
        case "tan":
            return _product(_sum(ONE, operate("**", node, TWO)), du)
        case "abs":
            return _product(operate("sign", u), du)
        case _:
            # The operation is "sign", whose derivative is zero, or "cos and sin": no node uses the
            # derivative of a pair.
            return ZERO


def _binary_derivative(node: Node, u: Node, v: Node, du: Node, dv: Node) -> Node:
    """Differentiate an operation of u and v, whose derivatives are du and dv."""
    match node.operation:
        case "+":
            return _sum(du, dv)
        case "-":
            return _difference(du, dv)
        case "*":
            return _sum(_product(du, v), _product(u, dv))
        case "/":
            # (u / v)' = (u' - (u / v) v') / v
            return _quotient(_difference(du, _product(node, dv)), v)
        case "atan2":
            # atan2(u, v)' = (u' v - u v') / (u^2 + v^2)
            square = operate("+", operate("**", u, TWO), operate("**", v, TWO))
            return _quotient(_difference(_product(du, v), _product(u, dv)), square)
        case "min" | "max":
            # The derivative of whichever is smaller, or larger. `not above` is 1 where its first
            # argument is not above the second one, and 0 elsewhere.
            if node.operation == "min":
                takes_u = operate("not above", u, v)
            else:
                takes_u = operate("not above", v, u)
            return _sum(_product(takes_u, du), _product(operate("-", ONE, takes_u), dv))
        case "**" if v.operation == "number":
            if _is_number(v, 2.0):
                return _product(_product(TWO, u), du)
            return _product(_product(v, operate("**", u, number(v.value - 1.0))), du)
        case "**" if _is_number(dv, 0.0):
            # The exponent is a number of the step, such as k: (u^v)' = v u^(v - 1) u'. For v = 0 the
            # factor u^(v - 1) becomes u^0, since 0 times 0^-1 is no number.
            is_zero = operate("*", operate("not above", v, ZERO), operate("not above", ZERO, v))
            exponent = operate("+", operate("-", v, ONE), is_zero)
            lower = operate("**", u, exponent)
            return _product(_product(v, lower), du)
        case "**":
            # (u^v)' = u^v (v' log u + v u' / u)
            slope = _sum(_product(dv, operate("log", u)), _quotient(_product(v, du), u))
            return _product(node, slope)
        case _:
            return ZERO  # the operation is "not above", which is constant but for a jump
