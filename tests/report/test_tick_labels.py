"""Powers of ten in letters say what matplotlib's formulas say, at the same ticks."""

import unicodedata
from typing import Any

import pytest
from matplotlib import font_manager
from matplotlib.ft2font import FT2Font

from trackbench.report.plotting import style
from trackbench.report.plotting.file_formats import matplotlib_file, spell_out_texts
from trackbench.report.plotting.page_formats import COLUMN, PAGE, SCREEN, drawing_for
from trackbench.report.plotting.raised_digits import power_of_ten, raise_digits

SPANS = [(1e-3, 40.0), (0.2, 0.9), (2e4, 7e4), (3e-12, 2e9), (5.0, 31.0)]


def figure(low: float, high: float, scale: str = "log") -> Any:
    with style.rc_context():
        drawn, ax = style.subplots()
        ax.set_yscale(scale)
        ax.set_ylim(low, high)
    return drawn


def labels(drawn: Any) -> list[str]:
    axis = drawn.axes[0].yaxis
    drawn.draw_without_rendering()
    return [tick.label1.get_text() for tick in (*axis.get_major_ticks(), *axis.get_minor_ticks())]


def value(label: str) -> float:
    r"""A number as somebody reads it: 2×10⁻³ or $\mathdefault{2\times10^{-3}}$."""
    text = label.removeprefix(r"$\mathdefault{").removesuffix("}$").removesuffix("}")
    text = text.replace(r"\times", "×").replace("^{", "")
    plain = "".join(unicodedata.normalize("NFKD", c) for c in text).replace("−", "-")
    factor, _, ten = plain.rpartition("×")
    assert ten.startswith("10")
    return float(f"{factor or 1}e{ten.removeprefix('10')}")


@pytest.mark.parametrize("span", SPANS, ids=str)
def test_the_same_ticks_say_the_same_numbers(span: tuple[float, float]) -> None:
    formulas, letters = figure(*span), figure(*span)
    spell_out_texts(letters)
    said, meant = labels(letters), labels(formulas)
    assert [bool(label) for label in said] == [bool(label) for label in meant]
    assert any(said)
    assert not any("$" in label for label in said)
    assert [value(a) for a in said if a] == [value(b) for b in meant if b]


def test_an_axis_of_both_signs_says_zero_and_minus() -> None:
    drawn = figure(-50.0, 50.0, "symlog")
    spell_out_texts(drawn)
    assert {"−10¹", "0", "10¹"} <= set(labels(drawn))


def test_a_formula_that_is_no_power_stays_one() -> None:
    assert raise_digits(r"$\mathdefault{10^{2.50}}$") == r"$\mathdefault{10^{2.50}}$"
    assert raise_digits(r"$\sqrt{2}$") == r"$\sqrt{2}$"
    assert raise_digits("100") == "100"


def test_the_house_font_has_every_letter() -> None:
    family = dict(SCREEN.letters)["font.family"]
    glyphs = FT2Font(font_manager.findfont(family)).get_charmap()
    assert all(ord(letter) in glyphs for letter in "⁻⁰¹²³⁴⁵⁶⁷⁸⁹×−")


@pytest.mark.parametrize("sheet", [COLUMN, PAGE], ids=lambda sheet: sheet.name)
def test_in_a_paper_whose_font_has_no_raised_digits_they_stay_formulas(sheet: Any) -> None:
    with drawing_for(sheet):
        drawn = figure(1e-3, 40.0)
        spell_out_texts(drawn)
        said = [label for label in labels(drawn) if label]
        assert len(said) > 1
        assert all(label.startswith("$") for label in said)
        assert power_of_ten(-2) == r"$\mathdefault{10^{-2}}$"
    assert power_of_ten(-2) == "10⁻²"


def test_the_picture_says_them_as_text() -> None:
    drawn = figure(1e-3, 40.0)
    with style.rc_context():
        assert ">10⁻²</text>" in matplotlib_file(drawn, "svg").decode()
