"""Remarks on a search: keys that hardly matter, keys at an end of their range, and lost runs."""

from collections.abc import Iterator
from math import isfinite

from trackbench.errors import counted, form_for
from trackbench.tuning.range_of_good_values import values_within_stderr
from trackbench.tuning.record_of_trials import Record
from trackbench.tuning.search import neighbor_budget

_FLAT = 0.9  # share of an axis: a key that is good on so much of it hardly matters
_END = 0.005  # share of an axis next to its end


def remarks_on_keys(record: Record, runs: int) -> Iterator[str]:
    """Yield remarks on lost runs, keys at an end of their range, keys without effect.

    ``runs`` is the number of training runs of each trial.
    """
    best = record.best
    if not isfinite(best.objective):
        if best.has_failed:
            yield "the filter failed with every value that was tried"
        elif best.lost:
            yield "no value that was tried keeps a single training run"
        else:
            yield "the metric of tuning has no value in training, so nothing was tuned"
        return
    number = len(record.trials)
    # The last trials of a search are those around the best values.
    if record.trials.index(best) >= number - neighbor_budget(record.axes, number):
        yield "the best values came last, looking around: more evaluations may find better ones"
    if best.lost:
        verb = form_for(best.lost, "is", "are")
        yield f"{best.lost} of {counted(runs, 'training run')} {verb} lost with the best values"
    for axis in record.axes:
        if axis.choices:
            continue
        value = best.values[axis.key]
        low, high = values_within_stderr(record, axis)
        share = axis.share(value) or 0.0
        low_share = axis.share(low) or 0.0
        high_share = axis.share(high) or 0.0
        if high_share - low_share >= _FLAT:
            yield (
                f"{axis.key} hardly matters: from {low:g} to {high:g} nothing is more than "
                "a standard error from the best"
            )
        elif not _END < share < 1.0 - _END:
            side = "lower" if share < 0.5 else "upper"
            yield f"{axis.key} is at its {side} bound, {value:g}: let it go further"
