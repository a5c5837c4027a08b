"""Powers of ten in letters, as 10⁻³, in place of matplotlib's formulas, which it parses slowly."""

import re

from trackbench.report.plotting.page_formats import sheet

_FORMULA = re.compile(r"\$\\mathdefault\{(.*)\}\$")


_POWER = re.compile(r"\^\{(-?\d+)\}")


_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def power_of_ten(exponent: int) -> str:
    """Return a power of ten as logarithmic axes write it: in letters if the font can, else a formula."""
    formula = rf"$\mathdefault{{10^{{{exponent}}}}}$"
    if sheet().has_raised_digits:
        return raise_digits(formula)
    return formula


def raise_digits(formula: str) -> str:
    r"""Return ``$\mathdefault{2\times10^{-3}}$`` as 2×10⁻³.

    Parameters
    ----------
    formula
        text of a tick, as matplotlib's formatters write it

    Returns
    -------
    str
        plain letters; any other formula stays as it is
    """
    match = _FORMULA.fullmatch(formula)
    if match is None:
        return formula
    text = match[1].replace(r"\times", "×")
    text = _POWER.sub(lambda power: power[1].translate(_RAISED), text)
    is_still_formula = re.search(r"[\\^{}]", text) is not None
    if is_still_formula:
        return formula
    return text.replace("-", "−")
