"""Do the same bytes come out under other processors' arithmetic? A fresh process for each setting.

``python -m tests.machines --runs 20 experiments/hdepf/*.yaml`` (``make check-machines``). A setting
chooses the kernels of OpenBLAS and numpy's code for the processor as another machine would, as far as
this one has the instructions. One setting runs on two workers, the others serially.
"""

import argparse
import hashlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import replace
from pathlib import Path

HERE = Path(__file__).resolve().parent.parent
SETTINGS: dict[str, dict[str, str]] = {
    "as it is": {},
    **{f"OpenBLAS {core}": {"OPENBLAS_CORETYPE": core} for core in ("Haswell", "SkylakeX")},
    **{f"OpenBLAS {core}": {"OPENBLAS_CORETYPE": core} for core in ("Sandybridge", "Nehalem")},
    "numpy without AVX-512": {"disabled": "AVX512"},
    "numpy at its lowest": {"disabled": ""},
    "numpy alone": {"TRACKBENCH_COMPILED": "0"},
    "two workers, two BLAS threads": {"workers": "2", "OPENBLAS_NUM_THREADS": "2"},
}
NEEDED = {
    "OpenBLAS Haswell": "AVX2",
    "OpenBLAS SkylakeX": "AVX512_SKX",
    "OpenBLAS Sandybridge": "AVX",
}
"""Instructions without which a processor cannot run a setting at all."""
_FILES = ("per_run.csv", "per_step.csv", "summary.csv")


def digests(
    configs: Sequence[str], runs: int, block: int | None, scans: int | None, workers: int
) -> dict[str, str]:
    """A digest of the first runs' CSV files for each config, computed in this process or its workers.

    ``scans`` is the most that a scenario of scans has.
    """
    from trackbench import api
    from trackbench.execution.cache import BlockStore
    from trackbench.execution.engines import engine
    from trackbench.execution.plan import make_plan
    from trackbench.execution.run_plans import execute
    from trackbench.results.write_folder import write_results

    found = {}
    for config in configs:
        sets = [f"block={block}"] if block else []
        experiment = api.prepare(Path(config), api.Options(set=sets))
        experiment = replace(experiment, figures={})
        if scans is not None and hasattr(experiment.points[0].scenario, "scans"):
            short = [
                replace(point, scenario=replace(point.scenario, scans=scans))
                for point in experiment.points
            ]
            experiment = replace(experiment, points=short)
        plan = make_plan(experiment).first(runs)
        fewer = replace(experiment, settings=replace(experiment.settings, runs=runs))
        with tempfile.TemporaryDirectory() as folder:
            store, opened = BlockStore(Path(folder, "blocks")), engine("processes", workers)
            out = Path(folder, "out")
            out.mkdir()
            with closing(execute([plan], store, opened, workers, progress=False)) as outcomes:
                write_results(out, fewer, next(outcomes), tracks=False)
            content = b"".join((out / name).read_bytes() for name in _FILES)
        found[config] = hashlib.sha256(content).hexdigest()
    return found


def under(name: str, arguments: Sequence[str]) -> dict[str, str]:
    """What `digests` finds in a fresh process under a setting, or several joined by " + "."""
    setting = {key: value for one in name.split(" + ") for key, value in SETTINGS[one].items()}
    disabled, workers = setting.pop("disabled", None), setting.pop("workers", "1")
    if disabled is not None:
        setting["NPY_DISABLE_CPU_FEATURES"] = " ".join(_features(disabled))
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"} | setting
    command = [sys.executable, "-m", "tests.machines", "--here", "--workers", workers, *arguments]
    done = subprocess.run(command, env=environment, cwd=HERE, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"{name}: {done.stderr}")
    found: dict[str, str] = json.loads(done.stdout)
    return found


def is_possible(name: str) -> bool:
    """Whether this processor has the instructions of a setting."""
    from numpy._core._multiarray_umath import __cpu_features__

    return name not in NEEDED or __cpu_features__.get(NEEDED[name], False)


def _features(among: str) -> list[str]:
    """What numpy can be told not to use of this processor; all, or those of a name."""
    from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__

    there = [f for f in __cpu_dispatch__ if __cpu_features__.get(f)]
    return [f for f in there if among in f or (among == "AVX512" and f == "X86_V4")]


def main() -> int:
    """Print a line for each setting; exit code 1 if any has other bytes than the first."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("configs", nargs="+")
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--block", type=int)
    parser.add_argument("--scans", type=int)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--here", action="store_true", help="in this process only")
    options = parser.parse_args()
    if options.here:
        o = options
        print(json.dumps(digests(o.configs, o.runs, o.block, o.scans, o.workers)))
        return 0
    arguments = [*options.configs, "--runs", str(options.runs)]
    arguments += ["--block", str(options.block)] if options.block else []
    arguments += ["--scans", str(options.scans)] if options.scans else []
    expected: dict[str, str] = {}
    differs = False
    possible = [name for name in SETTINGS if is_possible(name)]
    with ThreadPoolExecutor(os.cpu_count()) as pool:  # each is a process
        every = dict(
            zip(possible, pool.map(lambda name: under(name, arguments), possible), strict=True)
        )
    for name, found in every.items():
        expected = expected or found
        other = [config for config in found if found[config] != expected[config]]
        differs = differs or bool(other)
        print(f"{name}: " + (f"other bytes in {', '.join(other)}" if other else "the same bytes"))
    for name in [name for name in SETTINGS if name not in possible]:
        print(f"{name}: not tried, this processor has no {NEEDED[name]}")
    return int(differs)


if __name__ == "__main__":
    sys.exit(main())
