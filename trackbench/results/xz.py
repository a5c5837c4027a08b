"""The large CSV files of a results folder, packed for git (``make pack-results``).

xz and not gzip, because it finds the rows of a sweep that repeat far apart: a third smaller here.
"""

import lzma
import shutil
import sys
from collections.abc import Iterable
from io import BufferedIOBase
from pathlib import Path

from trackbench.atomic_files import atomic_write

PACKED = ("per_run.csv", "per_step.csv", "summary.csv")
"""Files that git keeps packed; each is read where only the packed one is there."""


def there(path: Path) -> Path | None:
    """The file, or what it was packed into; None if neither is there."""
    return next((p for p in (path, packed(path)) if p.is_file()), None)


def packed(path: Path) -> Path:
    """The file that it is packed into."""
    return path.with_name(f"{path.name}.xz")


def left_out(name: str) -> bool:
    """Whether git does not keep a file of this name: a results folder is whole without it."""
    return name == "tracks.npz" or name.endswith((".png", ".pdf"))


def opened(path: Path) -> BufferedIOBase:
    """The content of a file, packed or not."""
    return lzma.open(path) if path.suffix == ".xz" else path.open("rb")


def pack(folder: Path) -> None:
    """Pack the folder's large files; the same content gives the same bytes, and is left alone."""
    for name in PACKED:
        path = folder / name
        if not path.is_file() or _is_packed(path):
            continue
        with (
            path.open("rb") as source,
            atomic_write(packed(path)) as file,
            lzma.open(file, "wb", preset=9) as target,
        ):
            shutil.copyfileobj(source, target)


def _is_packed(path: Path) -> bool:
    target = packed(path)
    return target.is_file() and lzma.decompress(target.read_bytes()) == path.read_bytes()


def main(folders: Iterable[str]) -> None:
    """Pack the folders of a run each."""
    for folder in folders:
        pack(Path(folder))


if __name__ == "__main__":
    main(sys.argv[1:])
