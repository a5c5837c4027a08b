"""The contract of a filter, held against a class: shapes, purity, independence of runs, the KF.

Every check says what it found in one line. A filter that cannot pass one by its nature says why in a
class attribute: ``contract_exemptions = {"kalman": "looks at no measurement"}``; the other names are
``shapes``, ``purity``, ``repeats``, ``independence`` and ``gaps``.
"""

from trackbench.contract.checks import ContractError, Finding
from trackbench.contract.run_checks import check_file, check_filter, report

__all__ = ["ContractError", "Finding", "check_file", "check_filter", "report"]
