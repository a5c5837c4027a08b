"""Versions of Python, numpy and scipy: after an upgrade every block is computed again."""

import platform
import sys
from importlib.metadata import version


def library_versions() -> tuple[str, tuple[int, int], str, str]:
    """Return the processor's architecture and the versions of Python, numpy and scipy.

    They are part of `code_digests.code_digest`, and by it of every block's key: a block that another
    version stored is not found.
    """
    python = (sys.version_info.major, sys.version_info.minor)
    return platform.machine(), python, version("numpy"), version("scipy")
