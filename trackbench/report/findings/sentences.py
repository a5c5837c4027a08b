"""Conclusions of an experiment in a few sentences, each decided by its runs.

They name the best filter and those without a significant difference from it, metrics by which another
one is better, filters that lose more runs, the cost of the best and its calibration.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from math import isfinite

import numpy as np

from trackbench.config.tuning import tuned_label
from trackbench.errors import counted
from trackbench.evaluation.metric_expression import measured
from trackbench.registry import is_builtin
from trackbench.report.findings import phrases
from trackbench.report.findings.cost_and_calibration import calibration, cost, over_points
from trackbench.report.findings.phrases import (
    heading,
    listed,
    metric_words,
    multiple,
    named,
    percent,
    percent_of,
    run_count,
    statistic_words,
    two_digits,
    verb,
    with_unit,
)
from trackbench.report.findings.ranking import (
    Candidate,
    Ranking,
    Rival,
    leaders,
    ranking_metrics,
    rankings,
)
from trackbench.report.results import Results
from trackbench.report.table import rounded
from trackbench.statistics import rules
from trackbench.statistics.comparison import compare_all
from trackbench.statistics.estimates import in_words

HOW_DECIDED = (
    f"Filters differ significantly {rules.HOW_FILTERS_DIFFER}. A ratio has its 95 % interval. A filter "
    "that loses significantly more runs than another is unranked."
)


def answer(results: Results) -> list[str]:
    """Return sentences on the filters of a results folder, a line each; none if nothing is decided."""
    standings = rankings(results)
    matters = rules.share_that_matters(results.config.get("matters"))
    # One ranking: sentences on its best filter. Several: at how many points each is best.
    if len(standings) == 1:
        first = [_best_sentence(standings[0], matters), _tuned(results, standings[0])]
        first += [_other_metrics(results, standings[0])]
        last = [cost(results, standings[0]), calibration(results, standings[0])]
    else:
        first, last = [_over_points(standings)], _leader_sentence(results, standings)
    lines = [*first, _losing(standings), _failed(results), *plugin_ranks(results), *last]
    if standings and max(standing.runs for standing in standings) == 1:
        decided = any(s.ties or s.worse or s.undecided for s in standings)
        lines.append(_ONE_RUN if decided else _NO_ERROR)
    return [line for line in lines if line]


_NO_ERROR = "One run has no standard error: it does not decide which filter is best."
_ONE_RUN = (
    "One recording: its steps decide, by an error of their mean difference that allows for "
    "autocorrelation."
)


def _best_sentence(standing: Ranking, matters: float) -> str:
    best = standing.best
    if best is None:
        return _undecided(standing)
    statistic = statistic_words(best.sample.statistic, standing.metric)
    if not standing.rivals:
        return f"The {statistic} of {best.name} is {_value(standing)}."
    text = f"{best.name} has the {_extreme(standing)} {statistic}, {_value(standing)}"
    if standing.chosen:
        text = f"With each filter at the best of the grid's values, {text}"
    side = "smaller" if standing.more_is_better else "larger"
    parts = [text]
    if standing.worse:
        parts.append(f"significantly {side}: {_beside(standing, standing.worse, matters)}")
    if standing.ties:
        beside = _beside(standing, standing.ties) + _runs_needed(standing)
        parts.append(f"without a significant difference: {beside}")
    if standing.undecided:
        names = [rival.filter.name for rival in standing.undecided]
        undecided = (
            f"{listed(names)} {verb(names)} {side}, which {_runs_of(standing)} do not decide"
        )
        reasons = dict.fromkeys(rival.difference.why for rival in standing.undecided)
        parts.append(" ".join([undecided, *(f"({why})" for why in reasons if why)]))
    return "; ".join(parts) + "."


def _runs_of(standing: Ranking) -> str:
    """Return ``20 runs``, or the steps of a recording."""
    return counted(standing.runs, "run") if standing.runs > 1 else "the steps of one recording"


def _beside(standing: Ranking, rivals: Sequence[Rival], matters: float = 0.0) -> str:
    """Return each rival with its ratio to the best: ``UKF 1.52 times (1.3 to 1.8)``."""
    shown = [f"{r.filter.name} {_ratio(standing, r, matters)}".rstrip() for r in rivals]
    return listed(shown)


def _ratio(standing: Ranking, rival: Rival, matters: float) -> str:
    """Return the ratio to the best with its 95 % interval; of scores the difference."""
    comparison = rival.comparison
    if comparison.is_equal:
        return f"(equal {'at every step' if standing.runs == 1 else 'in every run'})"
    if standing.metric.family[0].is_score:
        nats = abs(comparison.difference.value)
        ends = sorted(map(abs, comparison.difference.interval()))
        return f"by {nats:.2g} nats ({' to '.join(f'{end:.2g}' for end in ends)})"
    if not comparison.b.value > 0.0:
        return ""  # nothing is a multiple of no error
    ratio, (low, high) = comparison.ratio.value, comparison.ratio.interval()
    value, *limits = (multiple(x, high - low) for x in (ratio, max(low, 0.0), high))
    tiny = f", below {percent(matters)}" if abs(ratio - 1.0) < matters else ""
    return f"{value} times ({' to '.join(limits)}{tiny})"


def _undecided(standing: Ranking) -> str:
    """Return why no filter is named best."""
    if not standing.order:
        return ""
    first = standing.order[0]
    statistic = statistic_words(first.sample.statistic, standing.metric)
    text = f"which filter has the {_extreme(standing)} {statistic}"
    if standing.conflict is None:
        few = 1 < standing.runs < rules.FEWEST_RUNS and standing.order[1:]
        needed = f"; {rules.FEWEST_RUNS} are needed"
        return f"{counted(standing.runs, 'run')} do not decide {text}{needed}." if few else ""
    first, other, common = standing.conflict
    text = f"W{text[1:]} is inconclusive"
    if not common:
        return f"{text}: {first.name} and {other.name} keep no run in common."
    return (
        f"{text}: {first.name} has it over all runs that it keeps, but over the {common} runs that both "
        f"keep {other.name} is better."
    )


def _tuned(results: Results, standing: Ranking) -> str:
    """Return which filters a tuned best one is compared with that were not tuned."""
    tuned = {tuned_label(label): label for label in results.config.get("tune") or {}}
    best = standing.best
    if best is None or best.label not in tuned:
        return ""
    compared = [rival.filter for rival in standing.rivals]
    others = [c.name for c in compared if c.label not in tuned and c.label not in tuned.values()]
    if not others:
        return ""
    return (
        f"{best.name} is tuned, {listed(others)} {verb(others)} not: tuning may be the difference."
    )


def _extreme(standing: Ranking) -> str:
    return "largest" if standing.more_is_better else "smallest"


def _value(standing: Ranking) -> str:
    """Return ``43.3 ± 0.2 m over 400 runs``, and how far it is above the reference."""
    best, reference = standing.best, standing.reference
    assert best is not None
    values = best.sample.values
    left = int(np.isfinite(values).sum())
    runs = counted(left, "run") + ("" if left == len(values) else " that it keeps")
    text = f"{with_unit(rounded(*best.overall, 4), standing.metric)} over {runs}"
    if reference is None or standing.metric.family[0].is_score:
        return text
    # The reference is named only if the best is significantly above it on common runs.
    pair = {"best": best.sample, "reference": reference.sample}
    comparison = compare_all(pair).between("best", "reference")
    if comparison is None or comparison.sign <= 0:
        return text
    above = f"{percent_of(comparison.difference.value, comparison.b.value)} above".lstrip()
    return f"{text}, {above} the reference {reference.name}"


def _runs_needed(standing: Ranking) -> str:
    """Return how many runs would decide the ties if the differences are as large as measured."""
    runs = []
    for _, tie in standing.ties:
        if isfinite(tie.z) and tie.z:
            needed = rules.deviations_needed(tie.tests)
            runs.append(rules.runs_that_decide(tie.difference.runs, tie.z, needed))
    if not runs:
        return ""
    long = " to ".join(dict.fromkeys(map(run_count, (min(runs), max(runs)))))
    amount = f"a recording {long} times as long" if standing.runs == 1 else f"{long} runs"
    size = "a difference" if len(runs) == 1 else "differences"
    return f" ({amount} would decide {size} of this size)"


def _other_metrics(results: Results, standing: Ranking) -> str:
    """Return the other metrics by which another filter is better than the best."""
    better: dict[str, list[str]] = {}
    names = [name for name in ranking_metrics(results) if name != standing.metric.metric]
    for metric in names if standing.best is not None else []:
        for other in rankings(results, metric):
            # Another filter leads by this metric, and the best by the first metric is worse.
            worse = [rival.filter.name for rival in other.worse]
            if other.best and standing.best and standing.best.name in worse:
                better.setdefault(other.best.name, []).append(metric_words(other.metric))
    parts = [f"by {listed(words)} {name} is" for name, words in better.items()]
    return f"But {', '.join(parts[:2])} better." if parts else ""


def _over_points(standings: Sequence[Ranking]) -> str:
    """Return at how many points each filter is among the best."""
    first = leaders(standings)
    counts = Counter(candidate.label for candidate in first)
    # Filters by the number of points at which they are among the best.
    by_count: dict[int, list[str]] = {}
    for label, n in counts.most_common():
        by_count.setdefault(n, []).append(named(label))
    if not by_count:
        return ""
    paths = " and ".join(phrases.axis(path) for path in standings[0].scene)
    (most, best), *rest = by_count.items()
    of = f"{most} of the {len(standings)}" if most < len(standings) else f"all {most}"
    statistic = statistic_words(first[0].sample.statistic, standings[0].metric)
    text = f"By {statistic} {listed(best)} {verb(best)} best, or"
    text += f" without a significant difference from the best, at {of} values of {paths}"
    return "; ".join([text, *(f"{listed(labels)} at {n}" for n, labels in rest)]) + "."


def _leader_sentence(results: Results, standings: Sequence[Ranking]) -> list[str]:
    """Return cost and calibration of the filter that is best at most points, if any."""
    by_label: dict[str, list[Candidate]] = {}
    for candidate in leaders(standings):
        by_label.setdefault(candidate.label, []).append(candidate)
    # A single filter must lead: two with as many points have no leader.
    ranked = sorted(by_label.values(), key=len, reverse=True)
    if not ranked or (ranked[1:] and len(ranked[1]) == len(ranked[0])):
        return []
    return over_points(results, ranked[0])


def _losing(standings: Sequence[Ranking]) -> str:
    """Return the filters that lose more runs than another, at the point where each loses most."""
    most: dict[str, Candidate] = {}
    # Each filter at the point where it loses most runs.
    for candidate in sorted((c for s in standings for c in s.losing), key=lambda c: -c.losses):
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


def plugin_ranks(results: Results) -> Iterator[str]:
    """Yield a sentence for each filter of a plugin, in each scenario of the grid."""
    filters = results.config["filters"]
    for label in results.filters:
        if is_builtin("filters", filters[label].get("kind", "ekf")):
            continue
        # A smoother uses later measurements, so filters and smoothers are ranked apart.
        smooths = bool(filters[label].get("smooth"))
        rivals = [b for b in results.filters if bool(filters[b].get("smooth")) == smooths]
        for ranking in rankings(results, _headline(results), rivals):
            lines = [_sentence(results, c, ranking) for c in ranking.order if c.label == label]
            lines += [
                f"{c.name} is unranked: it loses {c.losses} of {len(c.lost)} runs."
                for c in ranking.losing
                if c.label == label
            ]
            yield from lines


def _headline(results: Results) -> str:
    """Return the metric of the first table's first column, if filters can be ranked by it."""
    tables = results.config["tables"].values()
    columns = [text for table in tables for text in (table.get("columns") or {}).values()]
    metric = measured(str(columns[0])).metric if columns else ""
    return metric if metric in ranking_metrics(results) else ""


