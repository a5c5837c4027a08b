"""What is stored beside the values per run, held against the same computed again."""

from collections.abc import Collection, Iterator
from typing import TYPE_CHECKING

import numpy as np

from trackbench.core.arrays import Array
from trackbench.report.results import Results
from trackbench.verification.findings import Finding, changed, rounding
from trackbench.verification.rounding import ROUNDING, relative

if TYPE_CHECKING:
    import pandas as pd

_GRAIN = 2e-3
"""Share of its span that a drawn track is rounded to, at most."""


def same_rows(
    results: Results, again: Results, labels: Collection[str | None]
) -> Iterator[Finding]:
    """What differs in the rows of summary.csv and per_step.csv of these labels."""
    for name in ("summary", "per_step"):
        a, b = (_rows(getattr(of, name), labels) for of in (results, again))
        keys = [column for column in b if column not in ("value", "stderr")]
        if not a[keys].equals(b[keys]):
            yield changed(f"{name}.csv: has other rows than are computed again")
            continue
        usual = (
            b["value"].abs().groupby([b[k] for k in keys if k not in _OF_STEPS]).transform("median")
        )
        scale = np.fmax(usual.to_numpy(), b["stderr"].abs().to_numpy())
        ends = [
            relative(a[end].to_numpy(), b[end].to_numpy(), scale) for end in ("value", "stderr")
        ]
        off = np.max(ends, axis=0, initial=0.0)
        if off.any():
            yield _finding(
                f"{name}.csv: {np.count_nonzero(off)} of {len(off)} rows differ", off, ROUNDING
            )


def same_arrays(
    results: Results, again: Results, name: str, labels: Collection[str]
) -> Iterator[Finding]:
    """What differs in a file of tracks; of filters only in those of these labels."""
    stored, now = results.arrays(name), again.arrays(name)
    if stored.keys() != now.keys():
        yield changed(f"{name}: holds other arrays than are computed again")
        return
    for key, array in now.items():
        inner = key.partition("/")[2] if key.startswith("point") else key
        label = inner.partition("/")[2]
        if label and label not in labels:
            continue
        first = stored[key][..., : array.shape[-1]]
        off = relative(first, array, np.abs(array[np.isfinite(array)]).max(initial=0.0))
        if off.any():
            least = _GRAIN if array.dtype == np.float32 else ROUNDING
            yield _finding(f"{name}: {key} differs", off, least)


def _finding(what: str, off: Array, least: float) -> Finding:
    by = f"{what} by {off.max():.1e} at most"
    return rounding(by) if off.max() <= least else changed(f"{by}, more than rounding")


def _rows(frame: "pd.DataFrame", labels: Collection[str | None]) -> "pd.DataFrame":
    return frame[frame["filter"].isin(list(labels))].reset_index(drop=True)


_OF_STEPS = ("step", "time", "runs", "lost")
