"""Versions of installed packages, their comparison with the lock file, and the commit of the source."""

import hashlib
import re
import subprocess
from functools import cache
from importlib.metadata import PackageNotFoundError, distribution, version
from importlib.resources import files
from pathlib import Path
from typing import Any

import trackbench

_PIN = re.compile(r"^([A-Za-z0-9_.-]+)==([^\s;\\]+)(?! ;)", re.MULTILINE)
"""A package that every system installs: one that only some systems need has a marker behind a ``;``."""
_VERSION = re.compile(r"^Version: (\S+)$", re.MULTILINE)
_PACKAGES = ("numpy", "scipy", "pandas", "matplotlib", "pydantic", "PyYAML")


@cache
def package_versions() -> dict[str, str]:
    """Return the versions of the packages that results depend on."""
    return {name: version(name) for name in _PACKAGES}


def lock_file() -> Path:
    """Locate the lock file: beside the code in a wheel, in requirements/ in a checkout."""
    package = Path(str(files("trackbench")))
    in_wheel = package / "requirements.txt"
    if in_wheel.is_file():
        return in_wheel
    return package.parent / "requirements" / "run.txt"


def compare_lock() -> dict[str, Any]:
    """Return the lock file's name and digest, and the packages installed in another version.

    The packages are under ``other``, the installed version by name. A package that is not installed is
    left out.
    """
    content = lock_file().read_bytes()
    pins = dict(_PIN.findall(content.decode()))  # version by name
    installed = {name: _installed_version(name) for name in pins}
    other = {name: now for name, now in installed.items() if now not in (pins[name], None)}
    digest = hashlib.sha256(content).hexdigest()
    return {"file": "requirements/run.txt", "sha256": digest, "other": other}


def _installed_version(name: str) -> str | None:
    """Return the version of the package ``name``; None if it is not installed.

    Tools that only build trackbench may be missing.
    """
    try:
        text = distribution(name).read_text("METADATA")
    except PackageNotFoundError:
        return None
    # `version` parses the whole text, which takes too long for thirty packages.
    line = _VERSION.search(text or "")
    if line is None:
        return version(name)
    return line.group(1)


def commit_of_source() -> str | None:
    """Find the git commit of the package's own source, if it is a checkout.

    A repository around an installed package belongs to another program. In its own repository the
    package is the folder ``trackbench`` at the top, and the commit has its files.
    """
    package = Path(trackbench.__file__).parent
    try:
        # git prints three lines: the folder's path in the repository, the commit, and the digest of the
        # file, which fails if the commit does not have the file.
        words = ["rev-parse", "--show-prefix", "HEAD", "HEAD:./__init__.py"]
        command = ["git", "-C", str(package), *words]
        answer = subprocess.run(command, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return None
    prefix, commit, _ = answer.stdout.splitlines()
    if prefix != f"{package.name}/":
        return None
    return commit
