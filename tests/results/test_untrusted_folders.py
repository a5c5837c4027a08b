"""A results folder from somebody else: commands keep to it, and end in plain lines."""

import json
import os
import shutil
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from trackbench import api
from trackbench.atomic_files import write_text
from trackbench.errors import WriteError
from trackbench.results.lock import locked
from trackbench.results.manifest import read_manifest, write_manifest
from trackbench.results.remove_earlier_files import remove_outputs

RUN = api.Options(engine="serial", quiet=True, formats=("svg",))


@pytest.fixture
def own(folder: Path) -> Path:
    """A file of the reader's own, outside the results folder."""
    path = folder.parent / "own.txt"
    path.write_text("mine")
    return path


def run(folder: Path) -> None:
    """Run the folder's config into it again, with few runs."""
    api.run(folder / "config.yaml", RUN, out=folder, runs=4)


@pytest.mark.parametrize("link", ["symlink_to", "hardlink_to"])
def test_a_lock_that_is_a_link_is_not_written_to(folder: Path, own: Path, link: str) -> None:
    getattr(folder / ".lock", link)(own)
    with pytest.raises(WriteError, match=r"cannot write .*\.lock: "):
        run(folder)
    assert own.read_text() == "mine"
    assert (folder / "manifest.json").is_file()


@pytest.mark.parametrize("content", ["my notes", "1" * 21])
def test_a_lock_of_something_else_is_left_alone(folder: Path, content: str) -> None:
    (folder / ".lock").write_text(content)
    with pytest.raises(WriteError, match=r"\.lock: is not a lock of trackbench; remove it by hand"):
        run(folder)
    assert (folder / ".lock").read_text() == content


def test_a_lock_that_is_a_pipe_is_not_waited_for(folder: Path) -> None:
    os.mkfifo(folder / ".lock")
    with pytest.raises(WriteError, match=r"is not a lock of trackbench"):
        run(folder)


def test_a_lock_of_a_process_that_died_is_taken_over(tmp_path: Path) -> None:
    (tmp_path / ".lock").write_text("123")
    with locked(tmp_path, print):
        assert (tmp_path / ".lock").read_text() == str(os.getpid())
    assert not (tmp_path / ".lock").exists()


def test_a_plot_waits_for_a_run_and_keeps_its_manifest(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with ThreadPoolExecutor(1) as threads:
        with locked(folder, print):
            plotted = threads.submit(api.plot, folder, ["svg"], ["time"])
            with pytest.raises(TimeoutError):
                plotted.result(timeout=0.5)
            manifest = read_manifest(folder)
            write_manifest(folder, manifest | {"seed": 99}, ())
        plotted.result(timeout=60)
    assert f"small/ is in use by process {os.getpid()}; waiting" in capsys.readouterr().err
    assert json.loads((folder / "manifest.json").read_text())["seed"] == 99


def test_who_gets_a_report_of_several_may_plot_it(folder: Path) -> None:
    for report in api.run_all([folder / "config.yaml"], RUN, out=folder, runs=4):
        assert api.plot(report.folder, ["svg"], ["time"])


def forge(folder: Path, *names: str) -> None:
    """Let the manifest name files as if a run had written them."""
    path = folder / "manifest.json"
    manifest = json.loads(path.read_text())
    manifest["files"] |= dict.fromkeys(names, "0")
    path.write_text(json.dumps(manifest))


FOREIGN = ("notes.txt", "tables/notes.txt", "figures/x.html", "published/x.md", "../own.txt")


def test_a_forged_manifest_deletes_nothing_of_somebody_else(folder: Path, own: Path) -> None:
    for name in FOREIGN[:-1]:
        (folder / name).write_text("mine")
    forge(folder, *FOREIGN, str(own), "figures/../../own.txt", "tables/old.csv", "..", "\0")
    (folder / "tables" / "old.csv").write_text("a\n")
    remove_outputs(folder, keep=())
    assert all((folder / name).read_text() == "mine" for name in FOREIGN)
    assert not (folder / "tables" / "old.csv").exists()
    assert not (folder / "summary.csv").exists()


def test_nothing_behind_a_linked_folder_is_deleted_or_written(folder: Path) -> None:
    shutil.move(folder / "figures", folder.parent / "pictures")
    (folder / "figures").symlink_to(folder.parent / "pictures")
    (folder.parent / "pictures" / ".x.svg.1.part").write_text("")
    names = {path: path.read_bytes() for path in (folder.parent / "pictures").iterdir()}
    with pytest.raises(WriteError, match=r"small/figures: is a link, and results stay inside"):
        run(folder)
    assert {path: path.read_bytes() for path in names} == names
    assert (folder / "figures").is_symlink()


def test_a_link_in_a_file_s_place_is_replaced_itself(folder: Path, own: Path) -> None:
    for name in ("summary.csv", "figures/time.svg", f".summary.csv.{os.getpid()}.part"):
        (folder / name).unlink(missing_ok=True)
        (folder / name).symlink_to(own)
    run(folder)
    assert own.read_text() == "mine"
    assert not (folder / "summary.csv").is_symlink()


def test_only_the_program_s_own_half_written_files_go(folder: Path) -> None:
    ours = [".summary.csv.12.part", "tables/.t.csv.3.part", ".per_run.csv.xz.4.part"]
    theirs = [".film.mkv.part", ".summary.csv.part", "below/.summary.csv.12.part", ".a.csv.12.part"]
    (folder / "below").mkdir()
    for name in (*ours, *theirs):
        (folder / name).write_text("")
    remove_outputs(folder, keep=())
    assert not any((folder / name).exists() for name in ours)
    assert all((folder / name).exists() for name in theirs)


def test_a_link_in_the_place_of_a_temporary_file_is_not_followed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Someone puts it there after the old temporary file is removed and before the new one is made."""
    own = tmp_path / "own.txt"
    own.write_text("mine")
    unlink = Path.unlink

    def unlink_and_link(path: Path, missing_ok: bool = False) -> None:
        unlink(path, missing_ok)
        if path.suffix == ".part":
            path.symlink_to(own)

    monkeypatch.setattr(Path, "unlink", unlink_and_link)
    with pytest.raises(WriteError, match=r"a\.csv"):
        write_text(tmp_path / "a.csv", "numbers")
    assert own.read_text() == "mine"
    assert not (tmp_path / "a.csv").exists()
