"""Detection of maneuvers: missed ones, false alarms and the delay, by the weight of a mode."""

from dataclasses import dataclass

import numpy as np

from trackbench.core.arrays import Array, Mask


@dataclass(frozen=True, eq=False)
class Onsets:
    """Onsets of maneuvers, against which a filter's detections are measured."""

    times: Array
    """sampling times (K,), s"""
    starts: tuple[float, ...]
    """time at which each leg starts, s"""
    inside: Mask
    """samples that each leg covers (legs, K)"""
    quiet: Mask
    """samples (K,) of settled straight flight"""

    def metrics(
        self, mode: Array, alarm: Array | None, age: Array | None = None
    ) -> dict[str, Array]:
        """Measure in each run how a filter detects maneuvers.

        Parameters
        ----------
        mode : array (K, M)
            Weight of the filter's maneuvering mode, NaN in the prior's row. The mode is on above 0.5.
        alarm : array (K, M) or None
            Positive where the filter raises an alarm. Without it each switching on of the mode is an
            alarm.
        age : array (K, M) or None
            Estimated time since the onset of the maneuver, s, NaN without an alarm. None if the filter
            does not estimate it.

        Returns
        -------
        dict of array (M,)
            Number of each run, by the metric's name:

            - ``detection_delay_s[leg n]``: time from the onset to the first sample in the maneuvering
            mode, s.
              NaN if there is none, or if the mode was on before the onset.
            - ``missed_maneuvers[leg n]``: 1 for a leg without that mode.
            - ``already_maneuvering[leg n]``: 1 if the mode was on before the onset.
            - ``onset_age_s[leg n]``: time from the estimated onset to that sample, s.
            - ``onset_error_s[leg n]``: estimated minus true onset, s.
            - ``onset_abs_error_s[leg n]``: its size, s.
            - ``false_maneuvers_per_1000``: alarms per 1000 quiet samples before which the mode was off.
        """
        is_on = mode > 0.5  # the prior's row is NaN: off
        # The estimate of an alarm counts until the next one.
        estimated_onset = None
        if age is not None:
            estimated_onset = _carry_last(self.times[:, None] - age)
        metrics: dict[str, Array] = {}
        for n, (start, during) in enumerate(zip(self.starts, self.inside, strict=True), 1):
            if not during.any():
                continue  # shorter than the sampling time
            # Mode just before the leg, and whether it comes on during the leg.
            first = int(np.argmax(during))
            was_on = np.zeros(is_on.shape[1], dtype=np.bool_)
            if first > 0:
                was_on = is_on[first - 1]
            detected = is_on[during].any(axis=0)
            # The sample at the onset itself carries none of the turn; `during` starts after it.
            sample = first + np.argmax(is_on[during], axis=0)
            # Delay from the onset to that sample, if the mode was off before.
            delay = np.where(detected & ~was_on, self.times[sample] - start, np.nan)
            metrics[f"detection_delay_s[leg {n}]"] = delay
            if estimated_onset is not None:
                # Estimated onset (time less the alarm's age) minus the true one.
                error = estimated_onset[sample, np.arange(len(sample))] - start
                detected_error = np.where(np.isnan(delay), np.nan, error)
                metrics[f"onset_error_s[leg {n}]"] = detected_error
                metrics[f"onset_abs_error_s[leg {n}]"] = np.abs(detected_error)
                metrics[f"onset_age_s[leg {n}]"] = delay - error
            metrics[f"missed_maneuvers[leg {n}]"] = (~detected).astype(float)
            metrics[f"already_maneuvering[leg {n}]"] = was_on.astype(float)
        metrics["false_maneuvers_per_1000"] = self._false_alarms(is_on, alarm)
        return metrics

    def _false_alarms(self, is_on: Mask, alarm: Array | None) -> Array:
        """Return each run's false alarms (M,) per 1000 quiet samples whose predecessor is off.

        ``is_on`` (K, M) marks the samples in the maneuvering mode; ``alarm`` (K, M) is positive where
        the filter raises an alarm. Without ``alarm`` each switching on is one.
        """
        # The first sample has no predecessor, and counts as one after an off.
        was_off = np.vstack([np.ones_like(is_on[:1]), ~is_on[:-1]])
        raised = is_on & was_off
        if alarm is not None:
            raised = alarm > 0.0
        quiet = self.quiet[:, None] & was_off
        return np.asarray(1000.0 * (raised & quiet).sum(axis=0) / quiet.sum(axis=0))


def _carry_last(rows: Array) -> Array:
    """Return ``rows`` (K, M) with each NaN replaced by the last value above it, if there is one."""
    row_number = np.arange(len(rows))[:, None]
    latest = np.maximum.accumulate(np.where(np.isnan(rows), 0, row_number), axis=0)
    return np.asarray(np.take_along_axis(rows, latest, axis=0))
