"""Scalar C: `scalar.c`, compiled at the first import for this machine."""

import ctypes
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from trackbench.core.arrays import Array

SOURCE = Path(__file__).with_name("scalar.c")
FLAGS = ("-O3", "-march=native", "-fno-math-errno", "-shared", "-fPIC", "-lm")


def _load() -> ctypes.CDLL:
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        raise ImportError("no C compiler", name="cc")
    with tempfile.TemporaryDirectory() as folder:
        library = Path(folder) / "scalar.so"
        subprocess.run([compiler, str(SOURCE), "-o", str(library), *FLAGS], check=True)
        return ctypes.CDLL(str(library))


_library = _load()
_library.seed(ctypes.c_uint64(1))


def _call(name: str, *args: Any) -> None:
    """Call a function with arrays of float64 and ints."""
    kept = [np.ascontiguousarray(a, dtype=float) if isinstance(a, np.ndarray) else a for a in args]
    pointers = [
        a.ctypes.data_as(ctypes.c_void_p) if isinstance(a, np.ndarray) else ctypes.c_int(a)
        for a in kept
    ]
    getattr(_library, name)(*pointers)


def merwe_numbers(s: Any) -> Array:
    """The model's constants in the order of `scalar.c`; its gamma noise has shape 3."""
    if s.gamma_shape != 3:
        raise ValueError("scalar.c draws gamma variates of shape 3")
    return np.array([s.x1, s.w * np.pi, s.phi1, s.phi2, s.phi3, s.R, s.gamma_rate, s.switch])


def _merwe(name: str, scenario: Any, z: Array, N: int) -> Array:
    _, T, M = z.shape
    out = np.empty((M, T))
    k = np.array(scenario.steps[1:], dtype=float)
    _call(name, merwe_numbers(scenario), k, z[0].T, T, M, N, out)
    return out.T[None]


def merwe_pf(scenario: Any, z: Array, N: int) -> Array:
    """Bootstrap filter; z (1, T, M), estimates (1, T, M)."""
    return _merwe("merwe_pf", scenario, z, N)


def merwe_upf(scenario: Any, z: Array, N: int) -> Array:
    """Unscented particle filter; z (1, T, M), estimates (1, T, M)."""
    return _merwe("merwe_upf", scenario, z, N)


def evolution_numbers(tracker: Any) -> Array:
    """Return the numbers of an HDEPF with its default settings, in the order of `scalar.c`."""
    if tracker.reading != type(tracker)().reading:
        raise ValueError("scalar.c has the default interpretations of HDEPF")
    return np.array([tracker.F, tracker.CR, tracker.T0, tracker.rho])


def merwe_hdepf(scenario: Any, tracker: Any, z: Array) -> Array:
    """Hybrid differential evolution particle filter; z (1, T, M), estimates (1, T, M)."""
    _, T, M = z.shape
    out = np.empty((M, T))
    k = np.array(scenario.steps[1:], dtype=float)
    numbers = (merwe_numbers(scenario), evolution_numbers(tracker))
    _call("merwe_hdepf", *numbers, k, z[0].T, T, M, tracker.N, tracker.G, out)
    return out.T[None]


def banana_pf(F: Array, Q: Array, R: Array, start: Array, z: Array) -> Array:
    """Bootstrap filter of z (2, T, M) from clouds (4, M, N); estimates (4, T, M)."""
    _, T, M = z.shape
    out = np.empty((M, T, 4))
    root, sigma = np.linalg.cholesky(Q), np.sqrt(np.diag(R))
    clouds = start.swapaxes(0, 1)
    _call("banana_pf", F, root, sigma, clouds, z.transpose(2, 1, 0), T, M, start.shape[2], out)
    return out.transpose(2, 1, 0)


def kalman_cv(F: Array, Q: Array, R: Array, mean: Array, cov: Array, z: Array) -> Array:
    """Kalman filter of z (2, T, M) from N(mean, cov), mean (4, M); estimates (4, T, M)."""
    _, T, M = z.shape
    out = np.empty((M, T, 4))
    _call("kalman_cv", F, Q, R, mean.T, cov, z.transpose(2, 1, 0), T, M, out)
    return out.transpose(2, 1, 0)


def imm_cv(
    F: Array, Q: Array, R: Array, transition: Array, mean: Array, cov: Array, z: Array
) -> Array:
    """IMM of two motions F, Q (2, 4, 4) of z (2, T, M) from N(mean, cov); estimates (4, T, M)."""
    _, T, M = z.shape
    out = np.empty((M, T, 4))
    _call("imm_cv", F, Q, R, transition, mean.T, cov, z.transpose(2, 1, 0), T, M, out)
    return out.transpose(2, 1, 0)


def lorenz96_enkf(numbers: Array, mean: Array, z: Array, N: int) -> Array:
    """Ensemble Kalman filter of z (n, T, M) from N(mean, sigma^2 I), mean (n,); estimates (n, T, M).

    ``numbers`` are sigma, the measurements' variance, the time between steps and the inflation.
    """
    n, T, M = z.shape
    out = np.empty((M, T, n))
    _call("lorenz96_enkf", numbers, mean, z.transpose(2, 1, 0), T, M, n, N, out)
    return out.transpose(2, 1, 0)
