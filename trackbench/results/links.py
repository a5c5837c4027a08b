"""Links in a results folder, which are refused: they could lead to any folder of the user."""

import errno
from pathlib import Path

from trackbench.errors import WriteError


def within(folder: Path, name: str) -> Path:
    """Locate a folder inside a results folder; raises WriteError if it is a link.

    A results folder of somebody else could hold a link to any folder of yours.
    """
    path = folder
    for part in Path(name).parts:
        path = path / part
        if path.is_symlink():
            message = "is a link, and results stay inside their folder; remove the link"
            raise WriteError.from_os_error(path, OSError(errno.ELOOP, message))
    return path
