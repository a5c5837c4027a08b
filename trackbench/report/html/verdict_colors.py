"""Colors of verdicts on pages, as names of classes of page.css: good, fair, bad, open."""

from trackbench.statistics.verdict_rules import NOT_MEASURED, TOO_FEW_RUNS, UNDECIDED

VERDICT_COLORS = {
    "equal": "good",
    "agrees": "good",
    "holds": "good",
    "compatible": "fair",
    "differs": "bad",
    "fails": "bad",
    UNDECIDED: "open",
    TOO_FEW_RUNS: "open",
    NOT_MEASURED: "open",
}
"""Class of each verdict."""
