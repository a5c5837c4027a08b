"""Run the suite, print it, and write benchmarks/results.md."""

import argparse
import importlib
import os
import pkgutil
import sys
import time
from pathlib import Path

import benchmarks
from benchmarks.harness import Skip, measure
from benchmarks.report import head, section, skipped

RESULTS = Path(__file__).parent / "results.md"


def main() -> None:
    """All workloads, or those named, on one core."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("workloads", nargs="*", metavar="W1", help="default: all")
    parser.add_argument(
        "--rounds", type=int, default=7, help="counted rounds, at least two (default 7)"
    )
    parser.add_argument("--out", type=Path, help="default: benchmarks/results.md if all were run")
    options = parser.parse_args()
    if options.rounds < 2:
        parser.error("--rounds: two rounds are needed to say how far apart they are")
    wanted = {name.lower() for name in options.workloads}
    modules = sorted(m.name for m in pkgutil.iter_modules(benchmarks.__path__) if m.name[0] == "w")
    parts = [head(options.rounds)]
    started = time.perf_counter()
    print(parts[0], flush=True)
    for name in modules:
        if not wanted or wanted & {name, name.partition("_")[0]}:
            for part in _sections(name, options.rounds):
                print(part, flush=True)
                parts.append(part)
    parts.append(f"The suite took {(time.perf_counter() - started) / 60:.1f} minutes.\n")
    out = options.out or (None if wanted else RESULTS)
    if out:
        out.write_text("\n".join(parts))


def _sections(name: str, rounds: int) -> list[str]:
    module = importlib.import_module(f"benchmarks.{name}")
    every_core = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else None
    if every_core and not getattr(module, "EVERY_CORE", False):
        os.sched_setaffinity(0, {max(every_core)})
    try:
        return [section(work, measure(work, rounds)) for work in module.workloads()]
    except Skip as reason:
        return [skipped(name, module, reason)]
    finally:
        if every_core:
            os.sched_setaffinity(0, every_core)


if __name__ == "__main__":
    sys.exit(main())
