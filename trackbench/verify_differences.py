"""Compare stored numbers with recomputed ones, and tell rounding from a change.

Another processor or library changes the last bit of a number. A filter that draws nothing passes it on,
enlarged by the condition of its matrices: by 1e-5 at most between two types of processor. A filter that
draws may amplify it until a run has nothing in common with the stored run. Stored and recomputed values
are then exchangeable, and their differences over common runs are symmetric about zero (`p_of_chance`).
"""

from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.report.render import write_tables
from trackbench.report.results import Results
from trackbench.report.sweep import write_sweep
from trackbench.report.verdicts.files import FILES, write_comparison, write_paired
from trackbench.report.verdicts.numbers import compare
from trackbench.results.folder_contents import DATA_FILES, TIME_VERDICTS, check_digests
from trackbench.statistics.intervals import p_value
from trackbench.statistics.over_runs import mean, z_score

if TYPE_CHECKING:
    pass

SAME, ROUNDING, CHANGED = "the same bytes", "the same but for rounding", "changed"
"""Verdicts on a folder; the last one is a failure."""
TOLERANCE = 1e-4
"""Share of a value, or of its column's median, by which rounding may change it."""
FALSE_ALARM = 1e-3
"""Probability that chance makes any filter and metric of a folder look changed."""
FAR = 4.0
"""Standard errors by which a statistic of a filter that draws may differ."""
_LAST_DIGITS = 1e-6
"""Share of a number by which another order of a sum may change it."""
_TRACK_STEP = 2e-3
"""Share of its span to which a track of a figure is rounded, at most."""


class Finding(NamedTuple):
    """A difference in a line, and whether rounding explains it."""

    text: str
    is_rounding: bool


def changed(text: str) -> Finding:
    """Return a finding that rounding cannot explain."""
    return Finding(text, False)


def rounding(text: str) -> Finding:
    """Return a finding that rounding explains."""
    return Finding(text, True)


def verdict(findings: Sequence[Finding]) -> str:
    """Return the verdict that follows from all findings of a folder."""
    if not findings:
        return SAME
    return ROUNDING if all(finding.is_rounding for finding in findings) else CHANGED


@np.errstate(all="ignore")
def relative(a: Array, b: Array, scale: Array | float = 0.0) -> Array:
    """Return differences (n,) as shares of the larger value or the scale; infinite if one is NaN."""
    share = np.abs(a - b) / np.maximum(np.maximum(np.abs(a), np.abs(b)), scale)
    return np.where((a == b) | (np.isnan(a) & np.isnan(b)), 0.0, np.nan_to_num(share, nan=np.inf))


def usual(x: Array) -> float:
    """Return the median absolute value of the finite numbers in a column; zero without any."""
    finite = np.abs(x[np.isfinite(x)])
    return float(np.median(finite)) if len(finite) else 0.0


@np.errstate(all="ignore")
def differences(a: Array, b: Array) -> Array:
    """Return ``a - b`` of the runs (M,) with two finite values, with rounding set to zero."""
    both = np.isfinite(a) & np.isfinite(b)
    is_real = relative(a, b, usual(a)) > TOLERANCE
    return np.where(is_real, a - b, 0.0)[both]


def p_of_chance(difference: Array) -> float:
    """Return the p-value of differences (M,) under a distribution that is symmetric about zero.

    It is twice the smaller one of Student's t, which heavy tails blind, and of the sign test.
    """
    from scipy.special import bdtr

    up, down = int((difference > 0).sum()), int((difference < 0).sum())
    if up + down == 0:
        return 1.0
    p_t = p_value(z_score(mean(difference)), len(difference))
    p_sign = 2.0 * float(bdtr(min(up, down), up + down, 0.5))
    return min(1.0, 2.0 * float(np.nanmin([p_t, p_sign])))


def compare_rows(
    stored: Results,
    again: Results,
    labels: Collection[str],
    equal: Collection[str] = (),
    drawing: Collection[str] = (),
) -> Iterator[Finding]:
    """Yield differences in summary.csv and per_step.csv.

    Both must have the same filters and metrics. Numbers are compared for the filters in ``labels``.
    Filters in ``equal`` have the same values per run, and those in ``drawing`` may differ by `FAR`
    standard errors. A missing per_step.csv is left out.
    """
    for name in ("summary", "per_step"):
        if not (stored.folder / f"{name}.csv").is_file():
            continue
        # Step 1: the same rows, of the compared filters.
        kinds = [*stored.grid, "filter", "metric"]
        a, b = (getattr(results, name) for results in (stored, again))
        pairs = [set(frame[kinds].itertuples(index=False, name=None)) for frame in (a, b)]
        kept = [frame[frame["filter"].isin(list(labels))] for frame in (a, b)]
        a, b = (frame.reset_index(drop=True) for frame in kept)
        keys = [column for column in b if column not in ("value", "stderr")]
        if pairs[0] != pairs[1] or not a[keys].equals(b[keys]):
            yield changed(f"{name}.csv: has other rows than are computed again")
            continue
        # Step 2: differences, relative to the metric's median and to the standard error.
        same_metric = [b[key] for key in keys if key not in ("step", "time", "runs", "lost")]
        medians = b["value"].abs().groupby(same_metric).transform("median").to_numpy()
        scale = np.fmax(medians, b["stderr"].abs().to_numpy())
        ends = [relative(a[x].to_numpy(), b[x].to_numpy(), scale) for x in ("value", "stderr")]
        off = np.max(ends, axis=0, initial=0.0)
        # Step 3: filters that draw may differ by chance.
        is_near = (a["value"] - b["value"]).abs() <= FAR * np.hypot(a["stderr"], b["stderr"])
        by_chance = a["filter"].isin(list(drawing)) & (is_near | (ends[0] <= TOLERANCE))
        off = np.where(by_chance, np.minimum(off, TOLERANCE), off)
        if off.any():
            tolerance = np.where(a["filter"].isin(list(equal)), _LAST_DIGITS, TOLERANCE)
            what = f"{name}.csv: {np.count_nonzero(off)} of {len(off)} rows differ"
            yield _by(what, off, tolerance)


