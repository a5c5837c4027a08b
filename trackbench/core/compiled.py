"""The optional C kernels of `_compiled.c`: the same bytes as the numpy code beside their calls.

A wheel or an installed checkout has them if there was a C compiler. ``TRACKBENCH_COMPILED=0`` leaves
them out, and so does a file that was compiled from another source. A kernel of matrices returns False
for arrays that it leaves to numpy; its caller then goes on with the numpy code.
"""

import os
from pathlib import Path
from types import ModuleType
from zlib import crc32

SOURCE = Path(__file__).with_name("_compiled.c")


def source_digest() -> str:
    """Return a checksum of the C source, which the compiled file names as that of its own."""
    return f"trackbench-core-{crc32(SOURCE.read_bytes()):08x}"


def _load() -> ModuleType | None:
    """Import the compiled kernels; None if they are switched off, not built, or of other sources."""
    if os.environ.get("TRACKBENCH_COMPILED") == "0":
        return None
    try:
        from trackbench.core import _compiled  # type: ignore[attr-defined]
    except ImportError:
        return None
    return _compiled if _compiled.source == source_digest() else None


kernels: ModuleType | None = _load()
"""The compiled module, or None: numpy computes everything."""
