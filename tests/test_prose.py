"""No number in the prose about the experiments is stale."""

import re
from pathlib import Path

import pytest

from tests.prose import FINDINGS, HERE, LINK, TEXTS, count, like, tied, untied
from trackbench.statistics.rules import CLAIM_WORDS, NUMBER_WORDS


@pytest.mark.parametrize("path", TEXTS, ids=lambda path: path.stem)
def test_every_number_of_the_prose_is_that_of_the_results(path: Path) -> None:
    found = list(tied(path))
    stale = [
        f"{t.line}: {t.written} is {t.found} ({t.source})" for t in found if t.written != t.found
    ]
    assert found
    assert not stale, "\n".join(stale)


def test_every_count_of_verdicts_is_tied() -> None:
    """A number before a verdict's word, and the sentence has all words of the ledger."""
    text = (
        TEXTS[-1]
        .read_text(encoding="utf-8")
        .partition("## What it found")[2]
        .partition("| paper")[0]
    )
    rest = LINK.sub("", text)
    assert not re.search(r"\d+ +(of them|agree|are|differ|hold|fail|claims|numbers|printed)", rest)
    tied_words = {tuple(title.split("; ")[1:3]) for _, _, title in LINK.findall(text)}
    words = {("numbers", word) for word in NUMBER_WORDS} | {
        ("claims", word) for word in CLAIM_WORDS
    }
    missing = {pair for pair in words - tied_words if count("", *pair)}
    assert not missing


def test_a_count_is_of_the_ledger() -> None:
    """results/README.md says it in words."""
    ledger = (HERE / "results" / "README.md").read_text(encoding="utf-8")
    claims, holds = count("", "claims"), count("", "claims", "holds")
    assert (
        f"- {claims} claims: {holds} hold ({count('', 'claims', 'holds', 'fragile')} fragile)"
        in ledger
    )
    numbers, words = count("", "numbers"), count("", "words")
    assert (
        f"- {numbers} published numbers: " in ledger or f"- {numbers + words} published" in ledger
    )


@pytest.mark.parametrize("path", FINDINGS, ids=lambda path: path.stem)
def test_every_measured_number_and_verdict_is_tied(path: Path) -> None:
    """A number that is no setting, a share in words, a verdict."""
    assert list(untied(path)) == []


@pytest.mark.parametrize("path", FINDINGS, ids=lambda path: path.stem)
def test_a_page_begins_with_a_short_summary(path: Path) -> None:
    text = re.sub(r"\]\([^)]*\)", "]", path.read_text(encoding="utf-8"))
    summary = text.partition("## Summary\n")[2].partition("\n## ")[0].strip()
    assert 20 <= len(summary.split("\n\n")[0].split()) <= 120


def test_what_is_typed_is_found(tmp_path: Path) -> None:
    text = tmp_path / "text.md"
    text.write_text("It holds: 0.12345 m, half of it.\n# Errata\nIt holds.\n")
    assert [what for _, what in untied(text)] == ["holds", "half", "0.12345"]


@pytest.mark.parametrize(
    ("written", "value", "found"),
    [
        ("0.341", 0.34149, "0.341"),
        ("12", 11.6, "12"),
        ("14 616", 32305.7, "32 306"),
        ("+4.8", 4.79, "+4.8"),
        ("1.2e-5", 2.4e-5, "2.4e-5"),
    ],
)
def test_a_number_keeps_its_form(written: str, value: float, found: str) -> None:
    match = re.fullmatch(r"([+-]?)(.*)", written)
    assert match is not None
    assert like(match, value) == found
