"""Contract of a filter: checks that every filter must pass, and the diagnosis of a failure."""

from trackbench.contract.filters_to_check import check_file

__all__ = ["check_file"]
