"""W10: a long recording: how long the whole command takes."""

import sys
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.harness import Limit, Workload
from benchmarks.processes import FRESH, command, processes

EVERY_CORE = True
STEPS = 50_000
CONFIG = """name: long
seed: 1
scenario:
  kind: tracking
  target: {kind: measured, measurements: rows.csv}
  sensor: {kind: position, sigma: 5}
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
    """A filter each on positions of a turning target, with the scores that `--from` asks for.

    The limits are seconds of a machine on which Python imports numpy in 0.09 s: the last row says how
    much slower this one is at the moment.
    """
    folder = Path(tempfile.mkdtemp(prefix="bench-"))
    rng = np.random.default_rng(1)
    t = 0.1 * np.arange(STEPS)
    heading = np.cumsum(0.005 * (np.sin(t / 50.0) > 0.5))
    x, y = np.cumsum(2.0 * np.array([np.cos(heading), np.sin(heading)]), axis=1)
    z = np.array([x, y]) + rng.normal(0.0, 5.0, (2, STEPS))
    rows = [f"{time:.1f},{a:.2f},{b:.2f}\n" for time, a, b in zip(t, *z, strict=True)]
    (folder / "rows.csv").write_text("time,x,y\n" + "".join(rows))
    (folder / "long.yaml").write_text(CONFIG)
    entrants = {}
    for label in ("KF", "EKF", "UKF", "IMM"):
        words = ("--only", label, "--out", str(folder / label), *FRESH)
        entrants[label] = command("run", str(folder / "long.yaml"), *words)
    entrants["python that imports numpy"] = processes([(sys.executable, "-c", "import numpy")])
    limits = [Limit("KF", 2.0), Limit("EKF", 4.0), Limit("UKF", 4.0), Limit("IMM", 7.0)]
    title = f"A recording of {STEPS} rows: `trackbench run`, one filter"
    return [Workload("W10", title, "process", entrants, limits=limits)]
