"""Cached outputs of filters over a block: of a filter, its reference, and its twin without faults."""

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.latest_results import LatestResults
from trackbench.evaluation.block_task import MOST_STACKED, BlockTask
from trackbench.evaluation.filter_output import FilterOutput
from trackbench.evaluation.run_filter import run_filter
from trackbench.filters.external import ProgramRunError


def _run_filter(task: BlockTask, covariances: int) -> FilterOutput:
    """Run the filter over the block's own data; the output is read-only.

    ``covariances`` is the number of first runs whose covariances are recorded.
    """
    try:
        output = run_filter(task, task.data, covariances)
    except ProgramRunError as error:
        # The error counts runs from the block's first one: name the run of the experiment.
        raise error.with_run(task.run_number(error.run)) from None
    for values in (output.mean, output.nees, output.cov, *output.diagnostics.values()):
        if values is not None:
            values.flags.writeable = False  # no copy is needed, as no filter has these arrays
    return output


run_filter_cached = LatestResults(_run_filter, size=1)
"""A filter's output over its block, read-only; cached for tasks that score it in another way."""
run_reference = LatestResults(lambda task: _run_filter(task, 0), size=1)
"""The reference's output over a block, read-only; cached for all filters, itself among them."""
run_twin = LatestResults(lambda task: _run_filter(task, 0), size=1)
"""A filter's output without faults, read-only; cached for tasks that score it in another way."""


def reference_output(task: BlockTask) -> FilterOutput:
    """Return the output of the task's reference filter.

    Parameters
    ----------
    task
        task of a filter, with a reference

    Returns
    -------
    FilterOutput
        output of the reference in the same runs. It is NaN if the reference fails: the filter then has
        only the numbers that need no reference. If the filter is itself the reference, its error is
        raised
    """
    reference = task.reference_task
    # If the reference is itself the filter of the task, its failure is raised: its numbers are missing.
    is_reference = (task.filter, task.assume) == (task.reference, task.reference_assume)
    # A reference that failed before, beside another filter of the block, is not run again: its output of
    # NaN is in the cache.
    unknown = _unknown_references.cached(reference)
    if unknown is not None and not is_reference:
        return unknown
    try:
        return run_reference(reference)
    except MemoryError:
        raise
    except Exception:
        unknown = _unknown_references(reference)
        if is_reference:
            raise
        return unknown


def _unknown_output(task: BlockTask) -> FilterOutput:
    """Return an output of NaN, in place of that of a reference that failed.

    It has a log-likelihood if predictive metrics are requested, as the likelihood ratio needs it.
    """
    unknown = np.full(task.data.truth.shape, np.nan)  # (n_x, T + 1, M)
    scores: dict[str, Array] = {}
    if task.predictive_metrics:
        scores["log_likelihood"] = unknown[0]
    return FilterOutput(mean=unknown, nees=unknown[0], cov=None, diagnostics=scores, cpu_s=0.0)


_unknown_references = LatestResults(_unknown_output, size=MOST_STACKED)
"""Outputs of references that failed: each is run once for all filters of a block."""
