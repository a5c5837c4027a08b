"""Key `late` of a filter, which a scenario with late measurements demands."""

from trackbench.field_types import InvalidKeyError
from trackbench.models.assume import Assume
from trackbench.models.delays import Late


def treatment_of_late_measurements(assume: Assume) -> Late | None:
    """Return a filter's treatment of late measurements; None if it gets them on time.

    Raises InvalidKeyError if the filter model says neither.
    """
    # The filter is given every measurement on time, which bounds what it could reach with late ones.
    if assume.delay == "none":
        return None
    if assume.late is None:
        message = "measurements arrive late here: add `late: drop`, `apply` or `refilter`; to get"
        raise InvalidKeyError(f"{message} them on time, as a bound, `assume: {{delay: none}}`")
    if isinstance(assume.late, str):
        return Late(kind=assume.late)
    return assume.late