def _by(what: str, off: Array, tolerance: Array | float) -> Finding:
    text = f"{what} by {off.max():.1e} at most"
    is_rounding = bool((off <= tolerance).all())
    return rounding(text) if is_rounding else changed(f"{text}, more than rounding")


def compare_arrays(
    stored: Results, again: Results, name: str, labels: Collection[str]
) -> Iterator[Finding]:
    """Yield differences in a file of tracks, for the truth and the filters in ``labels``."""
    arrays, computed = stored.arrays(name), again.arrays(name)
    if arrays.keys() != computed.keys():
        yield changed(f"{name}: holds other arrays than are computed again")
        return
    for key, array in computed.items():
        inner = key.partition("/")[2] if key.startswith("point") else key
        label = inner.partition("/")[2]
        if label and label not in labels:
            continue
        first = arrays[key][..., : array.shape[-1]]
        off = relative(first, array, np.abs(array[np.isfinite(array)]).max(initial=0.0))
        if off.any():
            is_rounded = array.dtype == np.float32
            yield _by(f"{name}: {key} differs", off, _TRACK_STEP if is_rounded else TOLERANCE)


def compare_digests(stored: Results, again: Results, drawing: Collection[str]) -> Iterator[Finding]:
    """Yield differences of all recomputed runs from a folder that has only the digests of its runs."""
    digests = stored.manifest["files"]
    names = [name for name in (*DATA_FILES, "summary.csv") if name in digests]
    other = check_digests(again.folder, {name: digests[name] for name in names}).changed
    rows = [*compare_rows(stored, again, stored.labels, drawing=drawing)]
    yield from rows
    is_rounding = "summary.csv" in other and all(finding.is_rounding for finding in rows)
    for name in other:
        if name != "summary.csv":
            yield Finding(f"{name}: has another digest when it is computed again", is_rounding)
    if not other:
        yield from compare_derived(again, stored.folder)


def compare_derived(results: Results, folder: Path) -> Iterator[Finding]:
    """Yield differences of a folder's tables and verdicts from those that follow from the results.

    These are written to the target of the results.
    """
    write_tables(results, tex=True)
    for what, line in zip(results.unmade, results.unmade_lines, strict=True):
        if (folder / "tables" / f"{what.removeprefix('table ')}.csv").is_file():
            yield changed(line)
    write_paired(results)
    write_comparison(results, compare(results))
    if (folder / "sweep.csv").is_file():
        write_sweep(results)
    written = {p.relative_to(results.target) for p in results.target.rglob("*") if p.is_file()}
    for name in sorted(written):
        stored, computed = folder / name, results.target / name
        is_optional = name.suffix == ".tex" or name.parts[0] == "run"
        if not stored.is_file():
            if not is_optional:
                yield changed(f"{name}: is not there")
        elif stored.read_bytes() != computed.read_bytes():
            yield _difference(name, stored, computed)
    for name in map(Path, (*FILES, TIME_VERDICTS)):
        if (folder / name).is_file() and name not in written:
            yield changed(f"{name}: nothing is published about this experiment")


def _difference(name: Path, stored: Path, computed: Path) -> Finding:
    texts = (path.read_text(encoding="utf-8", errors="replace") for path in (stored, computed))
    a, b = ([line.split(",") for line in text.splitlines()] for text in texts)
    pairs = [(x, y) for x, y in zip(a, b, strict=False) if x != y]
    if len(a) != len(b):
        return changed(f"{name}: has {len(a)} lines, of the stored runs it has {len(b)}")
    shares = [share for x, y in pairs for share in _shares(x, y)]
    if name.suffix == ".csv" and max(shares, default=0.0) <= _LAST_DIGITS:
        return rounding(f"{name}: {len(shares)} numbers differ, by {max(shares):.1e} at most")
    x, y = (",".join(row) for row in pairs[0])
    what = f"{len(pairs)} rows do not follow from the stored runs; the first is"
    return changed(f"{name}: {what} {x!r}, it should be {y!r}")


def _shares(x: list[str], y: list[str]) -> Iterator[float]:
    """Yield relative differences of unequal cells in two rows; infinite unless both are numbers."""
    if len(x) != len(y):
        yield np.inf
    for a, b in zip(x, y, strict=False):
        if a != b:
            try:
                yield float(relative(np.array(float(a)), np.array(float(b))))
            except ValueError:
                yield np.inf
