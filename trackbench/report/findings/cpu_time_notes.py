"""Notes on the CPU times of a table: small blocks, filters that loop over runs, external programs."""

from collections.abc import Sequence

from trackbench.report.findings.phrases import named

_FULL_BLOCK = 100
"""Runs that share the calls of a block so that a run's CPU time hardly depends on their number."""
RUN_BY_RUN = "filtered run by run, which is slower than the method."


def small_block_notes(runs: int) -> list[str]:
    """Note that the CPU time of a run depends on the number of runs; empty if it hardly does."""
    if 1 < runs < _FULL_BLOCK:
        return ["CPU times: a run takes less in blocks of more runs."]
    return []


def time_of_programs(labels: Sequence[str]) -> str:
    """Return what the CPU time of programs in other languages includes."""
    return (
        f"The time of {', '.join(map(named, labels))} includes the exchange of lines with the program, "
        "some microseconds a step."
    )
