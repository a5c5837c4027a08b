"""Metrics of maneuver detection: delays, missed maneuvers, false maneuvers."""

from dataclasses import dataclass

import numpy as np

from trackbench.core.arrays import Array, Mask


@dataclass(frozen=True, eq=False)
class Onsets:
    """Sampling times (K,), starts (legs,), times that each leg covers (legs, K), quiet ones (K,)."""

    times: Array
    starts: tuple[float, ...]
    inside: Mask
    quiet: Mask

    def metrics(
        self, mode: Array, alarm: Array | None, age: Array | None = None
    ) -> dict[str, Array]:
        """Return numbers per run (M,) from mode weight, alarms and their age in s (K, M).

        ``delay_s[leg n]`` time from the onset to the first sample in the maneuvering mode, NaN where
        there is none; ``missed[leg n]`` 1 where the leg went by without one; ``already_on[leg n]`` 1
        where the mode was on before the onset, which is no detection; ``onset_age_s[leg n]`` how long
        before that sample the maneuver is then estimated to have begun, and ``onset_error_s[leg n]``
        estimated minus true onset, ``onset_off_s[leg n]`` its size, if the filter estimates it;
        ``false_alarms_per_1000`` alarms per 1000 quiet samples in the quiescent mode.
        """
        on = mode > 0.5  # the prior's row is NaN: off
        out: dict[str, Array] = {}
        begun = None if age is None else _last(self.times[:, None] - age)
        for n, (start, during) in enumerate(zip(self.starts, self.inside, strict=True), 1):
            if not during.any():
                continue  # shorter than the sampling time
            first = int(np.argmax(during))
            before = on[first - 1] if first else np.zeros(on.shape[1], dtype=np.bool_)
            found = on[during].any(axis=0)
            # The sample at the onset itself carries none of the turn; `during` starts after it.
            met = first + np.argmax(on[during], axis=0)
            delay = np.where(found & ~before, self.times[met] - start, np.nan)
            out[f"delay_s[leg {n}]"] = delay
            if begun is not None:
                error = begun[met, np.arange(len(met))] - start
                out[f"onset_error_s[leg {n}]"] = np.where(np.isnan(delay), np.nan, error)
                out[f"onset_off_s[leg {n}]"] = np.abs(out[f"onset_error_s[leg {n}]"])
                out[f"onset_age_s[leg {n}]"] = delay - error
            out[f"missed[leg {n}]"] = (~found).astype(float)
            out[f"already_on[leg {n}]"] = before.astype(float)
        out["false_alarms_per_1000"] = self._false_alarms(on, alarm)
        return out

    def _false_alarms(self, on: Mask, alarm: Array | None) -> Array:
        was_off = np.vstack([np.ones_like(on[:1]), ~on[:-1]])
        raised = on & was_off if alarm is None else alarm > 0.0
        quiet = self.quiet[:, None] & was_off
        return np.asarray(1000.0 * (raised & quiet).sum(axis=0) / quiet.sum(axis=0))


def _last(rows: Array) -> Array:
    """Return the last value (K, M) up to each row; NaN before the first."""
    number = np.arange(len(rows))[:, None]
    latest = np.maximum.accumulate(np.where(np.isnan(rows), 0, number), axis=0)
    return np.asarray(np.take_along_axis(rows, latest, axis=0))
