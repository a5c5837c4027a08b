"""Conclusions of an experiment in a few sentences, each decided by its runs.

Which filter is best and which are not told apart from it (`standing`), by which other metric that is
otherwise, which lose more runs, what the best costs and how calibrated it is (`merits`).
"""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from trackbench.evaluation.statistics import interval, mean, without_rounding
from trackbench.report.findings import cost_and_calibration, phrases
from trackbench.report.findings.phrases import listed, metric_words, named, percent, verb, with_unit
from trackbench.report.findings.ranking import Candidate, Standing, ranking_metrics, standings
from trackbench.report.lost_runs import in_words
from trackbench.report.paired import Pair
from trackbench.report.results import Results
from trackbench.report.table import rounded

HOW_DECIDED = (
    "Filters are told apart by the differences of their mean per run on common runs, at 5 % with Holm's "
    "correction over all pairs; one that loses more runs than another (sign tests, so corrected, too) "
    "is not ranked."
)


def answer(results: Results) -> list[str]:
    """Return sentences on the filters of a results folder, a line each; none if nothing is decided."""
    found = standings(results)
    if len(found) == 1:
        lines = [_best(found[0]), _otherwise(results, found[0]), _losing(found), _failed(results)]
        lines += [
            cost_and_calibration.cost(results, found[0]),
            cost_and_calibration.calibration(results, found[0]),
        ]
    else:
        lines = [_over_points(found), _losing(found), _failed(results), *_leader(results, found)]
    if found and max(standing.runs for standing in found) == 1:
        lines.append("One run has no standard error: which filter is best is not decided.")
    return [line for line in lines if line]


def _best(standing: Standing) -> str:
    best, words = standing.best, metric_words(standing.metric)
    if best is None:
        return ""
    if not standing.ties and not standing.worse:
        return f"The mean {words} per run of {best.name} is {_value(standing)}."
    text = f"{best.name} has the {_extreme(standing)} mean {words} per run, {_value(standing)}"
    if standing.chosen:
        text = f"With each filter at the best of the grid's values, {text}"
    if standing.ties:
        names = [c.name for c, _ in standing.ties]
        text += f"; {listed(names)} {verb(names)} not told apart from it ({_room(standing)})"
    return f"{text}; {_others(standing)}." if standing.worse else f"{text}."


def _extreme(standing: Standing) -> str:
    return "largest" if standing.more_is_better else "smallest"


def _value(standing: Standing) -> str:
    """Return ``43.3 ± 0.2 m over 400 runs``, and how far it is above the reference."""
    best, reference = standing.best, standing.reference
    assert best is not None
    left = int(np.isfinite(best.values).sum())
    kept = "" if left == len(best.values) else " that it keeps"
    text = f"{with_unit(rounded(*best.mean, 4), standing.metric)} over {left} runs{kept}"
    if reference is None or standing.metric.family[0].is_score:
        return text
    own, least = best.beside(reference)
    if not interval("mean", without_rounding(own, least))[0] > 0.0:
        return text
    above = percent(mean(own).value / mean(least).value - 1.0)
    return f"{text}, {above} above the reference {reference.name}"


def _room(standing: Standing) -> str:
    """Return how much worse the filters without a significant difference may be: upper 95 % limit."""
    assert standing.best is not None
    sign = -1.0 if standing.more_is_better else 1.0
    apart = [sign * without_rounding(*other.beside(standing.best)) for other, _ in standing.ties]
    apart = [differences for differences in apart if np.any(differences)]
    if not apart:
        return "equal in every run"
    most = max(interval("mean", differences)[1] for differences in apart)
    if standing.metric.family[0].is_score:
        return f"at most {most:.2g} nats smaller, 95 %"
    return f"at most {percent(most / standing.best.mean.value)} larger, 95 %"


def _others(standing: Standing) -> str:
    """Return how much worse the other filters are, the nearest first."""
    assert standing.nearest is not None
    nearest, pair = standing.nearest
    apart = "smaller" if standing.more_is_better else "larger"
    by = f"by {_difference(standing, pair)}"
    n = len(standing.worse)
    if n == 1:
        return f"that of {nearest.name} is {apart} {by}"
    other = "remaining" if standing.ties else "other"
    return f"those of the {other} {n} are {apart}, the nearest ({nearest.name}) {by}"


def _difference(standing: Standing, pair: Pair) -> str:
    """Return ``0.97 ± 0.08 m (2.2 %)``; of scores no share."""
    text = with_unit(rounded(abs(pair.difference), pair.stderr, 3), standing.metric)
    if standing.best is None or standing.metric.family[0].is_score:
        return text
    return f"{text} ({percent(abs(pair.difference) / standing.best.mean.value)})"


def _otherwise(results: Results, standing: Standing) -> str:
    """Return the other metrics by which another filter is better than the best."""
    better: dict[str, list[str]] = {}
    for metric in ranking_metrics(results)[1:] if standing.best is not None else []:
        for other in standings(results, metric):
            worse = [c.name for c, _ in other.worse]
            if other.best and standing.best and standing.best.name in worse:
                better.setdefault(other.best.name, []).append(metric_words(other.metric))
    parts = [f"by {listed(words)} {name} is" for name, words in better.items()]
    return f"But {', '.join(parts[:2])} better." if parts else ""


def _over_points(found: Sequence[Standing]) -> str:
    """Return at how many points each filter is among the best."""
    counts = Counter(c.label for standing in found for c in standing.among_the_best)
    by_count: dict[int, list[str]] = {}
    for label, n in counts.most_common():
        by_count.setdefault(n, []).append(named(label))
    if not by_count:
        return ""
    paths = " and ".join(phrases.axis(path) for path in found[0].where)
    (most, leaders), *rest = by_count.items()
    of = f"{most} of the {len(found)}" if most < len(found) else f"all {most}"
    text = f"By mean {metric_words(found[0].metric)} per run {listed(leaders)} {verb(leaders)} best, or"
    text += f" not told apart from the best, at {of} values of {paths}"
    return "; ".join([text, *(f"{listed(labels)} at {n}" for n, labels in rest)]) + "."


def _leader(results: Results, found: Sequence[Standing]) -> list[str]:
    """Return cost and calibration of the filter that is best at most points, if any."""
    leaders: dict[str, list[Candidate]] = {}
    for candidate in (c for standing in found for c in standing.among_the_best):
        leaders.setdefault(candidate.label, []).append(candidate)
    ranked = sorted(leaders.values(), key=len, reverse=True)
    if not ranked or (ranked[1:] and len(ranked[1]) == len(ranked[0])):
        return []
    return cost_and_calibration.over_points(results, ranked[0])


def _losing(found: Sequence[Standing]) -> str:
    """Return the filters that lose more runs than another, at the point where each loses most."""
    most: dict[str, Candidate] = {}
    for candidate in sorted((c for s in found for c in s.losing), key=lambda c: -c.losses):
        most.setdefault(candidate.label, candidate)
    if not most:
        return ""
    shown = list(most.values())
    if all(c.losses == len(c.lost) for c in shown):
        names = [c.name for c in shown]
        return f"{listed(names)} {verb(names, 'loses', 'lose')} every run."
    losses = [f"{c.name} {in_words(c.losses, len(c.lost), '')}" for c in shown]
    return f"Not ranked, for more lost runs than others have: {listed(losses)}."


def _failed(results: Results) -> str:
    failed = [named(label) for label in dict.fromkeys(row["filter"] for row in results.failed)]
    return f"{listed(failed)} failed and cannot be compared." if failed else ""
