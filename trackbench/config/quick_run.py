"""Option `--quick`: numbers of runs, of an experiment and of a suite's problems, and shorter tuning."""

QUICK = "--quick"
"""Option whose number of runs may be more than there are recordings."""
QUICK_RUNS = 20
"""Runs of an experiment."""
QUICK_RUNS_OF_PROBLEM = 8
"""Runs of each problem of a suite: enough to test ratios (`significance_rules.FEWEST_RUNS`)."""
QUICK_TUNING = {"evaluations": 6, "runs": 10}
"""Trials and training runs of each filter that a suite tunes."""


FIT = "block=fit"
"""Override of `--quick`: equal blocks of fewer runs, which change no filter."""
