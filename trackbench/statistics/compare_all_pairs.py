"""Compare every two of some filters as one family of tests, many pairs in one call on arrays.

So the best of many filters is compared with its rivals at a level that allows for its choice.
"""

from collections.abc import Mapping
from itertools import combinations

import numpy as np

from trackbench.core.sums import total
from trackbench.statistics.comparison import Comparison, Sample, compare, without_rounding
from trackbench.statistics.estimates import RunEstimate
from trackbench.statistics.holm_correction import as_family
from trackbench.statistics.skewness_corrected_t_test import studentized_rows

_NUMBERS_AT_ONCE = 1_000_000
"""Numbers of the arrays of `_compare_side_by_side`, which are pairs of filters times runs."""


class Family(dict[tuple[str, str], Comparison]):
    """Comparisons of every two filters, a before b; those without common runs or steps are left out."""

    def between(self, a: str, b: str) -> Comparison | None:
        """Return the comparison of two filters.

        Parameters
        ----------
        a, b
            labels of the filters, in any order

        Returns
        -------
        Comparison or None
            comparison of a with b; None without common runs or steps
        """
        if (a, b) in self:
            return self[a, b]
        if (b, a) in self:
            return self[b, a].swapped
        return None


def compare_all(samples: Mapping[str, Sample]) -> Family:
    """Compare every two filters as one family of tests.

    Parameters
    ----------
    samples
        sample of each filter by label, all of the same M runs

    Returns
    -------
    Family
        comparisons with p-values by Holm
    """
    compared_in_arrays = _compare_side_by_side(samples)
    comparisons = {}
    for a, b in combinations(samples, 2):
        comparison = compared_in_arrays.get((a, b))
        if comparison is None:
            comparison = compare(samples[a], samples[b])
        if comparison is not None:
            comparisons[a, b] = comparison
    return Family(as_family(comparisons))


@np.errstate(all="ignore")
def _compare_side_by_side(samples: Mapping[str, Sample]) -> dict[tuple[str, str], Comparison]:
    """Compare many pairs of filters in one computation on arrays, with the bits of `compare`.

    Only pairs of filters that lost no run are compared, by a mean, rms or median, and only if their
    difference has a standard error. All other pairs are left out.
    """
    # Samples with `steps`, those of a recording, have correlated values and another test. So has a
    # variance.
    complete = [
        label
        for label, sample in samples.items()
        if sample.steps is None
        and sample.statistic != "variance"
        and len(sample.values) > 1
        and np.isfinite(sample.values).all()
    ]
    # Only samples of one statistic and one number of runs fit into one array.
    statistics_and_runs = {
        (samples[label].statistic, len(samples[label].values)) for label in complete
    }
    if len(complete) < 2 or len(statistics_and_runs) != 1:
        return {}
    (statistic, runs), *_ = statistics_and_runs
    pairs = [*combinations(range(len(complete)), 2)]
    values = np.array([samples[label].values for label in complete])
    if statistic != "mean":
        overall = [samples[label].overall for label in complete]
        numbers = np.array([estimate.value for estimate in overall])
        influences = np.array([estimate.influences for estimate in overall])
    compared = {}
    at_once = max(1, _NUMBERS_AT_ONCE // runs)
    for start in range(0, len(pairs), at_once):
        pairs_of_piece = pairs[start : start + at_once]
        first = [i for i, _ in pairs_of_piece]
        second = [j for _, j in pairs_of_piece]
        # Step 1: the P differences of the statistic (P,), and the runs' influences on them (P, M).
        difference_of_runs = without_rounding(values[first], values[second])
        if statistic == "mean":
            difference_of_pair = total(difference_of_runs) / runs
            influences_of_pair = difference_of_runs - difference_of_pair[:, None]
            centered = influences_of_pair
            is_compared = np.full(len(pairs_of_piece), True)
        else:
            # `compare` removes differences that are only rounding; it compares such pairs itself.
            is_rounding = (difference_of_runs == 0.0) & (values[first] != values[second])
            is_compared = ~is_rounding.any(axis=1)
            difference_of_pair = numbers[first] - numbers[second]
            influences_of_pair = influences[first] - influences[second]
            centered = influences_of_pair - (total(influences_of_pair) / runs)[:, None]
        deviation = np.sqrt(total(np.square(centered)) / (runs - 1))
        stderr = deviation / np.sqrt(runs)
        # Step 2: test the hypothesis that each difference is zero.
        z = studentized_rows(difference_of_pair, influences_of_pair)
        is_compared &= ~np.isnan(z)
        for p in np.flatnonzero(is_compared).tolist():
            a = complete[first[p]]
            b = complete[second[p]]
            difference = RunEstimate(
                value=float(difference_of_pair[p]),
                stderr=stderr[p],
                influences=influences_of_pair[p],
                runs=runs,
            )
            compared[a, b] = Comparison(
                samples[a].overall, samples[b].overall, difference, float(z[p])
            )
    return compared
