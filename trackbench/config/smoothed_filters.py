"""Smoothed copies of filters: those that the key `smoothed` names."""

import copy

from trackbench.config.filter_copies import is_entry, put_after_originals
from trackbench.config.overrides import override
from trackbench.yaml_source import Source, put


def add_smoothed(source: Source) -> None:
    """Add a copy with ``smooth: true`` after each filter of the key ``smoothed``.

    An existing entry of this filter with a smoother, as in the config of a results folder, stays.
    """
    labels = source.data.get("smoothed")
    if not isinstance(labels, list):
        return
    copies: dict[str, str] = {}
    for i, label in enumerate(labels):
        if not isinstance(label, str) or not is_entry(source, label):
            continue
        smoothed_label = f"{label}, smoothed"
        copies[label] = smoothed_label
        filters = source.data["filters"]
        if not is_entry(source, smoothed_label):
            mark = source.mark(("smoothed", i))
            put(filters, smoothed_label, copy.deepcopy(filters[label]), mark, mark)
            override(source, ("filters", smoothed_label, "smooth"), True, mark)
            continue
        # The existing entry must be that of the filter, with a smoother.
        original = {**filters[label], "smooth": None}
        smoothed = {**filters[smoothed_label], "smooth": None}
        if original != smoothed or not filters[smoothed_label].get("smooth"):
            message = f"there is another filter {smoothed_label!r}: give it another label"
            source.add_problem(("smoothed", i), message)
    if copies:
        put_after_originals(source, copies)
