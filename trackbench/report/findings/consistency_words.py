"""Words on the consistency of filters, such as overconfident and collapsed, for rankings and cells."""

from collections.abc import Mapping, Sequence
from math import isinf, isnan

import numpy as np

from trackbench.core.arrays import Array
from trackbench.errors import counted
from trackbench.evaluation.metric_expression import Measure
from trackbench.metrics import FIRST_INDEFINITE, in_window
from trackbench.report.expressions import Evaluator
from trackbench.report.findings.candidates import Candidate
from trackbench.report.tables_and_figures import Results
from trackbench.statistics.collapsed_runs import collapsed_in_words, collapsed_runs_decide
from trackbench.statistics.consistency_bands import credibility, z_of_mean
from trackbench.statistics.holm_correction import significant_signs
from trackbench.statistics.indefinite_covariances import indefinite_in_words
from trackbench.statistics.sample_statistics import interval, mean

_SAYS_NOTHING = ("", "undecided")
"""Words on the consistency of a filter that may have diverged."""


def first_indefinite_steps(results: Results, candidate: Candidate) -> Array | None:
    """Return the first step (M,) of each run at which a filter's covariance is not positive definite.

    NaN in runs without such a step; None if no run has one.
    """
    return results.runs(candidate.point).get((candidate.label, FIRST_INDEFINITE))


def indefinite_text(results: Results, candidate: Candidate) -> str:
    """Write in how many runs a filter's covariance is not positive definite, and the first such step.

    The text is ``EKF in 4 of 8 runs, first at step 63``; empty without such runs.
    """
    first = first_indefinite_steps(results, candidate)
    if first is None:
        return ""
    number = int(np.isfinite(first).sum())
    words = indefinite_in_words(
        number, runs=len(first), lost=candidate.losses, first_step=float(np.nanmin(first))
    )
    return f"{candidate.name} {words}"


def diverged_runs(
    results: Results,
    candidates: Sequence[Candidate],
    consistency_words: Mapping[Candidate, str],
) -> list[str]:
    """Count the diverged runs of each filter about whose consistency the table has no decided word.

    ``consistency_words`` are the words of the table. The texts are such as ``EKF in 3 of 40 runs``. In a
    diverged run the last ten estimates lie outside their confidence regions, and its value of
    ``diverged`` is 1. Filters without such runs are left out.
    """
    texts = []
    for candidate in candidates:
        values = results.runs(candidate.point).get((candidate.label, "diverged"))
        if values is None or consistency_words[candidate] not in _SAYS_NOTHING:
            continue
        number = int(np.nansum(values))
        if number:
            texts.append(f"{candidate.name} in {number} of {counted(len(values), 'run')}")
    return texts


def consistency(results: Results, candidates: Sequence[Candidate]) -> dict[Candidate, str]:
    """Judge the NEES of every filter of a table in a word, or its NIS if there is no truth.

    The word is empty if a filter has neither. The filters are one family of tests: if all of them are
    exact, any is called overconfident or underconfident with a probability of at most `rules.LEVEL`.
    """
    family = list(dict.fromkeys(candidates))
    values = [_normalized_squares(results, candidate) for candidate in family]
    # The least and largest mean of the squares if the filter is consistent: (1, 1) without a gate.
    expected_ranges = [_expected_range(results, candidate) for candidate in family]
    zs = list(map(z_of_mean, values, expected_ranges))
    signs = significant_signs(zs)
    words = {}
    for candidate, squares, sign, expected_range in zip(
        family, values, signs, expected_ranges, strict=True
    ):
        first_indefinite = _first_indefinite_of_squares(results, candidate)
        words[candidate] = _consistency_word(squares, sign, expected_range, first_indefinite)
    return words


def words_decided_alone(results: Results, words: Mapping[Candidate, str]) -> list[str]:
    """List the undecided filters that a test of one filter alone calls overconfident or underconfident.

    ``words`` has the words of the table, whose filters are tested as one family. A test of the family is
    stricter. The texts are such as ``EKF (overconfident)``.
    """
    texts = []
    for candidate, word in words.items():
        if word != "undecided":
            continue
        squares = _normalized_squares(results, candidate)
        z = z_of_mean(squares, _expected_range(results, candidate))
        (sign,) = significant_signs([z])
        if sign:
            word_alone = "overconfident" if sign > 0 else "underconfident"
            texts.append(f"{candidate.name} ({word_alone})")
    return texts


