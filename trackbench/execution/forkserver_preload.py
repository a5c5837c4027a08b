"""Imports and digests made once in the fork server, so that its workers inherit them."""

import scipy.special  # noqa: F401  # which kinds import when they need it

from trackbench.execution.compute_batch import environment_digests
from trackbench.registry import BLOCK_GROUPS, import_own

import_own(*BLOCK_GROUPS)
environment_digests()
