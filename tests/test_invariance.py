"""The same bytes from the same seed, however it was run."""

import csv
from pathlib import Path

import pytest

from tests.papers import merwe_text
from trackbench import api
from trackbench.results.manifest import read_manifest

CONFIG = """
name: small
seed: 5
runs: {runs}
block: 7
scenario: {scenario}
reference: Exact
filters:
{filters}
"""
FILTERS = {
    "PF": "{kind: pf, N: 10}",
    "HDEPF": "{kind: hdepf, G: 3}",
    "UPF": "{kind: upf, N: 5}",
    "Exact": "{kind: grid, nodes: 32}",
}
FILES = ("per_run.csv", "per_step.csv", "summary.csv", "config.yaml")


def _run(
    folder: Path,
    runs: int = 30,
    labels: list[str] | None = None,
    cache: Path | None = None,
    **options: object,
) -> Path:
    chosen = labels or list(FILTERS)
    text = CONFIG.format(
        scenario=merwe_text(T=12),
        runs=runs,
        filters="\n".join(f"  {b}: {FILTERS[b]}" for b in chosen),
    )
    folder.mkdir()
    (folder / "small.yaml").write_text(text)
    options = {"workers": 1, "quiet": True, "formats": (), **options}
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TRACKBENCH_CACHE", str(cache or folder / "cache"))
        api.run(folder / "small.yaml", api.Options(out=folder / "out", **options))
    return folder / "out"


def _rows(path: Path, label: str) -> list[list[str]]:
    with path.open() as file:
        rows = [row for row in csv.reader(file) if row[0] == label]
    assert rows, f"{path} has no row of {label}"
    return rows


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return _run(tmp_path_factory.mktemp("reference") / "a")


def test_workers_and_engines_do_not_matter(reference: Path, tmp_path: Path) -> None:
    for name, options in {"serial": {"engine": "serial"}, "two": {"workers": 2}}.items():
        other = _run(tmp_path / name, **options)
        for file in FILES:
            assert (other / file).read_bytes() == (reference / file).read_bytes(), (name, file)


def test_other_filters_and_their_order_do_not_matter(reference: Path, tmp_path: Path) -> None:
    for name, labels in {"fewer": ["HDEPF", "Exact"], "turned": list(FILTERS)[::-1]}.items():
        other = _run(tmp_path / name, labels=labels)
        for label in labels:
            for file in ("per_run.csv", "per_step.csv", "summary.csv"):
                assert _rows(other / file, label) == _rows(reference / file, label), (label, file)


@pytest.mark.parametrize("runs", [1, 3, 14, 20])
def test_fewer_runs_are_the_first_of_more(reference: Path, tmp_path: Path, runs: int) -> None:
    other = _run(tmp_path / "few", runs=runs)
    for label in FILTERS:
        first = [row for row in _rows(reference / "per_run.csv", label) if int(row[1]) < runs]
        assert _rows(other / "per_run.csv", label) == first


@pytest.mark.parametrize("first", [3, 14, 20])
def test_more_runs_reuse_the_first(reference: Path, tmp_path: Path, first: int) -> None:
    cache = tmp_path / "cache"
    _run(tmp_path / "few", runs=first, cache=cache)
    made = {path: path.read_bytes() for path in cache.rglob("*.block")}
    other = _run(tmp_path / "more", cache=cache)
    for file in FILES:
        assert (other / file).read_bytes() == (reference / file).read_bytes(), file
    blocks = read_manifest(other)["blocks"]
    assert blocks == {"computed": 20 - 4 * -(-first // 7), "reused": 4 * -(-first // 7)}
    assert all(path.read_bytes() == content for path, content in made.items())


def test_the_resolved_config_gives_the_same_bytes(reference: Path, tmp_path: Path) -> None:
    out = tmp_path / "again"
    api.run(reference / "config.yaml", api.Options(out=out, workers=1, quiet=True, formats=()))
    for file in FILES:
        assert (out / file).read_bytes() == (reference / file).read_bytes()


def test_another_seed_gives_other_numbers(reference: Path, tmp_path: Path) -> None:
    other = _run(tmp_path / "seed", seed=6)
    assert (other / "per_run.csv").read_bytes() != (reference / "per_run.csv").read_bytes()
