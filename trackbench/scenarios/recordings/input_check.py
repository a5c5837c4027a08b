"""Check whether known inputs, such as a robot's wheels and gyro, agree with the changes of the truth."""

from dataclasses import replace
from itertools import combinations
from typing import NamedTuple

import numpy as np

from trackbench.core.angles import wrap_angle
from trackbench.core.arrays import Array, Index, Mask
from trackbench.durations import two_digits
from trackbench.models.base import SampledMotion, angle_rows
from trackbench.models.inputs import KnownInputs, inputs_of
from trackbench.models.motions.unequal_intervals import Irregular, motion_with_inputs

_BLOCKS = 6
_STEPS_OF_BLOCK = 250
"""The check takes so many stretches of the run, of so many steps at most."""
_WINDOW = 25
"""Steps whose changes are added up, so that errors of the truth are small beside them."""
_FEWEST_WINDOWS = 10
_CORRELATED = 0.9
"""Correlation of the changes from which on their ratio is sure."""
_FACTORS = {
    "deg and rad": np.pi / 180.0,
    "mm and m": 1e-3,
    "cm and m": 1e-2,
    "km/h and m/s": 1.0 / 3.6,
    "kn and m/s": 1852.0 / 3600.0,
}
"""Usual mistakes of units, with the factor between the units."""
_NEAR = 0.05
"""Share by which a ratio may differ from a usual factor."""
_LARGEST_RATIO = 1.7
"""Ratio of the changes up to which nothing is noted: wheels slip, and gyros have scale errors."""
_LARGEST_LAG = 60
_EXPLAINS = 0.3
"""Share of the squared differences that remains at most if a delay explains them."""


class _Changes(NamedTuple):
    """Changes of one state component over the steps of B stretches, each of K steps.

    They are NaN where the truth is unknown.
    """

    of_input: Array
    """changes (B, K) from step to step that one input alone makes, by the motion's equations"""
    of_truth: Array
    """changes (B, K) of the truth, less those that the motion makes without this input"""
    correlation: float = 0.0
    """correlation of both over windows of steps"""


def input_notes(motion: SampledMotion, truth: Array, steps: Index, times: Array) -> list[str]:
    """Return texts on the inputs that the truth (n_x, K) contradicts; none without a truth.

    For each input, the change of the state that it makes in the motion's equations is compared with the
    change of the truth, over windows of 25 steps. A text is returned only if both are correlated, so
    that their ratio is sure. ``steps`` are the numbers of the K steps, and ``times`` (K,) are in s.
    """
    # Step 1: choose stretches of the run, and predict over them with and without each input.
    # A motion with further components, which the truth lacks, is not checked.
    known = inputs_of(motion)
    n = len(motion.components)
    if known is None or len(truth) != n or not np.isfinite(truth).any():
        return []
    # A component without any truth, such as a bias, is taken as 0.
    unknown = np.asarray(~np.isfinite(truth).any(axis=1))
    states = np.where(unknown[:, None], 0.0, truth)
    blocks = _blocks(times)
    if not blocks:
        return []
    chosen = np.stack(blocks)
    # For each input the changes of the state's component that it explains best, or None if it explains
    # none. Such an input counts as one that does not fit.
    best_changes = _best_changes(motion, known, states, steps, chosen, unknown)
    # Step 2: find inputs with a wrong factor, sign or clock.
    ratio_notes = []
    delay_notes = []
    interval = float(times[-1] - times[0]) / (len(times) - 1)
    for name, best in zip(known.names, best_changes, strict=True):
        if best is not None:
            ratio_notes += _ratio_note(name, best)
            delay_notes += _delay_note(name, best, interval)
    # Step 3: find pairs of inputs that fit the truth only if they are exchanged.
    exchange_notes = []
    for i, j in combinations(range(len(known.names)), 2):
        if _fits(best_changes[i]) or _fits(best_changes[j]):
            continue
        rows = [*range(len(known.names))]
        rows[i], rows[j] = j, i
        exchanged = replace(known, values=known.values[rows])
        changed = _best_changes(
            _with_inputs(motion, exchanged), exchanged, states, steps, chosen, unknown
        )
        if _fits(changed[i]) and _fits(changed[j]):
            names = f"{known.names[i]} and {known.names[j]}"
            message = f"the inputs {names} fit the truth if they are exchanged"
            exchange_notes.append(f"{message}: check their columns under `input`")
    # Notes of only one kind are returned: a wrong input spoils the changes by the others, which
    # then seem to be late.
    return exchange_notes or ratio_notes or delay_notes


