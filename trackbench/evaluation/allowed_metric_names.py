"""Names that a plugin may give to a metric of its scenario and to a diagnostic of its filter."""

import re
from collections.abc import Iterable

from trackbench.filters.base import WrongReturnError
from trackbench.metrics import is_reserved

_WORD = re.compile(r"[\w.-]+")
_METRIC = re.compile(_WORD.pattern + r"(\[[^\[\]\x00-\x1f]+\])?")


def check_metric_names(names: Iterable[str]) -> None:
    """Raise WrongReturnError, a ValueError, at a name that a metric of a scenario cannot have."""
    for name in names:
        if not _METRIC.fullmatch(name):
            why = "use letters, digits, . _ - and what it is of as in detection_delay_s[leg 1]"
            raise WrongReturnError("run_metrics", f"a metric cannot be named {name!r}: {why}")


def check_diagnostic_names(names: Iterable[str]) -> None:
    """Check the names of a filter's diagnostics.

    Names of metrics of the errors, such as ``rmse_x``, are reserved.

    Parameters
    ----------
    names
        names of the diagnostics

    Raises
    ------
    WrongReturnError
        a ValueError, for the first name that is no word or is reserved
    """
    for name in names:
        if is_reserved(name):
            why = "as metrics of errors are"
            raise WrongReturnError("diagnostics", f"a diagnostic cannot be named {name!r}, {why}")
        if not _WORD.fullmatch(name):  # rmse[k<=30] and mean(rmse) are metrics of errors, too
            why = "use letters, digits, . _ -"
            raise WrongReturnError("diagnostics", f"a diagnostic cannot be named {name!r}: {why}")
