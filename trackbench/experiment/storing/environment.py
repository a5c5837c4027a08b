"""The lock file, `requirements/run.txt`, and how far the installed packages are those that it names."""

import hashlib
import re
from importlib.metadata import PackageNotFoundError, distribution, version
from importlib.resources import files
from pathlib import Path
from typing import Any

_PIN = re.compile(r"^([A-Za-z0-9_.-]+)==([^\s;\\]+)(?! ;)", re.MULTILINE)
"""A package that is installed everywhere: what only some systems need has a marker behind a ``;``."""

_VERSION = re.compile(r"^Version: (\S+)$", re.MULTILINE)


def lock_file() -> Path:
    """The lock file: beside the code in a wheel, the repository's own in a checkout."""
    home = Path(str(files("trackbench")))
    inside = home / "requirements.txt"
    return inside if inside.is_file() else home.parent / "requirements" / "run.txt"


def lock() -> dict[str, Any]:
    """The lock file's digest, and what is installed in another version than it names."""
    content = lock_file().read_bytes()
    pins = dict(_PIN.findall(content.decode()))
    found = {name: _installed(name) for name in pins}
    return {
        "file": "requirements/run.txt",
        "sha256": hashlib.sha256(content).hexdigest(),
        "other": {name: found[name] for name in pins if found[name] not in (pins[name], None)},
    }


def _installed(name: str) -> str | None:
    """None for what is not there: the tools that build the package need not stay."""
    try:
        text = distribution(name).read_text("METADATA")
    except PackageNotFoundError:
        return None
    found = _VERSION.search(text or "")  # `version` would parse all of the text, thirty times
    return found.group(1) if found else version(name)
