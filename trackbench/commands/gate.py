"""A gate for continuous integration: is a filter worse than stored, or than at a git revision?"""

import os
import re
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from math import isnan, nan
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from trackbench.commands.prepare import Options, file_of, prepare
from trackbench.commands.run_experiment import run_all
from trackbench.errors import Mark, Problem, UserError
from trackbench.evaluation.metric_expression import measured
from trackbench.report.compare_folders import Row, compare_folders, is_event
from trackbench.report.findings.phrases import heading, named
from trackbench.report.open import open_results
from trackbench.report.paired import primary_metrics
from trackbench.report.results import Results
from trackbench.results.folder_contents import TIMING
from trackbench.statistics import rules
from trackbench.statistics.comparison import compare_independent
from trackbench.statistics.estimates import RunEstimate
from trackbench.statistics.rules import ALIKE, BETTER, EQUAL, UNTESTED, WORSE

NEGLIGIBLE = "negligible"
_LIMIT = re.compile(r"(\d+(?:\.\d+)?)sigma(?:,(\d+(?:\.\d+)?)%)?")


class Limit(NamedTuple):
    """Family-wise false alarm rate as standard deviations, and the share of a value that matters."""

    sigmas: float
    share: float


class Verdict(NamedTuple):
    """Result of a gate: its tests, and lines on filters and folders that could not be compared."""

    name: str
    rows: list[Row]
    failed: list[str]
    removed: list[str]
    """filters, points of the grid and numbers that were there before, and are not allowed to go"""
    notes: list[str]

    @property
    def is_worse(self) -> bool:
        """True if a number is worse beyond the limit, or a filter fails or is gone that was not."""
        is_any_worse = any(row.verdict == WORSE for row in self.rows)
        return bool(self.failed) or bool(self.removed) or is_any_worse

    @property
    def compared(self) -> list[str]:
        """Labels of the filters that both sides have."""
        return [*dict.fromkeys(row.filter for row in self.rows)]


def limit_of(text: str) -> Limit:
    """Parse ``3sigma`` or ``3sigma,1%``; raises UserError."""
    match = _LIMIT.fullmatch(text.replace(" ", ""))
    if match is None:
        what = "is no limit such as 3sigma, or 3sigma,1% (both must be exceeded)"
        raise UserError(Problem(Mark(f"--worse {text}"), "", what))
    return Limit(float(match[1]), float(match[2] or 0.01) / 100.0)


def gate(
    config: Path, options: Options, limit: Limit, against: Path | None = None, ref: str = "",
    file: Path | None = None, cost: float = 0.0, allow_removed: bool = False,
) -> Verdict:  # fmt: skip
    """Run a config and compare it with stored results, or with the config at a git revision.

    Nothing is written but the cache. ``cost`` is the largest ratio of costs, 0 for any. What was
    compared before and is gone is a failure unless ``allow_removed``.
    """
    config = Path(str(file_of(config, options)))
    options = replace(options, times=cost > 0.0, formats=())
    now = replace(options, filters=[file] if file else [])
    name = prepare(config, now).settings.name
    with TemporaryDirectory() as home:
        if against is not None:
            inner = against / name
            stored = open_results(inner if (inner / "config.yaml").is_file() else against)
        else:
            with _at_ref(ref, config, file, Path(home)) as (old, files):
                stored = _run(old, replace(options, filters=files), Path(home, "old"))
        verdict = _judged(stored, _run(config, now, Path(home, "new")), limit, cost)
    if not allow_removed or not verdict.removed:
        return verdict
    notes = [*verdict.notes, *(f"{what}: removed" for what in verdict.removed)]
    return verdict._replace(removed=[], notes=notes)


def _run(config: Path, options: Options, folder: Path) -> Results:
    words = ("figures={}", "key_figure=null", *options.set)
    (report,) = run_all([config], replace(options, set=words, out=folder))
    return report.results


@contextmanager
def _at_ref(
    ref: str, config: Path, file: Path | None, home: Path
) -> Iterator[tuple[Path, list[Path]]]:
    """Check out a revision of the repository of the config or filter; yield their paths in it.

    The repository stays as it is: the index of the revision is a temporary file.
    """
    top = next(filter(None, (_top(path) for path in (config, file) if path)), None)
    if top is None:
        raise _ref_error(ref, f"{config} is in no git repository")
    tree = home / "tree"
    _git(ref, top, home, "read-tree", f"{ref}^{{commit}}")
    _git(ref, top, home, "checkout-index", "--all", f"--prefix={tree}/")

    def moved(path: Path) -> Path:
        inside = path.resolve().is_relative_to(top)
        return tree / path.resolve().relative_to(top) if inside else path

    if not moved(config).is_file():
        raise _ref_error(ref, f"has no file {config}")
    try:  # a filter file that is new has nothing to be compared with
        yield moved(config), [moved(file)] if file and moved(file).is_file() else []
    except UserError as error:  # with the names that a user knows
        lines = (str(p).replace(f"{tree}{os.sep}", f"{ref}:") for p in error.problems)
        raise UserError(*lines) from error