def _best_changes(
    motion: SampledMotion,
    known: KnownInputs,
    states: Array,
    steps: Index,
    blocks: Index,
    unknown: Mask,
) -> list[_Changes | None]:
    """Return for each input the changes of one component of the state, by it alone and by the truth.

    It is the component in which both changes correlate best. They are correlated as sums over windows
    of 25 steps, beside which errors of the truth are small. The entry is None for an input that
    correlates with no component. The motion has the inputs ``known``. ``states`` (n, K) are those of the
    truth, of which the components in the mask ``unknown`` (n,) are left out. ``blocks`` (B, L) are the
    indices of the steps that are compared, and ``steps`` (K,) the numbers of all steps.
    """
    angles = list(angle_rows(motion))
    predicted = _predicted(motion, states, steps, blocks)
    best_changes: list[_Changes | None] = []
    for row in range(len(known.names)):
        # The input's changes are the difference of two predictions: with it and without it.
        without = _predicted(_without_input(motion, known, row), states, steps, blocks)
        with np.errstate(all="ignore"):
            of_input = predicted - without
            of_truth = states[:, blocks] - without
            of_input[angles] = wrap_angle(of_input[angles])
            of_truth[angles] = wrap_angle(of_truth[angles])
        best = None
        for component in np.flatnonzero(~unknown).tolist():
            each = _Changes(of_input=of_input[component], of_truth=of_truth[component])
            correlation = _correlation(_over_windows(each))
            if abs(correlation) > abs(0.0 if best is None else best.correlation):
                best = each._replace(correlation=correlation)
        best_changes.append(best)
    return best_changes


def _blocks(times: Array) -> list[Index]:
    """Return the indices (L,) of stretches of successive steps, which are spread over the run.

    ``times`` (K,) are those of all steps. Each predicted step needs one before it, so that the first
    step is in none. A run that is too short for a window has none.
    """
    predictable_steps = len(times) - 1
    length = predictable_steps
    # A run is cut into stretches only if each of them has two windows at least.
    if predictable_steps >= 2 * _BLOCKS * _WINDOW:
        length = predictable_steps // _BLOCKS
    length = min(_STEPS_OF_BLOCK, length)  # at most
    if length < _WINDOW:
        return []
    count = 1
    if length < predictable_steps:
        count = _BLOCKS
    starts = np.linspace(1, predictable_steps + 1 - length, count).astype(int)
    return [np.arange(start, start + length) for start in dict.fromkeys(starts.tolist())]


def _predicted(motion: SampledMotion, states: Array, steps: Index, blocks: Index) -> Array:
    """Return the states (n_x, B, L) that a motion predicts from the ``states`` (n_x, K) one step before.

    ``blocks`` (B, L) are the indices of the predicted states, ``steps`` (K,) the numbers of all steps.
    """
    means = []
    with np.errstate(all="ignore"):
        for i in blocks.ravel().tolist():
            means.append(motion.transition(states[:, i - 1 : i], int(steps[i])).mean[:, 0])
    return np.stack(means, axis=-1).reshape(len(states), *blocks.shape)


def _without_input(motion: SampledMotion, known: KnownInputs, row: int) -> SampledMotion:
    """Return the motion with zeros in place of the values of one input, whose number is ``row``.

    Unknown values, which are NaN, stay unknown.
    """
    values = known.values.copy()
    values[row] = np.where(np.isfinite(values[row]), 0.0, np.nan)
    return _with_inputs(motion, replace(known, values=values))


def _with_inputs(motion: SampledMotion, known: KnownInputs) -> SampledMotion:
    """Return the motion with the inputs ``known`` in place of its own."""
    if isinstance(motion, Irregular):
        return replace(motion, recorded_inputs=known)
    return motion_with_inputs(motion, known)


