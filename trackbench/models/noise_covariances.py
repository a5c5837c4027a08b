"""Covariances Q and R of the noise in a config: their forms, checks, and expressions.

The checks are also those of the covariance of a start.
"""

from collections.abc import Sequence
from itertools import chain
from typing import TypeAlias

import numpy as np

from trackbench.core.arrays import Array
from trackbench.field_types import InvalidKeyError
from trackbench.models.compiled_expressions import ArrayProgram
from trackbench.models.equations import Equations, Term
from trackbench.models.expression_trees import ZERO, Node

Covariance: TypeAlias = Term | dict[str, Term] | tuple[Term | tuple[Term, ...], ...]
"""One variance for every component, variances by component or in order, or a matrix."""
_ROUNDING = 1e-12  # of a covariance's eigenvalues, relative to the largest one


def compile_covariance(
    equations: Equations, terms: Covariance, components: Sequence[str], *path: str | int
) -> "CovarianceProgram":
    """Compile the terms of a covariance.

    Parameters
    ----------
    equations : Equations
        Names that the terms may use.
    terms : Covariance
        One variance for all components, variances by component or in order, or a matrix.
    components : sequence of str
        Names of the n components whose covariance it is.
    *path : str or int
        Key of the terms in the config, for an error.

    Returns
    -------
    CovarianceProgram
        Program of the covariance (n, n).

    Raises
    ------
    InvalidKeyError
        For expressions that are mistaken, and for a matrix that is no covariance.
    """
    n = len(components)
    rows = _covariance_rows(terms, components, *path)
    # A term without a path is a zero off the diagonal, which the config leaves out.
    nodes = []
    for term, term_path in chain.from_iterable(rows):
        nodes.append(equations.parse(term, *term_path) if term_path else ZERO)
    for i in range(n):
        for j in range(i):
            below, _ = rows[i][j]
            above, _ = rows[j][i]
            if below != above:
                raise asymmetry(i, j, *path)
    program = CovarianceProgram(equations, nodes, components, path)
    if program.constant is not None:
        check_eigenvalues(program.constant, *path)
    return program


def asymmetry(row: int, column: int, *path: str | int) -> InvalidKeyError:
    """Return the error of an entry that differs from its mirror image; both count from 0.

    ``path`` is the key of the covariance.
    """
    message = f"not symmetric: row {row + 1}, column {column + 1} and the reverse differ"
    return InvalidKeyError(message, *path)


def check_eigenvalues(cov: Array, *path: str | int) -> None:
    """Raise InvalidKeyError, with the key ``path``, if a covariance (n, n) has a negative eigenvalue."""
    least, largest = np.linalg.eigvalsh(cov)[[0, -1]]
    if least < -_ROUNDING * largest or np.isnan(least):
        message = f"has the eigenvalue {least:.3g}, and a covariance has none below 0"
        raise InvalidKeyError(message, *path)


_Cell: TypeAlias = tuple[Term, tuple[str | int, ...]]


def _covariance_rows(
    terms: Covariance, components: Sequence[str], *path: str | int
) -> list[list[_Cell]]:
    """List the rows of a covariance of ``components``, each term with the path of its key.

    ``terms`` are one variance for all components, variances by component or in order, or a matrix. The
    zeros off a diagonal have an empty path.
    """
    n = len(components)
    # A variance by component, one for all, a list of them, or a matrix.
    if isinstance(terms, dict):
        for name in terms:
            if name not in components:
                known = ", ".join(components)
                raise InvalidKeyError(f"unknown component; known: {known}", *path, name)
        diagonal = [(terms.get(name, 0.0), (*path, name)) for name in components]
    elif not isinstance(terms, tuple):
        diagonal = [(terms, path)] * n
    elif len(terms) != n:
        raise InvalidKeyError(f"{len(terms)} items for {', '.join(components)}", *path)
    elif any(isinstance(row, tuple) for row in terms):
        matrix: list[list[_Cell]] = []
        for i, row in enumerate(terms):
            if not isinstance(row, tuple) or len(row) != n:
                raise InvalidKeyError(f"row {i + 1} of the matrix needs {n} items", *path, i)
            matrix.append([(term, (*path, i, j)) for j, term in enumerate(row)])
        return matrix
    else:
        variances = [term for term in terms if not isinstance(term, tuple)]
        diagonal = [(term, (*path, i)) for i, term in enumerate(variances)]
    rows: list[list[_Cell]] = [[(0.0, ())] * n for _ in range(n)]
    for i, cell in enumerate(diagonal):
        rows[i][i] = cell
    return rows


class CovarianceProgram(ArrayProgram):
    """Expressions of a covariance (n, n, *batch) for states x (n_x, *batch)."""

    def __init__(
        self,
        equations: Equations,
        nodes: Sequence[Node],
        components: Sequence[str],
        path: tuple[str | int, ...],
    ) -> None:
        """Compile ``nodes``, the entries of the covariance of ``components``, row by row.

        ``path`` leads to the key of the config that has them.
        """
        size = len(components)
        super().__init__(nodes, (size, size), equations.components, equations.scalars)
        self._names = components
        self._path = path

    def __call__(self, x: Array, *scalars: float) -> Array:
        """Evaluate the covariance; the first of ``scalars`` is the step.

        Raises InvalidKeyError if a variance is negative at a state.
        """
        cov = super().__call__(x, *scalars)
        # A constant has been checked where it was compiled, by `compile_covariance`.
        if self.constant is None:
            self._check_variances(cov, x, scalars)
        return cov

    def _check_variances(self, cov: Array, x: Array, scalars: Sequence[float]) -> None:
        """Raise InvalidKeyError for the first negative variance on the diagonal of ``cov``.

        ``cov`` is (n, n, *batch) at the states x (n_x, *batch); the first of ``scalars`` is the step.
        """
        for i, name in enumerate(self._names):
            variances = np.ravel(cov[i, i])
            negative = np.flatnonzero(variances < 0.0)
            if not negative.size:
                continue
            place = negative[0]
            state = x.reshape(len(x), -1)[:, place].tolist()
            values = zip(self.components, state, strict=False)
            where = ", ".join(f"{component} = {value:.4g}" for component, value in values)
            message = (
                f"step {scalars[0]:g}: the variance of {name} is {variances[place]:.4g} at {where}; "
                "write it so that it is never negative, as `max(0, ...)`"
            )
            raise InvalidKeyError(message, *self._path)