def _normalized_squares(results: Results, candidate: Candidate) -> Array:
    """Return the NEES of the M runs divided by the number of components, or without NEES their ANIS.

    The mean is 1 for a consistent filter. Runs with NaN are left out, so that the result is (M',). It is
    empty if the filter has neither.
    """
    name = _consistency_metric(results, candidate)
    if not name:
        return np.empty(0)
    values = results.runs(candidate.point)[candidate.label, name]
    components = 1  # ANIS is divided by their number already
    if name == "nees":
        components = results.facts(candidate.point).sizes[""]  # the nameless size: the whole state
    return values[~np.isnan(values)] / components


def _first_indefinite_of_squares(results: Results, candidate: Candidate) -> Array | None:
    """Return the `first_indefinite_steps` (M',) of the runs that `_normalized_squares` has."""
    first = first_indefinite_steps(results, candidate)
    if first is None:
        return None
    squares = results.runs(candidate.point)[
        candidate.label, _consistency_metric(results, candidate)
    ]
    return first[~np.isnan(squares)]


def _consistency_metric(results: Results, candidate: Candidate) -> str:
    """Name the metric that a filter's consistency is judged by; empty if it has none."""
    runs = results.runs(candidate.point)
    for name in ("nees", "anis"):
        if (candidate.label, name) in runs:
            return name
    return ""


def _expected_range(results: Results, candidate: Candidate) -> tuple[float, float]:
    """Return the least and largest mean of a consistent filter's normalized squares.

    Both are 1, unless a gate leaves out measurements with a large NIS and so lowers the mean. They
    differ for several sensors: the mean then depends on which sensors measure together.
    """
    accepted = results.facts(candidate.point).accepted_nis(candidate.label)
    if accepted is None or _consistency_metric(results, candidate) == "nees":
        return 1.0, 1.0
    return accepted.mean


def _consistency_word(
    values: Array,
    sign: int,
    expected_range: tuple[float, float],
    first_indefinite: Array | None = None,
) -> str:
    """Return the word on a filter's consistency by the normalized squares (M,) of its runs.

    ``sign`` is +1 if their mean is significantly above that of a consistent filter, -1 if below, else 0.
    ``expected_range`` is the least and the largest mean of a consistent filter: both are 1 without a
    gate, which makes the mean lower. ``first_indefinite`` (M,) is the first step at which a run's
    covariance is not positive definite, NaN if there is none; None if no run has such a step.
    """
    if not len(values):
        return ""
    # Such as "collapsed in 3 of 40 runs"; empty unless these runs decide the mean. It is shortened to
    # "collapsed in 3 of 40", or to "collapsed in all".
    collapsed = collapsed_in_words(values, first_indefinite)
    if collapsed:
        every_run = f"{len(values)} of {len(values)} runs"
        if collapsed.endswith(f" {every_run}"):
            return f"{collapsed.removesuffix(f' in {every_run}')} in all"
        return collapsed.removesuffix(" runs")
    # Of several runs `collapsed_in_words` has counted infinite squares. Of a single run it has no text.
    if isinf(mean(values).value):
        return "overconfident"
    low, high = interval("mean", values)
    word = credibility(low, high, sign, expected_range)
    # Without an interval, of too few runs, there is no word.
    if word or isnan(low):
        return word
    return "undecided"


def collapse_words(evaluator: Evaluator, m: Measure) -> str:
    """Return ``collapsed in 3 of 40 runs``; empty unless collapsed runs decide the measure.

    `collapsed_runs_decide` has the metrics and statistics. A measure at one step, or in relation to
    another filter, such as a ratio, has no such words.
    """
    definition = m.definition
    quantity = m.quantity
    may_be_decided = collapsed_runs_decide(definition.name, m.statistic)
    # NEES, NIS or ANIS of each run (M,), which the measure is computed from.
    values = evaluator.runs.get((m.filter, in_window(m.base, m.window)))
    if not may_be_decided or m.relation or m.steps or values is None:
        return ""
    # Divide by the number of components; ANIS is divided already.
    facts = evaluator.results.facts(evaluator.point)
    if definition.name == "anis":
        components = 1
    elif definition.name == "nis":
        components = len(facts.measured)
    else:
        components = facts.sizes.get(quantity, 1)
    first_indefinite = evaluator.runs.get((m.filter, FIRST_INDEFINITE))
    return collapsed_in_words(values / components, first_indefinite)
