"""Words of verdicts and what they mean, as it stands below the tables of verdicts."""

from collections.abc import Sequence

from trackbench.statistics.verdict_rules import NOT_MEASURED, TOO_FEW_RUNS, UNDECIDED, Verdict

HOW_DECIDED = (
    "beyond five standard errors of all runs, and three without any one batch of them; an equality, a "
    "share of runs or one recording beyond three"
)
MEANINGS = {
    "equal": "all printed digits, by a filter without random numbers on recorded data",
    "agrees": "the 95 % interval of the difference lies within 10 % of the printed number, or within "
    "its digits; a word on a bias is confirmed",
    "compatible": "no significant difference, but its interval is wider than 10 %",
    UNDECIDED: "not decided; z or the note says why",
    "differs": "significantly; without random numbers on recorded data, in its digits",
    "holds": "significant",
    "fails": "the opposite is significant",
    TOO_FEW_RUNS: "this run has fewer runs than the experiment, and a verdict needs all of them",
    NOT_MEASURED: "no filter of this run measures it",
}
"""Verdicts with their meanings; the first five are those on a number, the best first."""
NUMBER_WORDS = (*MEANINGS,)[:5]
CLAIM_WORDS = ("holds", "fails", UNDECIDED)
FRAGILE = "another seed, one run fewer or three far ones more could change the verdict"


def meanings_of(verdicts: Sequence[Verdict]) -> list[str]:
    """Return the meaning of each word that occurs in some verdicts.

    Parameters
    ----------
    verdicts
        verdicts of a table

    Returns
    -------
    list of str
        notes such as ``holds: significant.``, in the order of `MEANINGS`
    """
    words = {verdict.word for verdict in verdicts}
    meanings = {word: meaning for word, meaning in MEANINGS.items() if word in words}
    if words & {"differs", "holds", "fails"}:  # their meanings have the word "significant"
        meanings["significant"] = HOW_DECIDED
    if any(verdict.fragile for verdict in verdicts):
        meanings["fragile"] = FRAGILE
    return [f"{word}: {meaning}." for word, meaning in meanings.items()]
