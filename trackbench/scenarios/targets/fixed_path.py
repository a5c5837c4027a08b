"""A target that flies the same path in every run: only its measurements differ."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.random_streams import Streams
from trackbench.models.sensors.stacked import Sensors
from trackbench.scenarios.targets.base import Flight, Scored, Target, Timeline, measured_along


@dataclass(frozen=True, kw_only=True)
class Flown(Target):
    """Base of the targets with a path of their own."""

    def states(self, times: Array) -> Array:
        """Return exact states (n_x, K) at these times, s."""
        raise NotImplementedError

    def start(self, timeline: Timeline) -> Array:
        """Return the state (n_x,) at the first scan."""
        return self.states(timeline.times[:1])[:, 0]

    def path(self, timeline: Timeline) -> Array:
        """Return states (n_x, K)."""
        return self.states(timeline.times)

    def fly(
        self, start: Array, timeline: Timeline, sensor: Sensors, rng: Streams, scans: int
    ) -> Flight:
        """Return the path, and measurements whose noise is drawn in one go."""
        path = self.path(timeline)[..., None]
        return measured_along(path, timeline, sensor, rng, scans, start.shape[1])

    def run_metrics(self, values: Mapping[str, Array], scored: Scored) -> dict[str, Array]:
        """Return ``peak_position``, the largest error in a window, m, and ``beyond_10_sigma``.

        Beyond ten standard deviations of a measurement none would be taken for the track's any more.
        """
        squared = values["squared_position"]
        peaks = {n: np.sqrt(squared[m].max(axis=0)) for n, m in scored.windows.items()}
        return scored.of_peaks(peaks)
