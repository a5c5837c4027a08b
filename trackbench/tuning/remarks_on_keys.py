"""Remarks on a search: failed trials, keys without effect or at an end of their range, lost runs."""

from collections.abc import Iterator
from math import isfinite

from trackbench.errors import counted, form_for
from trackbench.tuning.range_of_good_values import values_within_stderr
from trackbench.tuning.record_of_trials import Record
from trackbench.tuning.search import neighbor_budget

_FLAT = 0.9  # share of an axis: a key that is good on so much of it hardly matters
_END = 0.005  # share of an axis next to its end


def remark_on_failures(record: Record) -> str:
    """Return how many trials failed, and the values and the reason of the first; some must fail."""
    failed = record.failed_trials
    which = f"all {len(failed)}"
    if len(failed) < len(record.trials):
        which = f"{len(failed)} of {len(record.trials)}"
    values = ", ".join(f"{key} = {value}" for key, value in failed[0].values.items())
    reason = f": {record.first_failure}" if record.first_failure else ""
    return f"the filter failed in {which} trials, first with {values}{reason}"


def remarks_on_vain_trials(record: Record) -> Iterator[str]:
    """Yield remarks on trials that failed or have no metric, and on keys without effect."""
    if record.failed_trials:
        yield remark_on_failures(record)
    best = record.best
    if best.has_failed:
        return
    if not isfinite(best.objective):
        if best.lost:
            yield "no value that was tried keeps a single training run"
        else:
            yield "the metric of tuning has no value in training, so nothing was tuned"
        return
    for key, tried in record.keys_without_effect.items():
        yield (
            f"{key} has no effect: {tried} trials with different values of it have an equal metric; "
            "check that the filter reads this key"
        )


def remarks_on_keys(record: Record, runs: int) -> Iterator[str]:
    """Yield the remarks on trials in vain, on lost runs, and on keys at an end of their range.

    ``runs`` is the number of training runs of each trial.
    """
    yield from remarks_on_vain_trials(record)
    best = record.best
    if not isfinite(best.objective):
        return
    idle_keys = record.keys_without_effect
    trials = len(record.trials)
    # The last trials of a search are those around the best values.
    is_last = record.trials.index(best) >= trials - neighbor_budget(record.axes, trials)
    if is_last and len(idle_keys) < len(record.axes):
        yield "the best values came last, looking around: more evaluations may find better ones"
    if best.lost:
        verb = form_for(best.lost, "is", "are")
        yield f"{best.lost} of {counted(runs, 'training run')} {verb} lost with the best values"
    for axis in record.axes:
        if axis.choices or axis.key in idle_keys:
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
