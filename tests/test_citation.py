"""Files by which the package is found, cited and checked agree with each other."""

import json
import re
import tomllib
from pathlib import Path

import yaml

from tests.commands import trackbench
from trackbench import __version__

ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def test_version_license_and_authors_are_the_same_everywhere() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    zenodo = json.loads((ROOT / ".zenodo.json").read_text())
    recipe = yaml.safe_load((ROOT / ".github" / "conda" / "recipe.yaml").read_text())
    versions = {citation["version"], zenodo["version"], recipe["context"]["version"], __version__}
    assert len(versions) == 1
    assert {citation["license"], zenodo["license"], recipe["about"]["license"]} == {
        PROJECT["license"]
    }
    assert citation["title"] == zenodo["title"]
    assert citation["authors"] == zenodo["creators"] == PROJECT["authors"]


def test_the_recipe_requires_what_the_package_requires() -> None:
    recipe = yaml.safe_load((ROOT / ".github" / "conda" / "recipe.yaml").read_text())
    conda = {word.replace("-base", "").replace(" ", "") for word in recipe["requirements"]["run"]}
    assert conda == {*PROJECT["dependencies"], f"python{PROJECT['requires-python']}"}


def test_codecheck_lists_files_that_are_there(tmp_path: Path) -> None:
    folder = ROOT / "results" / "nile"
    out = tmp_path / "codecheck.yml"
    done = trackbench("codecheck", folder, "--out", out, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    text = out.read_text()
    assert text.startswith("---\n")
    content = yaml.safe_load(text)
    assert content["version"] == "https://codecheck.org.uk/spec/config/1.0/"
    assert {"title", "authors", "reference"} == content["paper"].keys()
    assert len(content["manifest"]) > 1
    for item in content["manifest"]:
        assert (tmp_path / item["file"]).is_file()
        assert re.search(r"[a-z]", item["comment"])
    again = trackbench("codecheck", folder, "--out", out, cwd=tmp_path)
    assert again.returncode == 2
    assert out.read_text() == text
