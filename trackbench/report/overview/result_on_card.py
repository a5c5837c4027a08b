"""Result of an experiment in about five words, for its card and for README.md."""

from collections import Counter
from collections.abc import Sequence

from trackbench.errors import form_for
from trackbench.report.findings.phrases import named
from trackbench.report.findings.ranking import Ranking, rankings
from trackbench.report.tables_and_figures import Results


def result_in_words(results: Results) -> str:
    """Write the result in a few words; empty if the runs are missing."""
    if not results.has_runs:
        return ""
    return short_answer(rankings(results))


def short_answer(scene_rankings: Sequence[Ranking]) -> str:
    """Return the result in about five words: ``IMM best of 16 filters``; empty without a ranking.

    A ranking has its filters in ``order``. Apart from them are those ``losing`` significantly more runs
    than another, which have no rank but count as filters.
    """
    # In how many scenarios each filter is among the best.
    times_best = Counter[str]()
    for ranking in scene_rankings:
        times_best.update(candidate.label for candidate in ranking.among_the_best)
    # No filter is best with too few runs, or if another is better over the runs that both keep.
    if not times_best:
        has_rivals = any(len(ranking.order) > 1 for ranking in scene_rankings)
        return "which is best is inconclusive" if has_rivals else ""
    # Of several scenarios the filter that is best most often.
    if len(scene_rankings) > 1:
        label, most = times_best.most_common()[0]
        return f"{named(label)} best at {most} of {len(scene_rankings)}"
    ranking = scene_rankings[0]
    filters = len(ranking.order) + len(ranking.losing)
    ties = len(times_best) - 1
    if filters == 1:
        return ""
    if ties + 1 == filters:
        return f"no significant difference between {filters}"
    best = named(ranking.among_the_best[0].label)
    if ties:
        others = form_for(ties, "one other", f"{ties} others")
        return f"{best} and {others} best"
    return f"{best} best of {filters} filters"
