"""A cache folder is marked: trackbench deletes its own files in it, and serves what it cannot write."""

import os
from pathlib import Path

import pytest

from tests.commands import spawned, trackbench
from tests.conftest import PLANE
from trackbench import api
from trackbench.commands import prepare_jobs
from trackbench.errors import UserError, WriteError
from trackbench.execution import cache
from trackbench.execution import clear_cache as cache_marks
from trackbench.execution.cache import BlockStore
from trackbench.execution.clear_cache import clear_cache, mark_cache
from trackbench.execution.plan import make_plan

CONFIG = f"name: c\nruns: 4\nblock: 2\n{PLANE}filters:\n  KF: {{kind: kf}}\n"
FOREIGN = (
    *("figures/plot.png", "figures/ab/cd.svg", "times/lap.json", "blocks/house/wall.txt"),
    *("blocks/0123456789ab/aa/notes.block", "notes.txt"),
)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("TRACKBENCH_CACHE", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "c.yaml").write_text(CONFIG)
    return tmp_path / "cache"


def _blocks(folder: Path) -> int:
    return len([*folder.glob("blocks/*/*/*.block")])


@pytest.mark.usefixtures("no_report")
@pytest.mark.parametrize("option", ["--clear", "--prune"])
@pytest.mark.parametrize("ran", [False, True])
def test_nothing_is_deleted_in_a_folder_of_other_files(
    option: str, ran: bool, folder: Path
) -> None:
    for name in FOREIGN:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text("mine")
    if ran:
        api.run("c.yaml", quiet=True, engine="serial")
    before = sorted(folder.rglob("*"))
    done = trackbench("cache", option)
    assert done.returncode == 2
    assert done.stderr.startswith(f"{folder}/: has files that trackbench did not write, and no")
    assert len(done.stderr.splitlines()) == 1
    assert sorted(folder.rglob("*")) == before


@pytest.mark.usefixtures("no_report")
def test_foreign_files_in_a_marked_folder_stay(folder: Path) -> None:
    api.run("c.yaml", quiet=True, engine="serial")
    assert _blocks(folder) == 2
    for name in FOREIGN:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text("mine")
    (folder / "blocks" / "link").symlink_to(folder.parent)
    clear_cache(folder)
    assert _blocks(folder) == 1  # notes.block
    assert all((folder / name).read_text() == "mine" for name in FOREIGN)
    assert (folder.parent / "c.yaml").is_file()


@pytest.mark.usefixtures("no_report")
def test_a_cache_of_an_earlier_version_is_marked_when_all_names_are_its_own(folder: Path) -> None:
    api.run("c.yaml", quiet=True, engine="serial")
    (folder / ".trackbench-cache").unlink()
    old = folder / "blocks" / "0123456789ab" / "aa" / f"{'a' * 64}.block"
    old.parent.mkdir(parents=True)
    old.write_text("")
    clear_cache(folder, old_only=True)
    assert not old.exists()
    assert _blocks(folder) == 2
    clear_cache(folder)
    assert _blocks(folder) == 0
    assert (folder / ".trackbench-cache").is_file()


def test_a_marker_of_another_content_is_none(folder: Path) -> None:
    folder.mkdir()
    (folder / ".trackbench-cache").write_text("something")
    assert not mark_cache(folder)
    with pytest.raises(UserError, match="nothing was deleted"):
        clear_cache(folder)


@pytest.mark.usefixtures("no_report")
def test_a_full_cache_that_may_only_be_read_serves(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = api.run("c.yaml", quiet=True, engine="serial", formats=())
    (folder / ".trackbench-cache").unlink()

    def refused(path: Path, text: str) -> None:
        raise WriteError.from_os_error(path, OSError(30, "read-only file system"))

    monkeypatch.setattr(cache, "write_text", refused)
    monkeypatch.setattr(cache_marks, "write_text", refused)
    monkeypatch.setattr(prepare_jobs, "may_write", lambda path: path != folder)
    again = api.run("c.yaml", quiet=True, engine="serial", formats=(), out="again")
    assert again.results.manifest["blocks"] == {"computed": 0, "reused": 2}
    assert again.per_run.equals(first.per_run)
    for more in ({"runs": 6}, {"fresh": True}):
        with pytest.raises(UserError, match="may not be written in"):
            api.run("c.yaml", quiet=True, engine="serial", **more)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names here")
def test_a_pipe_in_the_place_of_a_block_is_no_block(folder: Path) -> None:
    api.run("c.yaml", quiet=True, engine="serial")
    task = make_plan(api.prepare("c.yaml", api.Options())).unique[0]
    file = BlockStore(folder).files(task)[task.runs_used].path
    file.unlink()
    os.mkfifo(file)
    for name in [*folder.glob("figures/*/*.svg")]:
        name.unlink()
        os.mkfifo(name)
    done = spawned("run", "c.yaml", "--workers", "1", cwd=folder.parent)
    assert done.returncode == 0, done.stderr
    assert "reused 1 of 2 blocks" in done.stderr
