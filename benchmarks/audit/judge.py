"""Judge of one adapter file in this process: `python -m benchmarks.audit.judge FILE` prints JSON."""

import json
import sys
import warnings
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.audit.nonlinear import FORMULAS, Rule, off_the_formulas
from benchmarks.audit.nonlinear import TOLERANCE as NONLINEAR_TOLERANCE
from trackbench.config.load import load
from trackbench.contract import check_file
from trackbench.contract.estimates import run_filter, simulate
from trackbench.contract.findings import Finding
from trackbench.contract.missing_measurements_check import with_gaps
from trackbench.contract.problems import PLANAR, PRECISE, UNEQUAL, ModelDraws
from trackbench.contract.why_not_running import runs_on
from trackbench.core import linalg
from trackbench.filters.base import AnyFilter
from trackbench.filters.ekf import EKF
from trackbench.registry import kinds
from trackbench.scenarios.base import Scenario

_RUNS = 20
TOLERANCE = 1e-6
"""in standard deviations: what an unscented filter with alpha = 0.001 loses by rounding is 4e-8"""
PROBLEMS = {"equal intervals": PLANAR, "unequal intervals": UNEQUAL, "radar": PRECISE}


def linear_problem(path: Path, tracker: AnyFilter) -> Scenario:
    """Return the problem of the adapter's config, or one with unequal intervals if possible."""
    config = path.with_suffix(".yaml")
    if config.is_file():
        return ModelDraws(base=load(config, allow_plugins=True).points[0].scenario)
    return UNEQUAL if runs_on(tracker, UNEQUAL) else PLANAR


def off_the_kalman_filter(tracker: AnyFilter, problem: Scenario) -> tuple[float, float]:
    """Return the largest distance of the mean and of the covariance from the exact Kalman filter.

    The problem is linear with missing measurements. Distances are in standard deviations and in
    products of two.
    """
    data = with_gaps(simulate(problem, _RUNS))
    tested, exact = run_filter(tracker, problem, data), run_filter(EKF(), problem, data)
    sigma = np.sqrt(linalg.diagonal(exact.cov))
    mean = np.abs((tested.mean - exact.mean) / sigma).max()
    cov = np.abs((tested.cov - exact.cov) / (sigma[:, None] * sigma)).max()
    return float(mean), float(cov)


def nonlinear_judgements(cls: Any) -> list[tuple[Finding, float]]:
    """Return a finding for each nonlinear problem, and the distance from the formulas."""
    rule: Rule | None = getattr(cls.one, "rule", None)
    if rule is None:
        return []
    out = []
    for name in FORMULAS:
        check, why = f"equals the textbook's filter: {name}", ""
        try:
            off = off_the_formulas(cls(), rule, name)
        except Exception as error:
            off, why = np.nan, str(error)
        if not off <= NONLINEAR_TOLERANCE:
            why = why or f"off by {off:.2g} standard deviations"
        out.append((Finding(check, "bad" if why else "good", why), off))
    return out


def judged(path: Path) -> list[dict[str, Any]]:
    """Return a row for each filter of an adapter file."""
    rows, config = [], path.with_suffix(".yaml")
    found = check_file(path, config if config.is_file() else None, allow_plugins=True)
    for kind, findings in found.items():
        cls: Any = kinds("filters")[kind]
        bad = [f"{f.check}: {f.why}" for f in findings if f.verdict == "bad"]
        try:
            tracker = cls()
            off = off_the_kalman_filter(tracker, linear_problem(path, tracker))
        except Exception as error:
            off, bad = (np.nan, np.nan), bad or [str(error)]
        if not max(off) <= TOLERANCE:
            bad.append("differs from the Kalman filter on a linear model")
        nonlinear = nonlinear_judgements(cls)
        findings += [finding for finding, _ in nonlinear]
        bad += [f"{f.check}: {f.why}" for f, _ in nonlinear if f.verdict == "bad"]
        counts = {v: sum(f.verdict == v for f in findings) for v in ("good", "bad", "left out")}
        problems = [name for name, problem in PROBLEMS.items() if runs_on(cls(), problem)]
        texts = {
            "problems": "its own" if config.is_file() else ", ".join(problems),
            "shown by": getattr(cls.one, "shown_by", "?") if bad else "",
            "first finding": "".join(bad[:1]),
        }
        names = ("mean_off", "covariance_off")
        offs = {name: f"{x:.1e}" for name, x in zip(names, off, strict=True)}
        largest = max([x for _, x in nonlinear], default=None)
        offs["nonlinear_off"] = "" if largest is None else f"{largest:.1e}"
        rows.append({"filter": kind} | counts | offs | texts)
    return rows


def main() -> None:
    path = Path(sys.argv[1])
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        rows = judged(path)
    print("\n" + json.dumps({"version": version(path.stem.replace("_", "-")), "rows": rows}))


if __name__ == "__main__":
    main()
