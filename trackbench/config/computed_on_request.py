"""Numbers and tracks that runs have only on request: predictions, CPU times, tracks for figures."""

import re
from collections.abc import Iterable

from trackbench.config.experiment import Experiment
from trackbench.config.requested_metrics import requested_measures
from trackbench.evaluation.block_task import Kind

_SCORE_METRICS = ("log_score", "log_likelihood", "likelihood_ratio")
_PREDICTION_METRICS = re.compile(
    r"(rmse|bias|std|squared|error)_predicted_.+|anis|innovations|autocorrelation_.+"
)


def requested_predictions(experiment: Experiment) -> tuple[Kind, ...]:
    """Return the kinds of predictions that the experiment's metrics need.

    For a recording without a truth these are scores and one-step predictions.
    """
    if not all(p.scenario.has_truth for p in experiment.points):
        return ("score", "prediction")
    return predictions_for(m.metric for m in requested_measures(experiment))


def predictions_for(metrics: Iterable[str]) -> tuple[Kind, ...]:
    """Return the kinds of predictions that ``metrics`` need, which are names without statistic."""
    names = set(metrics)
    heads = {name.partition("_")[0] for name in names}
    requested: dict[Kind, bool] = {
        "score": not names.isdisjoint(_SCORE_METRICS),
        "prediction": any(_PREDICTION_METRICS.fullmatch(name) for name in names),
        "calibration": not heads.isdisjoint(("pit", "coverage", "nci", "rank")),
        "ranks": "rank" in heads,
        "crps": "crps" in heads,
        "likelihood_ratio": "likelihood_ratio" in names,
    }
    return tuple(kind for kind, is_requested in requested.items() if is_requested)


def takes_times(experiment: Experiment) -> bool:
    """Test whether a table, a figure, a published number or a claim names CPU times."""
    return any(m.is_cpu_time for m in requested_measures(experiment))


def shown_runs(experiment: Experiment) -> int:
    """Return the number of runs whose whole tracks the figures need; 0 without figures."""
    return max((f.shown_runs for f in experiment.figures.values()), default=0)


def shows_covariances(experiment: Experiment) -> bool:
    """Test whether a figure needs those tracks' covariances too."""
    return any(f.shown_covariances for f in experiment.figures.values())
