"""Imports and digests made once in the fork server, so that its workers inherit them."""

import scipy.special  # noqa: F401  # which kinds import when they need it

from trackbench.execution.worker import environment_digests
from trackbench.registry import GROUPS, import_own

import_own(*(group for group in GROUPS if group not in ("figures", "tables")))
environment_digests()