def _top(path: Path) -> Path | None:
    """Find the top folder of a file's git repository, if it is in one."""
    command = ["git", "-C", str(path.resolve().parent), "rev-parse", "--show-toplevel"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return None
    return Path(done.stdout.strip()).resolve()


def _git(ref: str, top: Path, home: Path, *words: str) -> None:
    env = {**os.environ, "GIT_INDEX_FILE": str(home / "index")}
    done = subprocess.run(["git", "-C", str(top), *words], capture_output=True, text=True, env=env)
    if done.returncode:
        lines = done.stderr.strip().splitlines() or ["git failed"]
        raise _ref_error(ref, lines[-1].removeprefix("fatal: "))


def _ref_error(ref: str, what: str) -> UserError:
    return UserError(Problem(Mark(f"--against-ref {ref}"), "", what))


def _judged(stored: Results, now: Results, limit: Limit, cost: float) -> Verdict:
    """Judge the primary metrics of the filters that both have."""
    rows, why = compare_folders(stored, now)
    with_rows = {*stored.columns("summary")["filter"].tolist()}
    before = [label for label in stored.filters if label in with_rows]
    notes = [f"not paired: {why}"] if why else []
    notes += [f"{label}: new, not compared" for label in now.filters if label not in before]
    failed = [f"{f['filter']} failed: {f['reason']}" for f in now.failed if f["filter"] in before]
    rows = judge([row for row in rows if row.is_primary], limit)
    removed = [*_removed(stored, now, before)]
    if not rows and not failed and not removed:
        raise UserError("nothing to compare: no filter has an error or score on both sides")
    rows += _costs(stored, now, cost)
    return Verdict(now.config["name"], rows, failed, removed, notes)


def _removed(stored: Results, now: Results, before: Sequence[str]) -> Iterator[str]:
    """Yield the filters, the points of the grid, and the errors and scores that are gone."""
    gone = [label for label in before if label not in now.config["filters"]]
    yield from map(named, gone)
    yield from (heading(point) for point in stored.points() if point not in now.points())
    failed = {row["filter"] for row in now.failed}
    names = _errors_and_scores(now)
    for label, metrics in _errors_and_scores(stored).items():
        if label in names and label not in failed:
            missing = [metric for metric in metrics if metric not in names[label]]
            yield from (f"{metric} of {named(label)}" for metric in missing)


def _errors_and_scores(results: Results) -> dict[str, list[str]]:
    """Return the errors and scores over whole runs of each filter, by label."""
    names: dict[str, dict[str, None]] = {}
    for row in results.columns("summary").records():
        of = measured(row["metric"])
        if not of.window and row["filter"] in results.filters:
            names.setdefault(row["filter"], {}).update(dict.fromkeys(primary_metrics([of.metric])))
    return {label: [*metrics] for label, metrics in names.items()}


def judge(rows: Sequence[Row], limit: Limit) -> list[Row]:
    """Judge the rows by one-sided p-values (Holm)."""
    zs = [nan if row.how == EQUAL else row.worse.z for row in rows]
    judged = []
    for row, z, p, sign in zip(rows, zs, *rules.beyond(zs, limit.sigmas), strict=True):
        word = UNTESTED if isnan(z) else ALIKE
        if sign:
            least = limit.share * abs(row.change.b.value)
            matters = is_event(row.metric) or abs(row.difference.value) > least
            word = ("", WORSE, BETTER)[sign] if matters else NEGLIGIBLE
        word = EQUAL if row.how == EQUAL else word
        judged.append(row._replace(change=row.change._replace(p=float(p)), verdict=word))
    return judged


def _costs(stored: Results, now: Results, most: float) -> list[Row]:
    """Compare costs: evaluations, and CPU times if both are of this machine."""
    both = (stored, now)
    if not most or not all((r.folder / TIMING).is_file() for r in both):
        return []
    same = len({(r.manifest.get("processor"), r.manifest.get("platform")) for r in both}) == 1
    costs: list[dict[tuple[Any, ...], dict[str, Any]]] = []
    for r in both:
        records = r.columns("timing").records()
        costs.append({(*map(row.get, r.grid), row["filter"]): row for row in records})
    (old, new), rows = costs, []
    for kind in ("likelihoods", "covariances", *(["cpu_s_per_run"] if same else [])):
        for key in (key for key in new if key in old):
            a, b = (nan if row[key][kind] == "-" else float(row[key][kind]) for row in (old, new))
            point = dict(zip(now.grid, key, strict=False))
            word = WORSE if b > most * a else EQUAL if a == b else ALIKE
            how = EQUAL if a == b else "cost"
            change = compare_independent(*(RunEstimate(x, nan, None, 1) for x in (b, a)))
            if a > 0.0:
                rows.append(Row(point, key[-1], kind, how, change, change, word))
    return rows
