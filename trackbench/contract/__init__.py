"""Contract of a filter: shapes, purity, independence of the runs, agreement with the Kalman filter.

Every check reports in one line. A filter that cannot pass a check by its nature gives the reason in
a class attribute: ``contract_exemptions = {"kalman": "uses no measurement"}``. The other names are
``shapes``, ``purity``, ``repeats``, ``independence`` and ``gaps``.
"""

from trackbench.contract.checks import ContractError, Finding, check_file, check_filter, report

__all__ = ["ContractError", "Finding", "check_file", "check_filter", "report"]
