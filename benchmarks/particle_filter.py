"""Cost of the bootstrap filter on Merwe's model beside its random numbers' own cost.

Prints nanoseconds per particle-step on one core: the filter itself (as a block runs it, CPU time),
and the floor: the gamma variates it needs (the logarithm of three uniforms' product) plus one ``exp``.
"""

import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_name] = "1"

import statistics
import time

import numpy as np

from trackbench.core.streams import block_stream
from trackbench.evaluation.block import BlockTask, run_block
from trackbench.registry import kinds
from trackbench.scenarios.merwe import Merwe

ROUNDS = 7


def filter_ns(N: int, runs: int, width: int) -> float:
    """The filter's CPU time per particle-step."""
    tracker = kinds("filters")["pf"](N=N)
    scenario = Merwe()
    cpu_s = sum(
        run_block(BlockTask(scenario, tracker, 1, block, width, width)).cpu_s
        for block in range(runs // width)
    )
    return 1e9 * cpu_s / (runs * N * (scenario.T - 1))


def floor_ns(N: int, runs: int, width: int) -> float:
    """One Gamma(3) variate and one exp per particle-step, in blocks of the same size."""
    rng = block_stream(1, 0)
    steps, blocks = 49, runs // width
    started = time.process_time()
    for _ in range(steps * blocks):
        u = rng.random((3, width, N))
        product = u[0]
        product *= u[1]
        product *= u[2]
        np.log(product, out=product)
        np.exp(product, out=product)
    return 1e9 * (time.process_time() - started) / (runs * N * steps)


def main() -> None:
    """Interleave filter and floor, print medians and their ratio."""
    print(f"{'N':>6} {'runs':>6} {'block':>6} {'filter ns':>10} {'floor ns':>10} {'ratio':>7}")
    for N, runs, width in ((10, 2000, 2000), (10, 2000, 500), (100, 200, 200), (1000, 200, 25)):
        pairs = [(filter_ns(N, runs, width), floor_ns(N, runs, width)) for _ in range(ROUNDS + 1)]
        ours, floor = (statistics.median(p[i] for p in pairs[1:]) for i in range(2))
        print(f"{N:>6} {runs:>6} {width:>6} {ours:>10.1f} {floor:>10.1f} {ours / floor:>7.2f}")


if __name__ == "__main__":
    main()
