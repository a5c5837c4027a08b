"""No number in the prose about the experiments is stale."""

import csv
import re
from pathlib import Path

import pytest

from docs.site import numbers
from docs.site.numbers import LINK, Row, UnclearError
from tests.conftest import EXPERIMENT_FILES
from tests.prose import (
    FINDINGS,
    HERE,
    TEXTS,
    count,
    like,
    tied,
    untied,
    values,
    verdict_rows,
    without_tied,
)
from trackbench.statistics.verdict_meanings import CLAIM_WORDS, NUMBER_WORDS
from trackbench.statistics.verdict_rules import UNDECIDED


@pytest.mark.parametrize("path", TEXTS, ids=lambda path: path.stem)
def test_every_number_of_the_prose_is_that_of_the_results(path: Path) -> None:
    found = list(tied(path))
    stale = [
        f"{t.line}: {t.written} is {t.found} ({t.source})" for t in found if t.written != t.found
    ]
    assert found
    assert not stale, "\n".join(stale)


@pytest.mark.parametrize("path", TEXTS, ids=lambda path: path.stem)
def test_a_changed_number_is_found(path: Path) -> None:
    """With the last digit of every tenth raised, or the word for another, a row is not found."""
    page, rows = path.read_text(encoding="utf-8"), numbers.read(path)
    for start, end in numbers.spans(page, rows)[::10]:
        text = re.sub(r"\d(?=\D*$)", lambda digit: str((int(digit[0]) + 1) % 10), page[start:end])
        other = text if text != page[start:end] else "equal" if text != "equal" else "holds"
        with pytest.raises(UnclearError):
            numbers.spans(page[:start] + other + page[end:], rows)


@pytest.mark.parametrize("path", FINDINGS, ids=lambda path: path.stem)
def test_a_page_is_readable_as_text(path: Path) -> None:
    """Numbers are no links, a tenth is targets of links, and lines have 160 characters."""
    page = path.read_text(encoding="utf-8")
    assert not LINK.search(page)
    targets = sum(len(a or b) for a, b in _TARGET.findall(page))
    assert targets <= 0.1 * len(page)
    assert max(map(len, page.splitlines())) <= 160


_TARGET = re.compile(r"(?<=\])\(([^()]*)\)|^\[[^]]*\]:(.*)$", re.MULTILINE)


def test_the_links_of_a_page_become_rows_and_come_again() -> None:
    page = (
        '[12](../../results/a/ "count; words; agrees") of [12](../../results/a/ "count; words")\n'
        'agree. It has [1.5 ±\n0.1](../../results/b/ "PF; mean(rmse)") m, in print 1.5.\n'
        '[Fails](../../results/b/ "claim; It is good"): it may fail. `1.5`\n'
    )
    plain, rows = numbers.unlinked(page)
    assert (
        plain == "12 of 12\nagree. It has 1.5 ±\n0.1 m, in print 1.5.\nFails: it may fail. `1.5`\n"
    )
    assert rows == [
        Row("12", "a", "count; words; agrees"),
        Row("12", "a", "count; words"),
        Row("1.5 ± 0.1", "b", "PF; mean(rmse)"),
        Row("Fails", "b", "claim; It is good"),
    ]
    assert numbers.linked(plain, rows) == page


def test_a_number_that_stands_twice_has_words_around_it() -> None:
    page = 'A has 1.5 m, B [1.5](results/a/ "B; mean(rmse)") m, C 1.5 m.'
    plain, rows = numbers.unlinked(page)
    assert rows == [Row("B {1.5} m,", "a", "B; mean(rmse)")]
    with pytest.raises(UnclearError, match="stands twice"):
        numbers.spans(plain, [Row("1.5", "a", "B; mean(rmse)")])
    with pytest.raises(UnclearError, match="is not there"):
        numbers.spans(plain.replace("B 1.5", "B 1.6"), rows)


def test_every_count_of_verdicts_is_tied() -> None:
    """The README counts every word of the ledger."""
    tied_words = {tuple(row.source.split("; ")[1:3]) for row in numbers.read(TEXTS[-1])}
    words = {("numbers", word) for word in NUMBER_WORDS} | {
        ("claims", word) for word in CLAIM_WORDS
    }
    missing = {pair for pair in words - tied_words if count("", *pair)}
    assert not missing
    rest = without_tied(TEXTS[-1])
    assert not re.search(r"\d+ +(of them|agree|are|differ|hold|fail|claims|numbers|printed)", rest)


def test_every_inconclusive_number_is_one_that_a_setting_was_chosen_for() -> None:
    """The README says so in its table."""
    inconclusive = [row for row in verdict_rows("", "numbers") if row["verdict"] == UNDECIDED]
    assert inconclusive
    assert all("chosen for this number" in row["note"] for row in inconclusive)


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


def test_every_search_counts_in_the_ledger() -> None:
    """A table of kind `readings` gives every number of its paper that it measures a verdict."""
    ledger = (HERE / "results" / "README.md").read_text(encoding="utf-8")
    searches = [
        name
        for name, path in EXPERIMENT_FILES.items()
        if re.search(r"^ +kind: readings$", path.read_text(encoding="utf-8"), re.MULTILINE)
    ]
    assert {"hdepf-search", "banana-search"} <= {*searches}
    for name in searches:
        file = HERE / "results" / name / "comparison.csv"
        rows = list(csv.DictReader(file.read_text(encoding="utf-8").splitlines()))
        assert rows
        assert all("readings searched" in row["note"] for row in rows)
        section = ledger.partition(f"### [{name}]")[2].partition("\n### ")[0]
        assert section.count("readings searched") == len(rows)


def test_a_number_of_a_note_and_the_end_of_an_interval_are_found() -> None:
    """Of the search's table and of the claim's note, in files that are in git."""
    (tried,) = values("hdepf-search", "notes; coherent; ([0-9]+) readings")
    notes = (HERE / "results" / "hdepf-search" / "tables" / "coherent.md").read_text("utf-8")
    assert f"\n{tried:.0f} readings, " in notes
    assert values("hdepf-search", "notes; coherent; no such ([0-9]+)") == ()
    claim = "At equal time MPF has the lower position RMSE"
    (most,) = values("banana-pf", f"most; {claim}")
    claims = (HERE / "results" / "banana-pf" / "claims.csv").read_text("utf-8")
    (line,) = [line for line in claims.splitlines() if line.startswith(claim)]
    assert f"at most {most:g} % (95 %)" in line


@pytest.mark.parametrize("path", FINDINGS, ids=lambda path: path.stem)
def test_every_measured_number_and_verdict_is_tied(path: Path) -> None:
    """A number that is no setting, a share in words, a verdict."""
    assert list(untied(path)) == []


@pytest.mark.parametrize("path", FINDINGS, ids=lambda path: path.stem)
def test_a_page_begins_with_a_short_summary(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
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
