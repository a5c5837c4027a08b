"""Entries of a config with one filter: if it fits with the keys of one, other keys are at fault."""

from collections.abc import Sequence

from trackbench.config.experiment import Point
from trackbench.contract.checks import CHECKS
from trackbench.contract.findings import Finding
from trackbench.contract.problems import ModelDraws
from trackbench.contract.run_contract import check_filter
from trackbench.filters.base import AnyFilter


def check_entries(
    cls: type[AnyFilter], point: Point, labels: Sequence[str]
) -> dict[str, list[Finding]]:
    """Check a filter class with the keys of each of its entries in a config; return findings by label.

    ``labels`` are those of the entries, and ``point`` is a point of the config's grid. A filter is
    checked on data from the model that its entry assumes.

    If the filter is consistent with the keys of one entry, its code is right, and the keys of other
    entries are at fault: their check of consistency is then left out.
    """
    # Step 1: check each entry.
    findings_by_label = {}
    for label in labels:
        problem = ModelDraws(base=point.assumed_scenario(label))
        findings_by_label[label] = list(check_filter(cls, point.filters[label], on=problem))
    # Step 2: if one entry is consistent, the others have keys that do not fit.
    consistency, _ = CHECKS["consistency"]  # the title of the check
    good_finding = Finding(consistency, "good")  # the finding of a consistent entry
    if not any(good_finding in findings for findings in findings_by_label.values()):
        return findings_by_label
    for findings in findings_by_label.values():
        for i, finding in enumerate(findings):
            if finding.check == consistency and finding.verdict == "bad":
                why = f"fits with other keys; with these {finding.why}"
                findings[i] = finding._replace(verdict="left out", why=why)
    return findings_by_label
