"""The results as Markdown."""

import platform
import sys
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import ModuleType

import numpy as np

from benchmarks.harness import Line, Workload, verdicts

PACKAGES = (
    "trackbench",
    "numpy",
    "scipy",
    "filterpy",
    "stonesoup",
    "particles",
    "numba",
    "jax",
    "dynamax",
    "dapper",
)


def head(rounds: int) -> str:
    """What was measured, where, and with which versions."""
    lines = [
        "# Benchmark results",
        "",
        f"Medians of {rounds} interleaved rounds; one core, one BLAS thread, CPU time (of whole",
        "processes wall time). Read the ratios: the machine is shared. RMSE is the mean and its",
        "standard error over the first runs, those that every entrant of the table has done: an",
        "entrant that loops over runs is timed on a few. The floor is numpy's own generator and one",
        "`exp` per particle-step; where we draw faster variates the floor with them is shown beside it.",
        "Bars are held against the first, W1's against both. The first call compiles where a package",
        "does. C is one scalar loop with a generator of its own, numba the same loop. `make bench`",
        "writes this file.",
        "",
        f"Processor: {_processor()}. Python {sys.version.split()[0]}.",
        "Versions: " + ", ".join(f"{name} {_version(name)}" for name in PACKAGES) + ".",
    ]
    return "\n".join(lines) + "\n"


def section(workload: Workload, lines: list[Line]) -> str:
    """A table: time per unit, its quartile range, ratio to the first entrant, RMSE; and the bars."""
    first = lines[0].per_unit
    scale, unit = (1e9, "ns") if first < 1e-3 else (1.0, "s")
    rows = [
        f"## {workload.name}: {workload.title}",
        "",
        f"| entrant | {unit} per {workload.unit} | quartiles apart | first call "
        f"| times {lines[0].name} | RMSE |",
        "|---|--:|--:|--:|--:|--:|",
    ]
    for line in lines:
        rmse = "" if np.isnan(line.rmse) else f"{line.rmse:.4g} ± {line.stderr:.2g}"
        rows.append(
            f"| {line.name} | {scale * line.per_unit:.3g} | {scale * line.spread:.2g} "
            f"| {scale * line.first:.3g} "
            f"| {line.per_unit / first:.3g} | {rmse} |"
        )
    rows += [f"| {name} | {why} | | | | |" for name, why in workload.skipped.items()]
    found = verdicts(workload, lines)
    return "\n".join([*rows, "", *(f"- {verdict}" for verdict in found)]) + "\n"


def skipped(name: str, module: ModuleType, reason: object) -> str:
    """A workload that this version cannot run."""
    what = (module.__doc__ or name).splitlines()[0]
    return f"## {name.partition('_')[0].upper()}\n\n{what}\n\nNot run: {reason}.\n"


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return f"{names[0]}, {len(names)} cores" if names else platform.machine()
