"""No number in the prose about the experiments is stale."""

import re

import pytest

from tests.prose import LINK, PROSE, like, tied


def test_every_number_of_the_prose_is_that_of_the_results() -> None:
    stale = [
        f"{t.line}: {t.written} is {t.found} ({t.source})" for t in tied() if t.written != t.found
    ]
    assert not stale, "\n".join(stale)


def test_every_measured_number_is_tied() -> None:
    """A value with a standard error is a measured one."""
    for i, line in enumerate(PROSE.read_text(encoding="utf-8").splitlines(), start=1):
        rest = LINK.sub("", line).replace("`value ± standard error`", "")
        assert "±" not in rest, f"{i}: {line}"


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
