"""Folders that are not whole: one clear line, exit code 2, no traceback."""

import json
import re
import shutil

import pytest

from trackbench import api
from trackbench.errors import UserError


def spoil(folder, name, old=None, new=None):
    path = folder / name
    if old is None:
        path.unlink()
        return
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


def newer(folder):
    path = folder / "manifest.json"
    manifest = json.loads(path.read_text()) | {"format": 99, "trackbench": "9.0"}
    path.write_text(json.dumps(manifest))


def manifest_with(**entries):
    def damage(folder):
        path = folder / "manifest.json"
        path.write_text(json.dumps(json.loads(path.read_text()) | entries))

    return damage


def cut_runs(folder):
    path = folder / "per_run.csv"
    path.write_bytes(path.read_bytes()[:300])


BAD = {
    "edited failures": (manifest_with(failed=[3]), "manifest.json cannot be read"),
    "cut runs": (cut_runs, "per_run.csv was changed after the run"),
    "another grid": (
        lambda f: spoil(f, "config.yaml", "grid: {}", "grid: {scenario.sensor.R: [0.1]}"),
        "the results were computed over another grid",
    ),
    "no manifest": (
        lambda f: spoil(f, "manifest.json"),
        "is half-written, it has no manifest.json",
    ),
    "half a manifest": (
        lambda f: (f / "manifest.json").write_text('{"format": 1,'),
        "manifest.json cannot be read",
    ),
    "newer": (newer, "was written by trackbench 9.0 in format 99"),
    "edited csv": (
        lambda f: spoil(f, "summary.csv", "PF,mean", "PG,mean"),
        "summary.csv was changed after the run",
    ),
    "missing csv": (lambda f: spoil(f, "summary.csv"), "summary.csv is missing"),
    "a clone": (lambda f: spoil(f, "per_run.csv"), "per_run.csv: is missing (git keeps its digest"),
    "no config": (lambda f: spoil(f, "config.yaml"), "is not a results folder"),
    "broken config": (lambda f: spoil(f, "config.yaml", "seed: 7", "seed: [7"), "config.yaml:"),
    "wrong config": (lambda f: spoil(f, "config.yaml", "runs: 400", "runs: many"), "'many' is not"),
    "other filters": (
        lambda f: spoil(f, "config.yaml", "PF (N=50)", "PF (N=51)"),
        "has results but is not a filter here any more",
    ),
    "bad figure": (
        lambda f: spoil(f, "config.yaml", "kind: rmse-vs-time", "kind: rmse-vs-tine"),
        "did you mean rmse-vs-time?",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_a_bad_folder_is_said_in_a_line(folder, case):
    damage, message = BAD[case]
    damage(folder)
    with pytest.raises(UserError, match=r".*") as caught:
        api.plot(folder, ["svg"])
    lines = [line for line in str(caught.value).splitlines() if message in line]
    assert lines
    assert str(folder) in lines[0]


@pytest.mark.parametrize("command", [api.compare, api.plot, api.report])
def test_no_folder(tmp_path, command):
    with pytest.raises(UserError, match="there is no such folder"):
        command(tmp_path / "nowhere")


def test_a_figure_of_an_earlier_run_is_not_in_the_report(folder):
    old, page = folder / "figures" / "time.svg", folder / "report.html"
    curve = max(re.findall(r' d="([^"]+)"', old.read_text()), key=len)
    assert curve in page.read_text()
    options = api.Options(engine="serial", quiet=True, out=folder, runs=20, formats=("pdf",))
    api.run(folder / "config.yaml", options)
    assert not old.exists()
    assert old.with_suffix(".pdf").exists()
    assert curve not in page.read_text()


def test_an_index_over_several_folders(folder):
    index, ledger = api.report(folder.parent)
    assert 'href="small/report.html"' in index.read_text()
    text = ledger.read_text()
    assert "plainly wrong" in text
    assert "More particles are better" in text
    with pytest.raises(UserError, match="neither a config"):
        api.report(folder / "tables")


@pytest.mark.parametrize(
    ("name", "link"),
    [("javascript:alert(1)", "./javascript%3Aalert%281%29"), ("a#b?c", "./a%23b%3Fc")],
)
def test_links_lead_to_folders_of_any_name(folder, name, link):
    folder.rename(folder.with_name(name))
    index, ledger = api.report(folder.parent)
    assert f'href="{link}/report.html"' in index.read_text()
    assert f"]({link}/)" in ledger.read_text()


def test_a_clone_gets_an_index_over_the_folders_with_runs_and_keeps_its_ledger(folder, capsys):
    other = shutil.copytree(folder, folder.with_name("other"))
    (other / "per_run.csv").unlink()
    ledger = folder.with_name("README.md")
    ledger.write_text("as in git")
    assert api.report(folder.parent) == [folder.with_name("index.html")]
    page = folder.with_name("index.html").read_text()
    assert "small/report.html" in page
    assert "other/report.html" not in page
    assert ledger.read_text() == "as in git"
    assert "per_run.csv is missing in 1 of 2 folders" in capsys.readouterr().err
    # Without any runs there is no index.
    (folder / "per_run.csv").unlink()
    with pytest.raises(UserError, match=r"per_run\.csv: is missing"):
        api.report(folder.parent)
