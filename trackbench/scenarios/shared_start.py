"""Note on one `given` start for several recordings, of which some begin a step before their rows."""

from collections.abc import Iterable
from pathlib import Path

from trackbench.errors import first_names
from trackbench.scenarios.base import Scenario
from trackbench.scenarios.recordings.rows_and_reading_context import ONE_RUN, TICK
from trackbench.scenarios.recordings.run_names_of_truth import MOST_NAMES
from trackbench.scenarios.starts.given import GivenStart
from trackbench.scenarios.targets.measured import Measured
from trackbench.scenarios.tracking import Tracking


def note_on_shared_start(scenarios: Iterable[Scenario]) -> list[str]:
    """Return a note, in a list, if one start is a state at the first row of some recordings alone.

    The first state of the others lies before their first row.

    Parameters
    ----------
    scenarios : iterable of Scenario
        Scenarios of the points of a grid.

    Returns
    -------
    list of str
        One note. Empty if there is no such start.
    """
    # Names of the recordings by the mean of their start: those that begin at a row, and the others.
    at_first_rows: dict[str, list[str]] = {}
    before_rows: dict[str, list[str]] = {}
    for scenario in scenarios:
        if not isinstance(scenario, Tracking) or not isinstance(scenario.start, GivenStart):
            continue
        target = scenario.target
        if not isinstance(target, Measured):
            continue
        names = at_first_rows if target.time_before_rows < TICK else before_rows
        of_start = names.setdefault(str(scenario.start.mean), [])
        name = ", ".join(target.run_names)
        if target.run_names == (ONE_RUN,):
            name = Path(target.measurement_files[0]).name
        if name not in of_start:
            of_start.append(name)
    for mean, at_first_row in at_first_rows.items():
        before = before_rows.get(mean)
        if before is None:
            continue
        return [
            f"`start` is the state at the first row in {first_names(at_first_row, MOST_NAMES)}, and a "
            f"step before it in {first_names(before, MOST_NAMES)}: give each its own, `grid: "
            "{scenario.target.runs & scenario.start.mean: [...]}`"
        ]
    return []
