"""A git revision of the user's repository, checked out beside it, to run its config."""

import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from trackbench.errors import Mark, Problem, UserError


@contextmanager
def checked_out(
    ref: str, config: Path, file: Path | None, home: Path
) -> Iterator[tuple[Path, list[Path]]]:
    """Check out the revision ``ref`` of a git repository into the temporary folder ``home``.

    The repository is that of ``config``, or else of the ``file`` with filters. Yield the config's path
    in the checked out revision, and a list with the path of ``file`` there, empty if the revision has no
    such file. A path outside the repository is yielded as it is. The repository is not changed: the
    index of the revision is a file in ``home``.
    """
    # Step 1: find the repository, and write the files of the revision.
    top = _repository_of(config)
    if top is None and file is not None:
        top = _repository_of(file)
    if top is None:
        raise _ref_error(ref, f"{config} is in no git repository")
    repository: Path = top
    tree = home / "tree"
    _run_git(ref, repository, home, "read-tree", f"{ref}^{{commit}}")
    _run_git(ref, repository, home, "checkout-index", "--all", f"--prefix={tree}/")

    def path_in_tree(path: Path) -> Path:
        """Return the path in the checked out tree; itself if it is outside the repository."""
        if not path.resolve().is_relative_to(repository):
            return path
        return tree / path.resolve().relative_to(repository)

    # Step 2: the config and the filter's file there. A file that is new is compared with nothing.
    old_config = path_in_tree(config)
    if not old_config.is_file():
        raise _ref_error(ref, f"has no file {config}")
    old_files = []
    if file and path_in_tree(file).is_file():
        old_files.append(path_in_tree(file))
    try:
        yield old_config, old_files
    except UserError as error:
        # Messages have the revision's name in place of the temporary folder.
        lines = [str(p).replace(f"{tree}{os.sep}", f"{ref}:") for p in error.problems]
        raise UserError(*lines) from error


def _repository_of(path: Path) -> Path | None:
    """Find the top folder of a file's git repository; None if it is in none, or git is missing."""
    command = ["git", "-C", str(path.resolve().parent), "rev-parse", "--show-toplevel"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return None
    return Path(done.stdout.strip()).resolve()


def _run_git(ref: str, repository: Path, home: Path, *words: str) -> None:
    """Run the git command ``words`` in a repository; raises UserError with git's last line.

    The index is a file in ``home``, so that the repository's own stays as it is. The error names the
    revision ``ref``.
    """
    environment = {**os.environ, "GIT_INDEX_FILE": str(home / "index")}
    command = ["git", "-C", str(repository), *words]
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    if done.returncode:
        lines = done.stderr.strip().splitlines() or ["git failed"]
        raise _ref_error(ref, lines[-1].removeprefix("fatal: "))


def _ref_error(ref: str, message: str) -> UserError:
    return UserError(Problem(Mark(f"--against-ref {ref}"), "", message))
