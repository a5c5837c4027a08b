"""Scored steps with a recorded truth: where there are none, errors cannot be measured."""

from collections.abc import Sequence

import numpy as np

from trackbench.core.arrays import Array, Index, Mask
from trackbench.errors import first_names, form_for

_MOST_NAMES = 3


def runs_with_truth(truth: Array) -> Mask:
    """Return at which steps each run has any of the truth (n_x, K, M): (K, M)."""
    has_truth: Mask = np.logical_or.reduce(np.isfinite(truth), axis=0)
    return has_truth


def steps_with_truth(truth: Array) -> Mask:
    """Return at which steps any run has any of the truth (n_x, K, M): (K,)."""
    has_truth: Mask = np.logical_or.reduce(runs_with_truth(truth), axis=-1)
    return has_truth


def describe_unscored_truth(times: Array, has_truth: Mask, scored: Mask) -> str:
    """Explain that no scored step has a truth; empty if one has, or if no step is scored.

    Parameters
    ----------
    times
        times of the steps (K,), s
    has_truth
        which of the steps (K,) have a truth in any run
    scored
        which of the steps (K,) are scored
    """
    if (has_truth & scored).any() or not scored.any():
        return ""
    of_scored = _stretch(times, scored)
    if not has_truth.any():
        return f"no scored step has a truth: {of_scored} after the first step are scored"
    of_truth = _stretch(times, has_truth)
    return (
        f"no scored step has a truth: it is known from {of_truth} after the first step, and scored are "
        f"{of_scored}"
    )


def _stretch(times: Array, steps: Mask) -> str:
    """Write the first and the last time of some steps after the first of all: ``0 to 448 s``."""
    first, last = (times[steps] - times[0])[[0, -1]]
    return f"{first:.6g} to {last:.6g} s"


def note_on_runs(names: Sequence[str], has_truth: Mask, scored: Mask) -> str:
    """Write the note on runs that have a truth, but at no scored step; empty if there are none.

    Parameters
    ----------
    names
        names of the runs
    has_truth
        which of the steps have a truth in each run (K, M)
    scored
        which of the steps (K,) are scored
    """
    # If no run has a truth at a scored step, `describe_unscored_truth` writes the note.
    with_scored_truth = []
    unscored = []
    for name, run in zip(names, has_truth.T, strict=True):
        if run[scored].any():
            with_scored_truth.append(name)
        elif run.any():
            unscored.append(name)
    if not unscored or not with_scored_truth:
        return ""
    shown = first_names(unscored, _MOST_NAMES)
    verb = form_for(len(unscored), "has", "have")
    return (
        f"{len(unscored)} of {len(names)} runs {verb} a truth, but at no scored step ({shown}): "
        "errors are those of the others"
    )


def advise_scored_steps(key: str, steps: Index, times: Array, has_truth: Mask) -> str:
    """Advise which steps to score in place of those that ``key`` chooses.

    Parameters
    ----------
    key
        key that chooses them now, `train` or `steps`
    steps
        numbers of the steps (K,)
    times
        times of the steps (K,), s
    has_truth
        which of the steps (K,) have a recorded truth, one at least

    Returns
    -------
    str
        advice, to be appended to a message
    """
    if key == "train":
        percent = longest_training(times, has_truth)
        if percent > 1.0:  # else hardly any time is left for training
            return f"write a share below {percent / 100.0:g}"
        return "leave it out"
    first, last = steps[has_truth][[0, -1]]
    return f"score steps within {first} to {last}"


def longest_training(times: Array, has_truth: Mask) -> float:
    """Return the share of the time below which the key `train` leaves a scored step with a truth.

    Parameters
    ----------
    times
        times of all steps (K,), s
    has_truth
        which of the steps (K,) have a truth, one at least

    Returns
    -------
    float
        share in percent, rounded down to a whole number
    """
    # From the first step to the last one with a truth.
    last = times[has_truth][-1] - times[0]
    return float(np.floor(100.0 * last / (times[-1] - times[0])))
