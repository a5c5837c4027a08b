"""Expressions compiled to instructions, and to functions that fill an array."""

from collections.abc import Sequence
from functools import cached_property
from itertools import product

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.read_only import fixed
from trackbench.models.expression_derivatives import derivative
from trackbench.models.expression_trees import (
    OPERATIONS,
    UFUNCS,
    Node,
    Operation,
    Value,
    in_order,
    is_constant,
)


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
        """Compile the expressions ``outputs`` of the variables ``arrays`` and ``scalars``."""
        # A slot is the place of a value in a list of all values; the variables have the first ones.
        self._slots: dict[tuple[object, ...], int] = {
            ("name", name): i for i, name in enumerate((*arrays, *scalars))
        }
        # Values of all slots before a call: constants have theirs, variables and results have zeros.
        self._initial_values: list[Value] = [0.0] * len(self._slots)
        self._is_array = [i < len(arrays) for i in range(len(self._slots))]
        # (operation, slots of its arguments, slot of its value)
        operations: list[tuple[str, tuple[int, ...], int]] = []
        by_node: dict[int, int] = {}  # slot of each node's value, by the node's id
        for node in in_order(outputs):
            by_node[id(node)] = self._assign_slot(node, operations, by_node)
        self._outputs = [by_node[id(node)] for node in outputs]
        self._instructions = self._with_reused_memory(operations)

    def uses(self, name: str) -> bool:
        """Test whether a value depends on a variable.

        Parameters
        ----------
        name : str
            One of the program's variables.

        Returns
        -------
        bool
            True if the variable is an output, or an argument of an instruction.
        """
        slot = self._slots[("name", name)]
        # The variable itself is an output, or an argument of an instruction.
        if slot in self._outputs:
            return True
        return any(slot in arguments for _, arguments, _, _ in self._instructions)

    def _assign_slot(
        self,
        node: Node,
        operations: list[tuple[str, tuple[int, ...], int]],
        by_node: dict[int, int],
    ) -> int:
        """Return the slot of a node's value: its index in the list of all values.

        A node with a new value gets the next slot, and its operation is appended to ``operations`` as
        (operation, slots of the arguments, slot of the value). A node whose value equals that of an
        earlier node gets its slot. ``by_node`` has the slots of the node's arguments, by their ids.
        """
        arguments = tuple(by_node[id(a)] for a in node.arguments)
        # Nodes with equal keys have equal values.
        key: tuple[object, ...] = (node.operation, *arguments)
        if node.operation == "number":
            key = ("number", repr(node.value))
        elif node.operation == "name":
            key = ("name", node.name)
        if key not in self._slots:
            slot = len(self._initial_values)
            self._slots[key] = slot
            self._initial_values.append(node.value)
            self._is_array.append(any(self._is_array[a] for a in arguments))
            if arguments:
                operations.append((node.operation, arguments, slot))
        return self._slots[key]

    def _with_reused_memory(
        self, operations: Sequence[tuple[str, tuple[int, ...], int]]
    ) -> list[tuple[Operation, tuple[int, ...], int, int]]:
        """List (function, slots of arguments, slot, slot whose memory the result may take or -1).

        ``operations`` are (name, slots of arguments, slot of the result), in the order of a call.
        """
        # Index of the last operation that uses a slot.
        last_use: dict[int, int] = {}
        for i, (_, arguments, _) in enumerate(operations):
            last_use |= dict.fromkeys(arguments, i)
        # A pair's members, the variables and the outputs keep their memory.
        writable = set()
        for name, _, slot in operations:
            is_pair = name in ("cos and sin", "first", "second")
            if self._is_array[slot] and not is_pair and slot not in self._outputs:
                writable.add(slot)
        instructions = []
        for i, (name, arguments, slot) in enumerate(operations):
            # An argument that is used here for the last time leaves its memory to the result, if the
            # operation can write it there (UFUNCS).
            free = [a for a in arguments if a in writable and last_use[a] == i]
            reused = free[0] if free and name in UFUNCS else -1
            instructions.append((OPERATIONS[name], arguments, slot, reused))
        return instructions

    def __call__(self, *variables: Value) -> list[Value]:
        """Evaluate the expressions: their values, in the order of the program's outputs.

        ``variables`` are first the arrays, of one shape with at least one axis, then the scalars.
        """
        values = self._initial_values.copy()
        values[: len(variables)] = variables
        # A slot `reused` of -1 stands for none: the result gets memory of its own.
        for function, arguments, slot, reused in self._instructions:
            if reused >= 0:
                values[slot] = function(*[values[a] for a in arguments], out=values[reused])
            elif len(arguments) == 2:
                values[slot] = function(values[arguments[0]], values[arguments[1]])
            else:
                values[slot] = function(values[arguments[0]])
        return [values[slot] for slot in self._outputs]


class ArrayProgram:
    """Expressions that fill an array (*shape, *batch) for states x (n_x, *batch)."""

    def __init__(
        self,
        nodes: Sequence[Node],
        shape: tuple[int, ...],
        components: tuple[str, ...],
        scalars: tuple[str, ...],
    ) -> None:
        """Compile ``nodes``, the entries of an array of this shape, its last axis running fastest.

        The variables are the ``components`` of the state, and the ``scalars``. `constant` is the array
        if no entry has any variable.
        """
        self.shape = shape
        self.components = components
        self._nodes = nodes
        self.constant: Array | None = None
        if all(map(is_constant, nodes)):
            self.constant = fixed(np.array([node.value for node in nodes]).reshape(shape))
        # Numbers are filled in, the others computed.
        self._fixed = [(i, node.value) for i, node in enumerate(nodes) if is_constant(node)]
        self._computed = [i for i, node in enumerate(nodes) if not is_constant(node)]
        self._size = len(components)  # n_x
        self._scalars = scalars
        self._program = Program([nodes[i] for i in self._computed], components, scalars)

    def __call__(self, x: Array, *scalars: float) -> Array:
        """Evaluate the array (*shape, *batch) for states x; (*shape,) if every expression is a number.

        ``scalars`` are the values of the other variables, such as the step k and the time t.
        """
        if self.constant is not None:
            return self.constant
        batch = x.shape[1:]  # a program takes arrays with at least one axis
        out = np.empty((len(self._nodes), *(batch or (1,))))
        for i, value in self._fixed:
            out[i] = value
        components = x if batch else x[:, None]
        with np.errstate(all="ignore"):  # runs that leave the numbers are counted, not warned about
            values = self._program(*components, *scalars)
            for i, computed in zip(self._computed, values, strict=True):
                out[i] = computed
        return out.reshape(*self.shape, *batch)

    @cached_property
    def jacobian(self) -> "ArrayProgram":
        """Derivatives (*shape, n_x) of each entry by each component of the state."""
        names = self.components
        slopes = [derivative(node, name) for node, name in product(self._nodes, names)]
        return ArrayProgram(slopes, (*self.shape, len(names)), names, self._scalars)

    def uses(self, name: str) -> bool:
        """Test whether a value depends on a variable."""
        return self._program.uses(name)

    def is_zero_at_zero(self) -> bool:
        """Test whether the values are zero for x = 0, at every step and time."""
        if any(map(self.uses, self._scalars)):
            return False
        return not np.any(self(np.zeros((self._size, 1)), *(0.0 for _ in self._scalars)))
