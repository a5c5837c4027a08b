"""Does a stored results folder come out again? A slice of its runs, and every recorded verdict."""

import csv
import io
import itertools
import tempfile
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

from trackbench import api
from trackbench.experiment.cache import BlockStore, cache_folder
from trackbench.experiment.engines import cpu_count, engine
from trackbench.experiment.plan import check_memory, make_plan
from trackbench.experiment.runner import execute
from trackbench.experiment.store import write_results
from trackbench.report.comparison import claim_rows, number_rows
from trackbench.report.opening import open_results
from trackbench.report.results import Results
from trackbench.report.verdicts import compare


def verify(folder: Path, runs: int, allow_plugins: bool = False) -> list[str]:
    """What differs, in words: verdicts from those recorded, the first runs from those stored."""
    results = open_results(folder)
    return [*verdict_changes(results), *run_changes(results, runs, allow_plugins)]


def verdict_changes(results: Results) -> list[str]:
    """Numbers and claims whose verdict is another than the recorded one."""
    found = compare(results)
    changes = []
    for name, keys, rows in (
        (
            "comparison.csv",
            ("paper", "table", "row", "filter", "metric", "label"),
            number_rows(found),
        ),
        ("claims.csv", ("paper", "claim"), claim_rows(found)),
    ):
        path = results.folder / name
        text = path.read_text(encoding="utf-8") if path.is_file() else ""
        recorded = _verdicts(list(csv.DictReader(io.StringIO(text, newline=""))), keys)
        now = _verdicts(rows, keys)
        for key in dict.fromkeys([*recorded, *now]):
            was, is_ = recorded.get(key, "not recorded"), now.get(key, "not published any more")
            if was != is_:
                what = ", ".join(filter(None, key))
                changes.append(f"{path}: {what}: recorded {was!r}, now {is_!r}")
    return changes


def run_changes(results: Results, runs: int, allow_plugins: bool = False) -> list[str]:
    """Rows of per_run.csv that do not come out again when the first runs are computed again."""
    folder = results.folder
    runs = min(runs, results.config["runs"])
    with tempfile.TemporaryDirectory() as temporary:
        again = Path(temporary)
        _compute_again(folder / "config.yaml", again, runs, allow_plugins)
        now = _rows(Results(again), runs)
    stored = _rows(results, runs)
    differing = [
        (a, b) for a, b in itertools.zip_longest(stored, now, fillvalue=["nothing"]) if a != b
    ]
    if not differing:
        return []
    a, b = (",".join(row) for row in differing[0])
    return [
        f"{folder}/per_run.csv: {len(differing)} of {len(stored)} rows of the first {runs} runs "
        f"differ; the first is {a!r}, computed again {b!r}"
    ]


def _compute_again(config: Path, out: Path, runs: int, allow_plugins: bool) -> None:
    """The first runs, in blocks as wide as all runs had them: `block: fit` follows their number."""
    experiment = api.prepare(config, api.Options(allow_plugins=allow_plugins))
    experiment = replace(experiment, figures={})
    plan = make_plan(experiment).first(runs)
    workers = min(cpu_count(), len(plan.unique))
    check_memory(experiment, workers)
    fewer = replace(experiment, settings=replace(experiment.settings, runs=runs))
    store, opened = BlockStore(cache_folder()), engine("processes", workers)
    with closing(execute([plan], store, opened, workers, fresh=True, progress=False)) as outcomes:
        write_results(out, fewer, next(outcomes), tracks=False)


def _rows(results: Results, runs: int) -> list[list[str]]:
    column = len(results.grid) + 1
    with results.open("per_run.csv") as file:
        rows = csv.reader(file)
        next(rows)
        return [row for row in rows if int(row[column]) < runs]


def _verdicts(rows: list[dict[str, Any]], keys: tuple[str, ...]) -> dict[tuple[str, ...], str]:
    return {tuple(str(row.get(k, "")) for k in keys): row.get("verdict", "") for row in rows}
