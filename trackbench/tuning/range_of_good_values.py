"""Range of good values of a tuned key, by the rule of one standard error."""

from math import isfinite
from typing import Any

from trackbench.config.tuning_axes import Axis
from trackbench.tuning.record_of_trials import Record, Trial


def values_within_stderr(record: Record, axis: Axis) -> list[Any]:
    """Find the values of a key at which the objective is at most a standard error above the best.

    For a key with choices these are the good choices, otherwise both ends of the good range. This is
    the rule of one standard error (Breiman et al. 1984, section 3.4.3). Between trials that have the
    best values of the other keys, the objective is interpolated linearly. Any other trial that is
    good enough widens the range. The range does not go beyond the trials.
    """
    # Step 1: the trials that are good enough. A smaller objective is better.
    best = record.best
    limit = best.objective
    if isfinite(best.stderr):
        limit += best.stderr
    good = [t for t in record.trials if t.lost == best.lost and t.objective <= limit]
    if axis.choices:
        good_choices = {trial.values[axis.key] for trial in good}
        return [choice for choice in axis.choices if choice in good_choices]

    def share_of(trial: Trial) -> float:
        """Return the place of a trial on the axis, from 0 at its low end to 1 at its high end."""
        # Each value that was tried lies on its axis, so that it has a share.
        return axis.share(trial.values[axis.key]) or 0.0

    # Step 2: follow the axis from the best to both sides, as far as the objective stays good.
    # Shares below the best have a minus sign, so that they increase away from the best, too.
    best_share = share_of(best)
    below = []
    above = []
    for trial in record.trials_along(axis):
        share = share_of(trial)
        if share <= best_share:
            below.append((-share, trial.objective))
        if share >= best_share:
            above.append((share, trial.objective))
    low = -_follow_while_good(sorted(below), limit)
    high = _follow_while_good(sorted(above), limit)
    # Step 3: other good trials widen the range.
    good_shares = [share_of(trial) for trial in good]
    low = min([*good_shares, low])
    high = max([*good_shares, high])
    return [axis.at(low), axis.at(high)]


def _follow_while_good(line: list[tuple[float, float]], limit: float) -> float:
    """Return the share at which a line of points (share, objective) first reaches the limit.

    A share is a place on a key's axis. The points are sorted by it, and the objective of the first one
    is within the limit. The line is interpolated linearly between its points. If it stays below the
    limit, the last share is returned.
    """
    (share, objective), *others = line
    for next_share, next_objective in others:
        if not next_objective <= limit:  # NaN, of a failed filter, is not good either
            fraction = 0.0
            if isfinite(next_objective):
                fraction = (limit - objective) / (next_objective - objective)
            return share + (next_share - share) * fraction
        share = next_share
        objective = next_objective
    return share
