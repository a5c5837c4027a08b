"""The manifest names the package's own commit, and no commit of a repository around it."""

import subprocess
from pathlib import Path

import pytest

import trackbench
from trackbench.results.versions_and_commit import commit_of_source


def _git(folder: Path, *words: str) -> str:
    who = ["-c", "user.name=n", "-c", "user.email=n@example.org", "-c", "commit.gpgsign=false"]
    done = subprocess.run(
        ["git", "-C", str(folder), *who, *words], capture_output=True, text=True, check=True
    )
    return done.stdout.strip()


@pytest.mark.parametrize(
    ("place", "tracked", "own"),
    [
        ("", True, True),
        ("", False, False),  # pip install --target .
        (".venv/lib/python3/site-packages", False, False),
        (".venv/lib/python3/site-packages", True, False),  # a copy that somebody put under git
        ("vendored", True, False),
    ],
)
def test_only_a_checkout_of_its_own_has_a_commit(
    place: str, tracked: bool, own: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("GIT_DIR", "GIT_WORK_TREE", "GIT_INDEX_FILE"):
        monkeypatch.delenv(name, raising=False)
    package = tmp_path / "project" / place / "trackbench"
    package.mkdir(parents=True)
    for file in (package / "__init__.py", tmp_path / "project" / "mine.py"):
        file.write_text("")
    monkeypatch.setattr(trackbench, "__file__", str(package / "__init__.py"))
    assert commit_of_source() is None  # no repository
    _git(tmp_path / "project", "init", "-q")
    assert commit_of_source() is None  # and one without a commit
    _git(tmp_path / "project", "add", "-f", "." if tracked else "mine.py")
    _git(tmp_path / "project", "commit", "-qm", "First")
    head = _git(tmp_path / "project", "rev-parse", "HEAD")
    assert commit_of_source() == (head if own else None)
    _git(package, "init", "-q")  # the package's folder itself
    _git(package, "add", "-f", ".")
    _git(package, "commit", "-qm", "First")
    assert commit_of_source() is None
