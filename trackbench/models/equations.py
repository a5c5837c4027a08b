"""Equations of a motion or sensor in a config: names and parts, checked and compiled."""

import keyword
from collections.abc import Mapping, Sequence
from typing import TypeAlias

from trackbench.field_types import Finite, InvalidKeyError
from trackbench.models.compiled_expressions import ArrayProgram
from trackbench.models.expression_trees import (
    RESERVED_NAMES,
    ExpressionError,
    Node,
    in_order,
    number,
    parse,
    variable,
)

MOST_LEVELS = 200
"""Operations within each other; a worker process cannot be sent much deeper trees."""

Term: TypeAlias = Finite | str
"""A number or an expression."""


class Equations:
    """Names that expressions may use, and the programs that are made of them.

    Parameters
    ----------
    components : sequence of str
        Components of the state.
    scalars : sequence of str
        Variables beside it: k, the number of the step, and t, the time in s.
    parameters : mapping of str to float
        Constants.
    parts : mapping of str to Term
        Parts of expressions, each of names that stand before it.
    T : float, optional
        Time between two steps, s, if it is a constant.
    inputs : sequence of str
        Known inputs, which are variables after the scalars.

    Raises
    ------
    InvalidKeyError
        For a name that is taken or is no word, and for a part that is mistaken.
    """

    def __init__(
        self,
        components: Sequence[str],
        scalars: Sequence[str],
        parameters: Mapping[str, float],
        parts: Mapping[str, Term],
        T: float | None = None,
        inputs: Sequence[str] = (),
    ) -> None:
        """Add the names of variables and constants, then those of ``parts`` (the key `where`).

        The parts come last and in order, as each may use the names before it. T is None if the time
        between steps is one of the ``scalars``, or if no expression may use it. ``scalars`` are names
        that are reserved, such as k. `_add` rejects these, and any that is taken, as names of the user.
        """
        self.components = tuple(components)
        self.scalars = (*scalars, *inputs)
        self.names: dict[str, Node] = {}
        for i, name in enumerate(components):
            self._add(name, variable(name), "components", i)
        self.names |= {name: variable(name) for name in scalars}
        if T is not None:
            self.names["T"] = number(T)
        for i, name in enumerate(inputs):
            self._add(name, variable(name), "input", i)
        for name, value in parameters.items():
            self._add(name, number(value), "parameters", name)
        for name, term in parts.items():
            self._add(name, self.parse(term, "where", name), "where", name)

    def _add(self, name: str, node: Node, *path: str | int) -> None:
        """Let expressions use ``name`` for ``node``; raises InvalidKeyError at the key ``path``."""
        if not name.isidentifier() or keyword.iskeyword(name):
            raise InvalidKeyError(f"{name!r} cannot be a name in an expression", *path)
        if name in self.names or name in RESERVED_NAMES:
            raise InvalidKeyError(f"the name {name!r} is taken", *path)
        self.names[name] = node

    def parse(self, term: Term, *path: str | int) -> Node:
        """Parse an expression to its tree.

        Parameters
        ----------
        term : Term
            Number, or expression of the names.
        *path : str or int
            Key of the expression in the config, for an error.

        Returns
        -------
        Node
            Root of the tree.

        Raises
        ------
        InvalidKeyError
            For an expression that is mistaken, or nested more than ``MOST_LEVELS`` levels deep.
        """
        try:
            node = parse(term, self.names)
        except ExpressionError as error:
            raise InvalidKeyError(str(error), *path) from None
        # Depth of each part, by its id. A tree that is too deep cannot be sent to a worker process.
        levels: dict[int, int] = {}
        for part in in_order([node]):
            levels[id(part)] = 1 + max((levels[id(a)] for a in part.arguments), default=0)
        if levels[id(node)] > MOST_LEVELS:
            why = "with the parts that it names; put brackets about parts of a sum"
            raise InvalidKeyError(f"nested more than {MOST_LEVELS} levels deep, {why}", *path)
        return node

    def vector(self, nodes: Sequence[Node]) -> ArrayProgram:
        """Compile expressions (n,) to a function of x and the scalars."""
        return ArrayProgram(nodes, (len(nodes),), self.components, self.scalars)
