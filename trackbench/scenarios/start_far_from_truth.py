"""Note on a `given` start that lies far from the recorded truth of some runs."""

from collections.abc import Sequence

import numpy as np

from trackbench.core.angles import wrap_angle
from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian
from trackbench.errors import first_names, form_for
from trackbench.scenarios.recordings.rows_and_reading_context import ONE_RUN
from trackbench.scenarios.recordings.run_names_of_truth import MOST_NAMES

_FAR_SIGMAS = 10.0
"""standard deviations of the start, beyond which it is far from the truth"""
_LONGEST_DELAY = 1.5
"""intervals of the truth, by which it may begin after the first state"""
_MOVES = 2.0
"""times as far as the truth moves then, that the difference may be by motion alone"""


def note_on_far_start(
    start: Gaussian,
    truth: Array,
    times: Array,
    components: Sequence[str],
    angle_rows: Sequence[int],
    runs: Sequence[str],
) -> list[str]:
    """Return a note, in a list, if the start lies far from the truth of some runs.

    Parameters
    ----------
    start
        distribution of the first state (n_x,) of all runs
    truth
        recorded states (n_x, K, M) from the first state's time on, NaN where they are unknown
    times
        times (K,) of the steps, s
    components
        names of the state's components
    angle_rows
        rows of the state that are angles
    runs
        names of the runs
    """
    far_runs = []
    largest = 0.0
    component_of_largest = ""
    for m, name in enumerate(runs):
        sigmas = _distances_from_truth(start, truth[:, :, m], times, angle_rows)
        if sigmas.max() > _FAR_SIGMAS:
            far_runs.append(name)
        if sigmas.max() > largest:
            largest = float(sigmas.max())
            component_of_largest = components[int(sigmas.argmax())]
    if not far_runs:
        return []
    distance = f"{largest:.3g} of its standard deviations ({component_of_largest})"
    whose = "the truth"
    advice = "correct its mean, or raise its sigma"
    if far_runs != [ONE_RUN]:
        word = form_for(len(far_runs), "run", "runs")
        whose = f"the truth of {word} {first_names(far_runs, MOST_NAMES)}"
        advice += (
            "; `grid: {scenario.target.runs & scenario.start.mean: [...]}` gives each run its own"
        )
    if len(far_runs) > 1:
        distance = f"up to {distance}"
    return [f"`start` lies {distance} from {whose}: {advice}"]


def _distances_from_truth(
    start: Gaussian, truth: Array, times: Array, angle_rows: Sequence[int]
) -> Array:
    """Return how far the start's mean is from a run's first truth, in standard deviations (n_x,).

    The truth is (n_x, K). If it begins soon after the first state, the distance is less by what the
    target may have moved until then. It is 0 for a component without a truth, or with no standard
    deviation.
    """
    sigmas = np.sqrt(np.diag(start.cov))
    distances = np.zeros(len(truth))
    for row, values in enumerate(truth):
        known = np.flatnonzero(np.isfinite(values))
        if len(known) < 2 or sigmas[row] == 0.0:
            continue
        first, second = known[:2]
        interval = times[second] - times[first]
        delay = times[first] - times[0]
        if delay > _LONGEST_DELAY * interval:
            continue
        # Differences of the start and of the second truth from the first truth.
        differences = np.array([start.mean[row], values[second]]) - values[first]
        if row in angle_rows:
            differences = wrap_angle(differences)
        from_start, to_second = np.abs(differences)
        moved = _MOVES * to_second * delay / interval
        distances[row] = max(from_start - moved, 0.0) / sigmas[row]
    return distances
