"""Check whether known inputs, such as a robot's wheels and gyro, agree with the changes of the truth."""

from dataclasses import replace
from itertools import combinations
from typing import NamedTuple

import numpy as np

from trackbench.core.angles import wrap_angle
from trackbench.core.arrays import Array, Index, Mask
from trackbench.models.base import SampledMotion, angle_rows
from trackbench.models.inputs import KnownInputs, inputs_of
from trackbench.models.motions.irregular import Irregular, motion_with_inputs
from trackbench.scenarios.recordings.truth_check import two_digits

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
    """Changes of one component over the steps of some stretches, NaN where the truth is unknown."""

    of_input: Array
    """by the input alone, as the motion computes them (blocks, K)"""
    of_truth: Array
    """of the truth, without what the motion computes without this input (blocks, K)"""
    correlation: float = 0.0
    """correlation of both over windows of steps"""


def input_notes(motion: SampledMotion, truth: Array, steps: Index, times: Array) -> list[str]:
    """Describe each input that the truth (n_x, K) of a recording contradicts; none without a truth.

    For each input, the change of a state that it makes in the motion's equations is compared with the
    change of the truth, over some 25 steps each. A text is returned only if both are correlated, so that
    their ratio is sure. ``steps`` and ``times`` are the numbers and times of the K steps.
    """
    known = inputs_of(motion)
    n = len(motion.components)
    if known is None or len(truth) != n or not np.isfinite(truth).any():
        return []
    # A component without any truth, such as a bias, is taken as 0.
    unknown = np.asarray(~np.isfinite(truth).any(axis=1))
    states = np.where(unknown[:, None], 0.0, truth)
    blocks = _blocks(states, times)
    if not blocks:
        return []
    chosen = np.stack(blocks)
    best_changes = _best_changes(motion, known, states, steps, chosen, unknown)
    ratio_notes = []
    delay_notes = []
    interval = float(times[-1] - times[0]) / (len(times) - 1)
    for name, best in zip(known.names, best_changes, strict=True):
        if best is not None:
            ratio_notes += _ratio_note(name, best)
            delay_notes += _delay_note(name, best, interval)
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
    # A wrong input spoils the changes by the others, which then seem to be late.
    return exchange_notes or ratio_notes or delay_notes


def _best_changes(
    motion: SampledMotion,
    known: KnownInputs,
    states: Array,
    steps: Index,
    blocks: Index,
    unknown: Mask,
) -> list[_Changes | None]:
    """Return the changes by each input of the component in which they agree best with the truth.

    The motion has the inputs ``known``. Components of the ``states`` (n, K) that are ``unknown`` (n,)
    are left out. None for an input whose changes agree in no component.
    """
    angles = list(angle_rows(motion))
    predicted = _predicted(motion, states, steps, blocks)
    best_changes: list[_Changes | None] = []
    for row in range(len(known.names)):
        # The changes by the input alone, and those of the truth.
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


def _blocks(states: Array, times: Array) -> list[Index]:
    """Return the indices of stretches of successive steps that are spread over the run."""
    number = len(times) - 1
    length = number
    if number >= 2 * _BLOCKS * _WINDOW:
        length = number // _BLOCKS
    length = min(_STEPS_OF_BLOCK, length)
    if length < _WINDOW:
        return []
    count = 1
    if length < number:
        count = _BLOCKS
    starts = np.linspace(1, number + 1 - length, count).astype(int)
    return [np.arange(start, start + length) for start in dict.fromkeys(starts.tolist())]


def _predicted(motion: SampledMotion, states: Array, steps: Index, blocks: Index) -> Array:
    """Return the states (n_x, blocks, K) that a motion predicts from the ``states`` one step before.

    ``blocks`` (blocks, K) are the indices of the predicted states.
    """
    means = []
    with np.errstate(all="ignore"):
        for i in blocks.ravel().tolist():
            means.append(motion.transition(states[:, i - 1 : i], int(steps[i])).mean[:, 0])
    return np.stack(means, axis=-1).reshape(len(states), *blocks.shape)


def _without_input(motion: SampledMotion, known: KnownInputs, row: int) -> SampledMotion:
    """Return the motion with zeros in place of the known values of the input ``row``."""
    values = known.values.copy()
    values[row] = np.where(np.isfinite(values[row]), 0.0, np.nan)
    return _with_inputs(motion, replace(known, values=values))


def _with_inputs(motion: SampledMotion, known: KnownInputs) -> SampledMotion:
    """Return the motion with other values of its inputs."""
    if isinstance(motion, Irregular):
        return replace(motion, recorded_inputs=known)
    return motion_with_inputs(motion, known)


def _over_windows(changes: _Changes) -> _Changes:
    """Add up the changes of successive steps: (W,) each, without windows of unknown steps."""
    sums = []
    for each in (changes.of_input, changes.of_truth):
        count = each.shape[-1] // _WINDOW
        sums.append(each[..., : count * _WINDOW].reshape(-1, _WINDOW).sum(axis=-1))
    known = np.isfinite(sums[0]) & np.isfinite(sums[1])
    return _Changes(of_input=sums[0][known], of_truth=sums[1][known])


def _correlation(windows: _Changes) -> float:
    """Return the correlation of both changes (W,) about zero; 0 with few windows or without changes."""
    d = windows.of_input
    e = windows.of_truth
    norm = float(np.sqrt((d * d).sum() * (e * e).sum()))
    if len(d) < _FEWEST_WINDOWS or norm == 0.0:
        return 0.0
    return float((d * e).sum()) / norm


def _factor(changes: _Changes) -> float:
    """Return the factor by which an input's values would have to be multiplied to fit the truth."""
    windows = _over_windows(changes)
    d = windows.of_input
    e = windows.of_truth
    # The truth has the smaller errors.
    return float((e * e).sum() / (d * e).sum())


def _fits(changes: _Changes | None) -> bool:
    """Test whether the changes by an input are those of the truth, up to usual errors of scale."""
    if changes is None or changes.correlation < _CORRELATED:
        return False
    return 1.0 / _LARGEST_RATIO < _factor(changes) < _LARGEST_RATIO


def _ratio_note(name: str, changes: _Changes) -> list[str]:
    """Describe how an input's changes differ from those of the truth by a factor or the sign."""
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
    """Describe a delay of an input behind the truth, or before it; ``interval`` is the mean one, s."""
    lags = range(-_LARGEST_LAG, _LARGEST_LAG + 1)
    length = changes.of_input.shape[-1]
    if length < 4 * _LARGEST_LAG:
        return []
    # The truth's changes in the middle of each stretch, and the input's so many steps later.
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
    if abs(lag) == _LARGEST_LAG or remaining[best] > _EXPLAINS * remaining[_LARGEST_LAG]:
        return []
    direction = "behind" if lag > 0 else "ahead of"
    message = f"the input {name} is some {abs(lag) * interval:.2g} s {direction} the truth"
    return [f"{message}: check the clocks of both, and `input_holds`"]
