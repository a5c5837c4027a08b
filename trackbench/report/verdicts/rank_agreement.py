"""Agreement of the measured order of the filters with the published one: Kendall's tau."""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from math import isfinite, nan
from typing import Any, NamedTuple

import numpy as np

from trackbench.report.verdicts.number_verdicts import Compared


class Ranked(NamedTuple):
    """Agreement of the order of the filters in one column of a published table."""

    paper: str
    table: str
    metric: str
    """the column, and the row behind a comma if the table has several of it"""
    filters: int
    """number of filters in the column"""
    tau: float
    """Kendall's tau-b: 1 for equal orders, -1 for opposite ones; NaN if one side is constant"""


def rank_agreement(rows: list[Compared]) -> Iterator[Ranked]:
    """Yield the agreement of the filters' published and measured order, Kendall's tau.

    Each column of a published table with three or more filters has one.
    """
    # Step 1: collect the columns of the published tables: a metric, and a row if the table has several.
    columns: dict[tuple[str, str, str, str], list[Compared]] = defaultdict(list)
    for row in rows:
        published = row.published
        # A published value that is a text is a word on a bias, and has no order.
        if isfinite(row.measured.value) and not isinstance(published.value, str):
            key = (published.paper, published.table, published.row, published.metric)
            columns[key].append(row)
    # Step 2: compare the orders, except of columns in which a filter has several readings.
    for (paper, table, table_row, metric), column in columns.items():
        filters = {row.published.filter for row in column}
        if len(column) < 3 or len(filters) < len(column):
            continue
        published_values = [row.published.value for row in column]
        measured_values = [row.measured.value for row in column]
        yield Ranked(
            paper=paper,
            table=table,
            metric=", ".join(filter(None, [metric, table_row])),
            filters=len(column),
            tau=kendall(published_values, measured_values),
        )


def kendall(a: Sequence[Any], b: Sequence[Any]) -> float:
    """Return Kendall's tau-b of two orders; NaN if one is constant (Kendall 1945, Biometrika 33)."""
    # The matrices have each pair twice, so that sums over pairs are half of theirs.
    signs_a = np.sign(np.subtract.outer(a, a))
    signs_b = np.sign(np.subtract.outer(b, b))
    untied_a = np.count_nonzero(signs_a) / 2
    untied_b = np.count_nonzero(signs_b) / 2
    if not untied_a or not untied_b:
        return nan
    # tau_b = sum over pairs of sign(da) sign(db) / sqrt(untied pairs of a, times those of b)
    tau = np.sum(signs_a * signs_b) / 2 / np.sqrt(untied_a) / np.sqrt(untied_b)
    return float(np.clip(tau, -1.0, 1.0))
