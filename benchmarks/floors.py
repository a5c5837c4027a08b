"""The floor: the random numbers an algorithm cannot do without, and one ``exp`` per particle-step.

In blocks of the product's own size, with nothing else done. Bars are held against the variates as
numpy's documented generator makes them, an SFC64 stream's ``standard_normal``, ``standard_gamma`` and
``random``. A second line, in W1 with a bar of its own, takes the product's faster variates instead: the
normals and gammas of trackbench/core/random_streams.py.
"""

import time
from math import ceil

import numpy as np
from numpy.random import SFC64, Generator

from benchmarks.harness import Entrant, Outcome
from trackbench.core.random_streams import block_stream

PARTICLES_AT_A_TIME = 32_768


def floor(
    N: int,
    runs: int,
    steps: int,
    *,
    gammas: int = 0,
    normals: int = 0,
    uniforms: int = 0,
    exps: int = 1,
    own: bool = False,
) -> Entrant:
    """Variates per particle-step: of Gamma(3), normals, uniforms; and exponentials.

    ``own`` takes the product's faster normals and gammas.
    """
    width = max(1, min(500, PARTICLES_AT_A_TIME // N, runs))
    blocks = ceil(runs / width)

    def entrant() -> Outcome:
        rng = block_stream(1, 0) if own else Generator(SFC64(1))
        w = np.full((width, N), -1.0)
        started = time.process_time()
        for _ in range(steps * blocks):
            for _ in range(gammas):
                rng.standard_gamma(3.0, (width, N))
            if normals:
                rng.standard_normal((normals, width, N))
            if uniforms:
                rng.random((uniforms, width, N))
            for _ in range(exps):
                np.exp(w)
        seconds = time.process_time() - started
        return Outcome(seconds, float(blocks * width * N * steps))

    return entrant
