"""W10: long recordings of positions and of a radar: how long the whole command takes."""

import sys
import tempfile
from pathlib import Path

import numpy as np
from numpy.random import Generator

from benchmarks.harness import Bar, Workload
from benchmarks.processes import FRESH, command, processes
from trackbench.core.arrays import Array

EVERY_CORE = True
STEPS = 50_000
IMPORT_S = 0.09  # of numpy, on the machine for which the seconds are
SECONDS = {"KF": 2.0, "EKF": 4.0, "UKF": 4.0, "IMM": 7.0}
SENSORS = {
    "positions": "{kind: position, sigma: 5}",
    "radar": "{kind: range-azimuth, sigma_range: 20, sigma_azimuth_mrad: 5}",
}
LINEAR = "  KF: {kind: kf}\n"
BARE = "python that imports numpy"
CONFIG = """name: long
seed: 1
scenario:
  kind: tracking
  target: {kind: measured, measurements: FILE}
  sensor: SENSOR
  start: {kind: one-scan, sigma_velocity: 18}
  assume: {motion: {kind: cwna, q: 0.2}}
filters:
  KF: {kind: kf}
  EKF: {kind: ekf}
  UKF: {kind: ukf}
  IMM:
    kind: imm
    motions: [{kind: cwna, q: 0.02}, {kind: cwna, q: 2}]
    transition: [[0.95, 0.05], [0.05, 0.95]]
hold_out: 5
tables:
  prediction: {kind: metrics, columns: {Log score: mean(log_score), Held out: mean(held_log_score)}}
figures:
  track: {kind: track}
"""


def workloads() -> list[Workload]:
    """A filter each on a turning target that positions or a radar measure, scored as by `--from`.

    Every command may take as many times the import of numpy as the `SECONDS` are of `IMPORT_S`.
    """
    folder = Path(tempfile.mkdtemp(prefix="bench-"))
    rng = np.random.default_rng(1)
    # Intervals that differ by microseconds: every step has matrices of its own.
    intervals = {
        "equal": np.full(STEPS, 0.1),
        "unequal": rng.uniform(0.05, 0.15, STEPS),
    }
    tables = []
    for spacing, seconds in intervals.items():
        t = np.cumsum(seconds)
        for sensor, z in _measured(t, seconds, rng).items():
            name = f"{sensor}-{spacing}"
            columns = "time,x,y" if sensor == "positions" else "time,range,azimuth"
            _write_recording(folder / f"{name}.csv", columns, t, z)
            config = CONFIG.replace("FILE", f"{name}.csv").replace("SENSOR", SENSORS[sensor])
            labels = list(SECONDS)
            if sensor == "radar":  # no Kalman filter takes its measurements
                config = config.replace(LINEAR, "")
                labels.remove("KF")
            (folder / f"{name}.yaml").write_text(config)
            tables.append(_workload(name, folder, labels))
    return tables


def _measured(t: Array, seconds: Array, rng: Generator) -> dict[str, Array]:
    """Return the measurements (2, T) of a target by positions and by a radar, by sensor.

    ``t`` are the times (T,) and ``seconds`` the lengths of the intervals before them.
    """
    heading = np.cumsum(0.05 * seconds * (np.sin(t / 50.0) > 0.5))
    velocity = 20.0 * np.array([np.cos(heading), np.sin(heading)])
    x, y = np.cumsum(velocity * seconds, axis=1)
    error = rng.normal(0.0, 5.0, (2, len(t)))
    # The radar stands 30 km off, so that the target never passes it.
    px = x + 30_000.0
    polar = np.array([np.hypot(px, y), np.arctan2(y, px)])
    polar += np.array([[4.0], [0.001]]) * error
    return {"positions": np.array([x, y]) + error, "radar": polar}


def _write_recording(path: Path, columns: str, t: Array, z: Array) -> None:
    rows = [f"{time:.6f},{a:.3f},{b:.7f}\n" for time, a, b in zip(t, *z, strict=True)]
    path.write_text(columns + "\n" + "".join(rows))


def _workload(name: str, folder: Path, labels: list[str]) -> Workload:
    """The table of one recording, with a bar for each filter."""
    entrants = {}
    bars = []
    for label in labels:
        words = ("--only", label, "--out", str(folder / name / label), *FRESH)
        entrants[label] = command("run", str(folder / f"{name}.yaml"), *words)
        bars.append(Bar(label, BARE, round(SECONDS[label] / IMPORT_S), at_most=True))
    entrants[BARE] = processes([(sys.executable, "-c", "import numpy")])
    sensor, spacing = name.split("-")
    title = f"{STEPS} rows of {sensor} at {spacing} steps: `trackbench run`, one filter"
    return Workload("W10", title, "process", entrants, bars=bars)
