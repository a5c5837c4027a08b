"""Series of errors at each step.

A series is an array (T + 1, M):

``squared_<quantity>``  squared error of a quantity that the scenario names
``error_<quantity>``    signed error of a scalar quantity
``nees``                normalized error squared
``outside_region``      1 if the NEES exceeds its quantile of 1 - 1e-6 for a consistent filter, else 0
``rmsd_<quantity>``     squared distance to the reference filter's estimate
``damage_<quantity>``   length of the error less that without faults

`nees`, `predictive_and_held_out_scores` and `calibration_series` have more series.
"""

from collections.abc import Iterator

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.sums import total
from trackbench.evaluation.damage_of_faults import damage_series
from trackbench.evaluation.outside_own_region import outside_region
from trackbench.filters.base import AnyFilter, has_expectations
from trackbench.metrics import joined
from trackbench.scenarios.base import Scenario


def series(
    scenario: Scenario,
    truth: Array,
    mean: Array,
    nees: Array,
    exact: Array | None,
    rank: Array | None = None,
    twin: Array | None = None,
) -> dict[str, Array]:
    """Return every series of errors of a block, or of some of its steps.

    Recorded data without a truth have no errors, and those of a step without a truth are NaN. The series
    ``rmsd`` has squares, like ``squared``.

    Parameters
    ----------
    scenario
        scenario, which names the errors
    truth, mean
        true states and estimates (n_x, T + 1, M)
    nees
        normalized errors squared (T + 1, M)
    exact
        estimates (n_x, T + 1, M) of the reference filter; None if there is none
    rank
        ranks (T + 1, M) of the covariances; None if all have full rank
    twin
        estimates (n_x, T + 1, M) of the same filter in the same runs without faults; None if there are
        none

    Returns
    -------
    dict
        series (T + 1, M) by name. Squared ones are in the squared unit of their quantity
    """
    rows: dict[str, Array] = {}
    if scenario.has_truth:
        # Squared errors of each quantity, and signed errors of the scalar ones.
        rows |= _errors(scenario, mean, truth, squared="squared", signed="error")
        rows["nees"] = nees
        rows["outside_region"] = outside_region(nees, len(truth), rank)
    if twin is not None:
        rows |= damage_series(rows, without_faults=_errors(scenario, twin, truth, squared="damage"))
    if exact is not None:
        rows |= _errors(scenario, mean, exact, squared="rmsd")
    return rows


def _errors(
    scenario: Scenario, mean: Array, truth: Array, squared: str, signed: str = ""
) -> dict[str, Array]:
    """Return series (T + 1, M) of the squared length of each of the scenario's error vectors.

    They are the errors of ``mean`` (n_x, T + 1, M) against ``truth``, or another mean in its place.
    ``squared`` is the first word of their names. If ``signed`` is given, scalar errors also have a
    series of signed errors, whose name begins with that word.
    """
    rows: dict[str, Array] = {}
    for quantity, vectors in scenario.errors(mean, truth).items():
        error = np.asarray(vectors, dtype=np.float64)
        rows[joined(squared, quantity)] = total(np.square(error), axis=0)
        if signed and len(error) == 1:
            rows[joined(signed, quantity)] = error[0]
    return rows


def error_series_names(
    scenario: Scenario, has_faults: bool, has_reference: bool, tracker: AnyFilter | None
) -> Iterator[str]:
    """Yield the names of a filter's series of errors.

    Parameters
    ----------
    scenario
        scenario, which names the errors
    has_faults
        True if the scenario has faults: the damage that they do is an error, too
    has_reference
        True if the estimates are compared with those of a reference filter
    tracker
        filter; None for a filter with mistakes

    Yields
    ------
    str
        name such as ``squared_position``; there is none for recorded data without a truth
    """
    if not scenario.has_truth:
        return
    # The names of errors are those at any state.
    origin = np.zeros((len(scenario.components), 1))
    for quantity, error in scenario.errors(origin, origin).items():
        yield joined("squared", quantity)
        if len(error) == 1:  # only the error of one component has a sign
            yield joined("error", quantity)
        if has_faults:
            yield joined("damage", quantity)
        if has_reference:
            yield joined("rmsd", quantity)
    yield "nees"
    yield "outside_region"
    for name in scenario.marginals:
        yield f"nees_{name}"
    # A filter that computes expectations of functions of the state also estimates the observables.
    if tracker is not None and has_expectations(tracker):
        for name in scenario.observables(origin):
            yield f"squared_{name}"
            yield f"error_{name}"