def _over_windows(changes: _Changes) -> _Changes:
    """Return the sums (W,) of both changes over windows of `_WINDOW` successive steps.

    Windows with an unknown step are left out, and so is the rest of a stretch.
    """
    sums = []
    for each in (changes.of_input, changes.of_truth):
        count = each.shape[-1] // _WINDOW
        sums.append(each[..., : count * _WINDOW].reshape(-1, _WINDOW).sum(axis=-1))
    known = np.isfinite(sums[0]) & np.isfinite(sums[1])
    return _Changes(of_input=sums[0][known], of_truth=sums[1][known])


def _correlation(windows: _Changes) -> float:
    """Return the correlation of both changes (W,) about zero; 0 with few windows or without changes."""
    by_input = windows.of_input
    true = windows.of_truth
    norm = float(np.sqrt((by_input * by_input).sum() * (true * true).sum()))
    if len(by_input) < _FEWEST_WINDOWS or norm == 0.0:
        return 0.0
    return float((by_input * true).sum()) / norm


def _factor(changes: _Changes) -> float:
    """Return the factor by which an input's values would have to be multiplied to fit the truth.

    ``changes`` are those of one state component by this input and by the truth.
    """
    windows = _over_windows(changes)
    by_input = windows.of_input
    true = windows.of_truth
    # Least squares of the input's changes on those of the truth, which has the smaller errors.
    return float((true * true).sum() / (by_input * true).sum())


def _fits(changes: _Changes | None) -> bool:
    """Test whether the changes by an input are those of the truth, up to usual errors of scale.

    ``changes`` are those of one state component, by the input and by the truth. None stands for an input
    that correlates with no component, and does not fit.
    """
    if changes is None or changes.correlation < _CORRELATED:
        return False
    # The factor is the ratio of the truth's changes to those by the input.
    return 1.0 / _LARGEST_RATIO < _factor(changes) < _LARGEST_RATIO


def _ratio_note(name: str, changes: _Changes) -> list[str]:
    """Return a text, in a list, if an input's changes differ from the truth's by a factor or the sign.

    The list is empty otherwise. ``name`` is the input's.
    """
    if abs(changes.correlation) < _CORRELATED:
        return []
    factor = _factor(changes)
    size = abs(factor)
    message = f"the input {name} fits the truth if its values are"
    if factor < 0.0:
        message += " of the other sign"
    if 1.0 / _LARGEST_RATIO < size < _LARGEST_RATIO:
        if factor > 0.0:
            return []
        return [f"{message}: write `-{name}` in the equations"]
    if factor < 0.0:
        message += " and"
    message += f" multiplied by {two_digits(size)}"
    for units, usual in _FACTORS.items():
        for ratio in (usual, 1.0 / usual):
            if abs(size / ratio - 1.0) < _NEAR:
                return [f"{message}: are {units} mixed up? See `units`"]
    return [f"{message}: check its unit, `units`"]


def _delay_note(name: str, changes: _Changes, interval: float) -> list[str]:
    """Return a text, in a list, if an input fits the truth much better with a delay; else an empty list.

    ``name`` is the input's, ``interval`` the mean one from step to step, s. ``changes`` (B, L) are those
    of B stretches of L steps each.
    """
    lags = range(-_LARGEST_LAG, _LARGEST_LAG + 1)
    length = changes.of_input.shape[-1]
    # Between the largest lags on both sides at least half of a stretch must remain.
    if length < 4 * _LARGEST_LAG:
        return []
    # Compare the truth's changes in the middle of each stretch with the input's ``lag`` steps later.
    middle = slice(_LARGEST_LAG, length - _LARGEST_LAG)
    remaining = []
    for lag in lags:
        later = slice(middle.start + lag, middle.stop + lag)
        windows = _over_windows(_Changes(changes.of_input[:, later], changes.of_truth[:, middle]))
        if len(windows.of_input) < _FEWEST_WINDOWS:
            return []
        remaining.append(float(np.square(windows.of_truth - windows.of_input).sum()))
    best = int(np.argmin(remaining))
    lag = lags[best]
    remaining_without_lag = remaining[lags.index(0)]
    # At the largest lag the differences may go on falling: it is no minimum.
    if abs(lag) == _LARGEST_LAG or remaining[best] > _EXPLAINS * remaining_without_lag:
        return []
    direction = "behind" if lag > 0 else "ahead of"
    message = f"the input {name} is some {abs(lag) * interval:.2g} s {direction} the truth"
    return [f"{message}: check the clocks of both, and `input_holds`"]
