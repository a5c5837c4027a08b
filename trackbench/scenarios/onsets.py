"""How a filter that switches meets the onsets of the turns: delays, misses, false alarms."""

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

    def metrics(self, mode: Array, alarm: Array | None) -> dict[str, Array]:
        """Numbers per run (M,) from the weight of the maneuvering mode and the alarms (K, M).

        ``delay_s[leg n]`` time from the onset to the first sample in the maneuvering mode, NaN where
        there is none; ``missed[leg n]`` 1 where the leg went by without one; ``already_on[leg n]`` 1
        where the mode was on before the onset, which is no detection;
        ``false_alarms_per_1000`` alarms per 1000 quiet samples in the quiescent mode.
        """
        on = mode > 0.5  # the prior's row is NaN: off
        out: dict[str, Array] = {}
        for n, (start, during) in enumerate(zip(self.starts, self.inside, strict=True), 1):
            if not during.any():
                continue  # shorter than the sampling time
            first = int(np.argmax(during))
            before = on[first - 1] if first else np.zeros(on.shape[1], dtype=np.bool_)
            found = on[during].any(axis=0)
            # The sample at the onset itself carries none of the turn; `during` starts after it.
            delay = self.times[during][np.argmax(on[during], axis=0)] - start
            out[f"delay_s[leg {n}]"] = np.where(found & ~before, delay, np.nan)
            out[f"missed[leg {n}]"] = (~found).astype(float)
            out[f"already_on[leg {n}]"] = before.astype(float)
        out["false_alarms_per_1000"] = self._false_alarms(on, alarm)
        return out

    def _false_alarms(self, on: Mask, alarm: Array | None) -> Array:
        was_off = np.vstack([np.ones_like(on[:1]), ~on[:-1]])
        raised = on & was_off if alarm is None else alarm > 0.0
        quiet = self.quiet[:, None] & was_off
        return np.asarray(1000.0 * (raised & quiet).sum(axis=0) / quiet.sum(axis=0))
