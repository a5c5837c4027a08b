"""Command `fit`: estimate Q and R from data, which is tuning by `log_score`."""

from typing import Any

from trackbench.cli.options import Config, runs_experiments
from trackbench.cli.tune import Evaluations, run_with_tuning


@runs_experiments
def fit(config: Config, evaluations: Evaluations = None, **given: Any) -> None:
    """Estimate what `tune` names, such as Q and R, from data: the maximum of the likelihood.

    It is `tune --metric log_score`: of the predictions of each measurement by those before it.
    """
    # ``given`` has the options of `_shared` (options.py) by name, which the decorator declares. Without
    # ``evaluations``, the number of trials of each filter, that of the config's `tuning` stays.
    run_with_tuning(config, "log_score", evaluations, given)
