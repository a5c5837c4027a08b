"""Topics under which the experiments stand: what is estimated, and by which sensors."""

from trackbench.report.overview.open_experiments import Overview
from trackbench.report.tables_and_figures import Results

_RECORDINGS = "Recordings"
_RANGES_AND_ANGLES = "Targets seen by radar, lidar or bearings"
_POSITIONS = "Targets with measured positions"
_OTHERS = "Other dynamic systems"


def group_by_topic(experiments: Overview) -> dict[str, Overview]:
    """Group the experiments by topic: what is estimated, and by which sensors.

    Topics without experiments are left out.
    """
    groups: dict[str, Overview] = {}
    for topic in (_RECORDINGS, _RANGES_AND_ANGLES, _POSITIONS, _OTHERS):
        groups[topic] = []
    for results, comparison in experiments:
        groups[_topic(results)].append((results, comparison))
    return {topic: group for topic, group in groups.items() if group}


def _topic(results: Results) -> str:
    """Return the topic of an experiment: what is estimated, and by which sensors."""
    scenario = results.config["scenario"]
    # Recorded measurements, or a recorded path that is measured anew in every run.
    if (scenario.get("target") or {}).get("kind") in ("measured", "recorded"):
        return _RECORDINGS
    # The state of a target in space begins with px and vx.
    if results.facts(results.grid_points[0]).components[:2] != ["px", "vx"]:
        return _OTHERS
    sensors = scenario.get("sensor")
    if not isinstance(sensors, list):
        sensors = [sensors or {}]
    kinds = {sensor.get("kind") for sensor in sensors}
    if kinds <= {"position", "velocity"}:
        return _POSITIONS
    # All other sensors measure ranges or angles.
    return _RANGES_AND_ANGLES
