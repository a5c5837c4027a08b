"""The page on models in YAML says what its experiments give."""

from pathlib import Path

import pytest
import yaml

from docs.site.blocks import blocks
from tests.conftest import ROOT
from trackbench import api
from trackbench.report.findings.ranking import rankings

PAGE = (ROOT / "docs" / "your-model.md").read_text(encoding="utf-8")
WORDS = " ".join(PAGE.split())


def test_the_filters_of_the_pendulum_have_one_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    errors = _errors(tmp_path, monkeypatch, "pendulum.yaml").values()
    assert f"the angle, from {min(errors):.3f} to {max(errors):.3f} rad" in WORDS


def test_the_filters_of_the_pendulum_are_as_efficient_as_the_page_says(tmp_path: Path) -> None:
    """By the changes that the page makes for the exact posterior."""
    config = yaml.safe_load(_block_of("pendulum.yaml"))
    (text,) = (block.text for block in blocks(PAGE) if "efficiency_angle" in block.text)
    changes = yaml.safe_load(text)
    for key in ("scenario", "filters"):
        changes[key] = config[key] | changes[key]
    config |= changes
    report = api.run(config, engine="serial", quiet=True, formats=(), out=tmp_path)
    table = (report.folder / "tables" / "efficiency.md").read_text(encoding="utf-8")
    for label, words in (
        ("EKF", "the EKF is"),
        ("UKF", "the UKF is"),
        ("PF", "particle filter is"),
    ):
        (row,) = (line.split("|") for line in table.splitlines() if line.startswith(f"| {label} "))
        assert f"{words} {row[2].strip()}" in WORDS


def test_the_filters_of_the_lorenz_system_differ_as_the_page_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    errors = _errors(tmp_path, monkeypatch, "lorenz.yaml")
    assert min(errors, key=errors.__getitem__) == "UKF"
    assert f"the error of the EnKF is about {_percent(errors, 'EnKF', 'UKF')} % larger" in WORDS
    assert f"that of the EKF is about {_percent(errors, 'EKF', 'UKF')} % larger" in WORDS


def test_a_wrong_prior_costs_what_the_page_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    errors = _errors(tmp_path, monkeypatch, "two-places.yaml")
    larger = _percent(errors, "Shifted", "KF")
    assert f"deviation 2 the error of `Shifted` is {larger} % larger than that of `KF`" in WORDS
    for settings in ([], ["filters.Shifted.assume.start.sigma.x=0.1"]):
        report = api.run(
            "two-places.yaml",
            only=["KF", "Shifted"],
            set=settings,
            engine="serial",
            quiet=True,
            formats=(),
        )
        (ranking,) = rankings(report.results)
        assert [rival.filter.label for rival in ranking.worse] == ["Shifted"]
    errors = {candidate.label: candidate.overall.value for candidate in ranking.order}
    larger = _percent(errors, "Shifted", "KF")
    assert f"deviation 0.1 it is {larger} % larger than that of `KF`" in WORDS


def _errors(folder: Path, monkeypatch: pytest.MonkeyPatch, config: str) -> dict[str, float]:
    """Run a config of the page; return the number by which each filter is ranked."""
    monkeypatch.chdir(folder)
    (folder / config).write_text(_block_of(config))
    report = api.run(config, engine="serial", quiet=True, formats=())
    (ranking,) = rankings(report.results)
    return {candidate.label: candidate.overall.value for candidate in ranking.order}


def _block_of(config: str) -> str:
    """Return the text of a config that the page shows."""
    (text,) = (block.text for block in blocks(PAGE) if block.title == config)
    return text


def _percent(errors: dict[str, float], larger: str, smaller: str) -> str:
    """Return by how many percent one error is larger than another one."""
    return f"{100.0 * (errors[larger] / errors[smaller] - 1.0):.0f}"
