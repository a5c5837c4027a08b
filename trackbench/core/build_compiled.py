"""Build the optional C kernels: for a wheel, for an installed checkout, or as a script.

Without a C compiler nothing is built, and numpy does the same operations more slowly.
"""

import os
import subprocess
import sys
import sysconfig
from contextlib import suppress
from pathlib import Path
from runpy import run_path
from typing import Any

FOLDER = Path(__file__).parent
BUILT = FOLDER / "_compiled.abi3.so"
# Options of the compiler. Every byte must equal numpy's: no fused multiply-adds, no other order of sums.
_EXACT = ("-O3", "-ffp-contract=off", "-fno-fast-math", "-fno-math-errno", "-fno-trapping-math")


def build() -> bool:
    """Compile `_compiled.c` in place unless that was done; return whether the file is there."""
    # Run the file, since an import of it would import the package, which needs numpy: a build of a wheel
    # has none.
    names = run_path(str(FOLDER / "compiled.py"), {"__package__": "trackbench.core"})
    digest: str = names["source_digest"]()  # the compiled file contains that of its source
    if BUILT.is_file() and digest.encode() in BUILT.read_bytes():
        return True
    linking = ("-undefined", "dynamic_lookup") if sys.platform == "darwin" else ()
    part = BUILT.with_suffix(f".{os.getpid()}.part")
    command = [
        *(os.environ.get("CC") or "cc").split(),
        *_EXACT,
        *("-std=c11", "-fPIC", "-shared", f'-DSOURCE="{digest}"'),
        *("-I", sysconfig.get_paths()["include"], *linking),
        *("-o", str(part), str(FOLDER / "_compiled.c")),
    ]
    # Compile into a file of this process, then move it to its place.
    BUILT.unlink(missing_ok=True)
    with suppress(OSError, subprocess.SubprocessError):
        subprocess.run(command, check=True, capture_output=True, timeout=300)
        part.replace(BUILT)
    part.unlink(missing_ok=True)
    return BUILT.is_file()


try:
    from hatchling.builders.hooks.plugin.interface import BuildHookInterface
except ImportError:  # at run time there is no build to hook into
    pass
else:

    class CompiledBuildHook(BuildHookInterface):  # type: ignore[type-arg]
        """Compiles before a wheel is packed or a checkout installed."""

        PLUGIN_NAME = "custom"

        def initialize(self, version: str, build_data: dict[str, Any]) -> None:
            """Add the compiled file to the wheel, which then is for this platform alone."""
            if self.target_name == "wheel" and sys.platform != "win32" and build():
                build_data["artifacts"].append(f"/{BUILT.relative_to(self.root).as_posix()}")
                build_data["pure_python"] = False
                platform = sysconfig.get_platform().replace("-", "_").replace(".", "_")
                build_data["tag"] = f"cp311-abi3-{platform}"


if __name__ == "__main__":
    print(BUILT if build() else "not built: no C compiler, or no Python headers")
