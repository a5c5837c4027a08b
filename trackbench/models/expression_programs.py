"""Expressions compiled to a list of numpy operations."""

from collections.abc import Sequence

from trackbench.models.expressions import OPERATIONS, UFUNCS, Node, Operation, Value


class Program:
    """Expressions compiled to one list of instructions, in which equal parts are computed once.

    Parameters
    ----------
    outputs : sequence of Node
        The expressions.
    arrays : sequence of str
        Variables that are arrays of one shape, in the order in which a call gives them.
    scalars : sequence of str
        Variables that are numbers, given after them.
    """

    def __init__(
        self, outputs: Sequence[Node], arrays: Sequence[str], scalars: Sequence[str] = ()
    ) -> None:
        self._slots: dict[tuple[object, ...], int] = {
            ("name", name): i for i, name in enumerate((*arrays, *scalars))
        }
        self._start: list[Value] = [0.0] * len(self._slots)
        self._is_array = [i < len(arrays) for i in range(len(self._slots))]
        operations: list[tuple[str, tuple[int, ...], int]] = []
        by_node: dict[int, int] = {}
        self._outputs = [self._slot(node, operations, by_node) for node in outputs]
        self._instructions = self._with_reuse(operations)

    def uses(self, name: str) -> bool:
        """Return whether a value depends on a variable."""
        slot = self._slots[("name", name)]
        return slot in self._outputs or any(
            slot in arguments for _, arguments, *_ in self._instructions
        )

    def _slot(
        self,
        node: Node,
        operations: list[tuple[str, tuple[int, ...], int]],
        by_node: dict[int, int],
    ) -> int:
        """Return the slot of a node's value, with the instructions appended that compute it."""
        if id(node) in by_node:
            return by_node[id(node)]
        arguments = tuple(self._slot(a, operations, by_node) for a in node.arguments)
        # Nodes with one key have one value.
        key: tuple[object, ...] = (node.operation, *arguments)
        if node.operation == "number":
            key = ("number", repr(node.value))
        elif node.operation == "name":
            key = ("name", node.name)
        if key not in self._slots:
            self._slots[key] = slot = len(self._start)
            self._start.append(node.value)
            self._is_array.append(any(self._is_array[a] for a in arguments))
            if arguments:
                operations.append((node.operation, arguments, slot))
        by_node[id(node)] = self._slots[key]
        return by_node[id(node)]

    def _with_reuse(
        self, operations: Sequence[tuple[str, tuple[int, ...], int]]
    ) -> list[tuple[Operation, tuple[int, ...], int, int]]:
        """Return (function, slots of arguments, slot, slot whose memory the result may take or -1)."""
        last_use = {a: i for i, (_, arguments, _) in enumerate(operations) for a in arguments}
        # A pair's members, the variables and the outputs keep their memory.
        own = {
            slot for name, _, slot in operations
            if self._is_array[slot] and name not in ("cos and sin", "first", "second")
        } - {*self._outputs}  # fmt: skip
        instructions = []
        for i, (name, arguments, slot) in enumerate(operations):
            free = (a for a in arguments if a in own and last_use[a] == i)
            reused = next(free, -1) if name in UFUNCS else -1
            instructions.append((OPERATIONS[name], arguments, slot, reused))
        return instructions

    def __call__(self, *variables: Value) -> list[Value]:
        """Return the expressions' values for the arrays, at least (1,), and numbers given."""
        values = self._start.copy()
        values[: len(variables)] = variables
        for function, arguments, slot, reused in self._instructions:
            if reused >= 0:
                values[slot] = function(*[values[a] for a in arguments], out=values[reused])
            elif len(arguments) == 2:
                values[slot] = function(values[arguments[0]], values[arguments[1]])
            else:
                values[slot] = function(values[arguments[0]])
        return [values[slot] for slot in self._outputs]
