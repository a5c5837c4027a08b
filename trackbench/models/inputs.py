"""Known inputs of a motion, such as a robot's measured speed and turn rate: numbers of each step."""

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

from trackbench.core.arrays import Array
from trackbench.field_types import InvalidKeyError, Place
from trackbench.models.base import Motion


class InputGap(NamedTuple):
    """Time between two rows of a file over which the inputs are unknown, or one outside all rows."""

    place: Place
    """row of the file after which the values are missing, and what is wrong there"""
    step: int
    """number of the first step without values"""
    length: float | None = None
    """time between the rows, s or steps; None outside all rows"""


@dataclass(frozen=True, eq=False)
class KnownInputs:
    """Inputs by step: those of step k hold from step k - 1 to step k, in every run."""

    names: tuple[str, ...]
    """names, in order"""
    first: int
    """number of the step of the first column"""
    values: Array
    """values (n_u, K), NaN where there are none"""
    gaps: tuple[InputGap, ...] = ()
    """gaps without values, in order"""

    @lru_cache(maxsize=64)  # noqa: B019 (recordings are few; an IMM chooses at every step)
    def chosen(self, names: tuple[str, ...]) -> "KnownInputs":
        """Return the inputs of these names.

        Parameters
        ----------
        names : tuple of str
            Names of inputs, in any order.

        Returns
        -------
        KnownInputs
            These inputs alone, in the order of the names.

        Raises
        ------
        InvalidKeyError
            For a name that is unknown.
        """
        for name in names:
            if name not in self.names:
                known = ", ".join(self.names)
                message = f"the target's `input` has no {name!r}; known: {known}"
                raise InvalidKeyError(message)
        rows = [self.names.index(name) for name in names]
        return replace(self, names=names, values=self.values[rows])

    def at(self, k: int) -> tuple[float, ...]:
        """Return the values that hold from step k - 1 to step k, in the order of the names.

        Parameters
        ----------
        k : int
            Number of a step, ``first`` at least.

        Returns
        -------
        tuple of float
            Value of each input, NaN where there is none.
        """
        return tuple(self.values[:, k - self.first].tolist())


def inputs_of(motion: object) -> KnownInputs | None:
    """Return the inputs that enter the equations of a sampled motion; None if it has none."""
    return getattr(motion, "known_inputs", None)


def inputs_in_equations(motion: Motion, recorded: KnownInputs | None) -> KnownInputs | None:
    """Return those of the recorded inputs that are in a motion's equations.

    Inputs are known numbers of each step, such as a robot's measured speed.

    Parameters
    ----------
    motion : Motion
        Motion as the config names it.
    recorded : KnownInputs or None
        Inputs of a recording. None if it has none.

    Returns
    -------
    KnownInputs or None
        The motion's inputs, in the order of its key ``input``. None if its equations have no inputs.

    Raises
    ------
    InvalidKeyError
        For an input that is not recorded.
    """
    if not motion.input_names:
        return None
    if recorded is None:
        names = ", ".join(motion.input_names)
        message = f"the motion has the inputs {names}, and there are no values of them"
        way = "a recording has them: target `measured`, `input: {NAME: COLUMN}`"
        raise InvalidKeyError(f"{message}; {way}")
    return recorded.chosen(motion.input_names)
