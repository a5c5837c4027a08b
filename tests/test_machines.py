"""The same bytes under the arithmetic of other machines, in fresh processes."""

import os
import platform
import subprocess
import sys

import pytest

from tests.conftest import EXPERIMENT_FILES
from tests.machines import HERE, digests, under
from trackbench.execution import arithmetic_digests

NAMES = ("hdepf", "merwe2000", "banana-kf", "banana-pf", "banana-rivals")
CONFIGS = [str(EXPERIMENT_FILES[name]) for name in NAMES]
SCANS = 10
ARGUMENTS = [*CONFIGS, "--runs", "1", "--block", "1", "--scans", str(SCANS)]
OWN = "6e2aa4541b3c"
"""First digits of what the package's own arithmetic gives on every machine."""


@pytest.fixture(scope="module")
def expected() -> dict[str, str]:
    return digests(CONFIGS, runs=1, block=1, scans=SCANS, workers=1)


# Several at once: the bytes are other ones if any of them tells. `make check-machines` has each alone.
@pytest.mark.parametrize(
    "name",
    [
        "OpenBLAS Nehalem + numpy at its lowest + numpy alone",
        "OpenBLAS Haswell + numpy without AVX-512 + two workers, two BLAS threads",
    ],
)
def test_other_kernels_give_the_same_bytes(name: str, expected: dict[str, str]) -> None:
    assert under(name, ARGUMENTS) == expected


def test_own_arithmetic_is_that_of_every_machine() -> None:
    assert arithmetic_digests.own_arithmetic().startswith(OWN)


@pytest.mark.skipif(platform.machine() != "x86_64", reason="names of x86 kernels")
def test_numpys_arithmetic_is_told_apart() -> None:
    """Or there would be nothing to hold: another kernel of BLAS has other last bits."""
    command = "from trackbench.execution.arithmetic_digests import numpy_arithmetic; "
    command += "print(numpy_arithmetic())"
    found = {
        subprocess.run(
            [sys.executable, "-c", command],
            env=os.environ | {"OPENBLAS_CORETYPE": core},
            cwd=HERE,
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for core in ("Haswell", "Nehalem")
    }
    assert len(found) == 2
