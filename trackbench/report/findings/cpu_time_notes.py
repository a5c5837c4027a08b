"""Notes on CPU times: what those of programs in other languages include."""

from collections.abc import Sequence


def time_of_programs(labels: Sequence[str]) -> str:
    """Return what the CPU time of programs in other languages includes."""
    return (
        f"The time of {', '.join(labels)} includes the exchange of lines with the program, some "
        "microseconds a step."
    )