def _sentence(results: Results, mine: Candidate, ranking: Ranking) -> str:
    """Return rank and mean, the paired difference from the best, the ratio to the reference."""
    better = [c.overall.value for c in ranking.order].index(mine.overall.value)
    at = [f"On {results.citation}"] * bool(results.citation)
    at += [f"at {heading(ranking.scene)}"] * bool(ranking.scene)
    place = f"{', '.join(at)}, {mine.name}"
    text = (
        f"{place.removeprefix(', ')} ranks {1 + better} of {len(ranking.order)} by "
        f"{statistic_words(mine.sample.statistic, ranking.metric)}: "
        f"{with_unit(rounded(*mine.overall, 4), ranking.metric)}"
    )
    beside = {rival.filter.name: rival for rival in ranking.rivals}
    if ranking.best is not None and (rival := beside.get(mine.name)) and rival.difference.stderr:
        apart = with_unit(rounded(*rival.difference.estimate, 3), ranking.metric)
        if not ranking.metric.family[0].is_score:
            share = percent_of(rival.difference.value, ranking.best.overall.value)
            apart += f", {share}" if share else ""
        text += f"; its difference from {ranking.best.name}, the best, is {apart}"
        text += "" if rival in ranking.worse else ", which is not significant"
    return f"{text}{''.join(_ratios(results, mine, ranking))}."


def _ratios(results: Results, mine: Candidate, ranking: Ranking) -> Iterator[str]:
    """Yield the ratios of the error to those of the reference and of the bound."""
    config, metric = results.config, ranking.metric
    labels = [(config.get("problem") or {}).get("reference"), config.get("reference")]
    if metric.family[0].is_score:
        return
    for label in dict.fromkeys([*labels, config.get("bound")]):
        for statistic in ("mean", "rms"):  # bounds have no mean
            rows = results.columns("summary", mine.point).where(
                metric=f"{statistic}({metric.metric})"
            )
            values = [rows.where(filter=name)["value"].tolist() for name in (mine.label, label)]
            if all(values) and label != mine.label and values[1][0]:
                ratio = two_digits(values[0][0] / values[1][0])
                words = f"{statistic} {metric_words(metric)}"
                yield f"; its {words} is {ratio} times that of {named(str(label))}"
                break
