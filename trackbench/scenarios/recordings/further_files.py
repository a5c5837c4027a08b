"""Properties that files of inputs and of the truth share with the measurements."""

from collections import Counter
from dataclasses import replace

from trackbench.scenarios.recordings.common_clock import ONE_RUN
from trackbench.scenarios.recordings.naming_of_columns import Naming, NamingKeys
from trackbench.scenarios.recordings.rows_and_reading_context import ReadingContext


def context_of_further_file(
    context: ReadingContext, naming: Naming, keys: NamingKeys, has_own_keys: bool
) -> ReadingContext:
    """Return the context with which `read_rows` begins a file of inputs or of the truth.

    It is that of the measurements, with their origin and clock, but without their runs, files and
    notices. If ``has_own_keys``, the file has keys of units and zones of its own; otherwise it shares
    those of the measurements. ``naming`` and ``keys`` are those of the file. The chosen runs are those
    of the measurements, and the one run of a file without names of runs.
    """
    further = replace(
        context,
        naming=naming,
        keys=keys,
        runs=[],
        files=[],
        notices=[],
        unavailable=Counter(),
        chosen=(*context.runs, ONE_RUN),
    )
    # `ReadingContext.check_idle_keys` reports keys of units and zones that no file uses: of several
    # files that share them, or of this one alone.
    if has_own_keys:
        further.used_keys = set()
        further.idle_keys = {}
    return further
