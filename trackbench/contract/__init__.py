"""Contract of a filter: checks that every filter must pass, and the diagnosis of a failure."""

from trackbench.contract.check_filters_of_file import check_file

__all__ = ["check_file"]
