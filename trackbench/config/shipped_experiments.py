"""The experiments that come with the package: found by their names, listed, and copied to be edited.

A wheel holds them beside the code; in a checkout, editable installs included, they are the repository's.
"""

import csv
import re
from collections.abc import Callable, Iterator
from importlib import resources
from pathlib import Path
from typing import NamedTuple

from trackbench.atomic_files import ensure_folder, write_bytes
from trackbench.errors import Mark, Problem, UserError

_TIMES = "times.csv"
_PROBLEM = re.compile(r"^problem: \{version: (\d+)(?:, reference: (.+))?\}$", re.MULTILINE)
_PRINTED_AT = ("paper", "table", "row", "filter", "metric", "point")


class Shipped(NamedTuple):
    """A shipped experiment: name, title, the paper that it reproduces, and seconds on one processor."""

    name: str
    title: str
    paper: str
    cpu_s: float | None


class ShippedProblem(NamedTuple):
    """A shipped standard problem: what `trackbench list problems` prints."""

    name: str
    version: int
    title: str
    numbers: int
    """published numbers that it measures"""
    reference: str
    """label of the filter or bound that errors are compared with; may be empty"""
    paper: str
    cpu_s: float | None


def folder() -> Path:
    """Find the folder of the shipped experiments, their parts and the published numbers."""
    home = Path(str(resources.files("trackbench")))
    inside = home / "experiments"
    return inside if inside.is_dir() else home.parent / "experiments"


def names() -> list[str]:
    """List every shipped experiment's name, sorted."""
    return sorted(path.stem for path in folder().glob("[!_]*.yaml"))


def listed() -> list[Shipped]:
    """List every shipped experiment, sorted by name. YAML is not imported to look at three lines."""
    with (folder() / _TIMES).open(encoding="utf-8", newline="") as file:
        times = {row["experiment"]: float(row["cpu_s"]) for row in csv.DictReader(file)}
    texts = {name: _file(name).read_text(encoding="utf-8") for name in names()}
    return [
        Shipped(name, _title(text), _line("paper", text), times.get(name))
        for name, text in texts.items()
    ]


def problems() -> list[ShippedProblem]:
    """List every standard problem, sorted by name."""
    shipped = []
    for name, title, paper, cpu_s in listed():
        text = _file(name).read_text(encoding="utf-8")
        if mark := _PROBLEM.search(text):
            reference = mark[2] or _line("reference", text) or _line("bound", text)
            numbers = _published_numbers(name, _line("published", text))
            shipped.append(
                ShippedProblem(name, int(mark[1]), title, numbers, reference, paper, cpu_s)
            )
    return shipped


def _published_numbers(name: str, files: str) -> int:
    """Count the published numbers that an experiment measures, each once."""
    printed = set()
    for path in re.findall(r"[^\[\], ]+", files):
        with (folder() / path).open(encoding="utf-8", newline="") as file:
            for row in csv.DictReader(file):
                measured = row.get("label") and name in (row["experiment"] or name).split("; ")
                if measured and not row["value"].endswith("biased"):
                    printed.add(tuple(row.get(key) for key in _PRINTED_AT))
    return len(printed)


def located(config: Path, note: Callable[[str], None]) -> Path:
    """Find the file of a config: of that path, or else the shipped experiment of that name.

    Raises UserError for a word that is neither; says so if it is both.
    """
    word = str(config)
    if config.is_file() or not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_-]*", word):
        if word in names():
            note(f"note: using the file {word}; the shipped experiment is {_file(word)}")
        return config
    if config.exists():
        note(f"note: using the shipped experiment {word}; the folder of this name is ignored")
    return named(word)


def named(name: str) -> Path:
    """Find the file of the shipped experiment; raises UserError if there is none of this name."""
    if name in names():
        return _file(name)
    from trackbench.config.mistakes import unknown

    beside = [
        f"{name}{ending}" for ending in (".yaml", ".yml") if Path(f"{name}{ending}").is_file()
    ]
    hint = f"did you mean {beside[0]}?" if beside else unknown(name, names())
    what = f"is neither a file nor a shipped experiment; {hint}"
    raise UserError(Problem(Mark(name), "", what))


def copied(name: str, target: Path) -> list[Path]:
    """Copy a shipped experiment and its parts into a folder; returns the files written.

    A file that is there already with the same content is left alone; raises UserError, before anything
    is written, for every one with another content.
    """
    files = sorted(part for part in with_parts(named(name)) if part.is_file())
    content = {target / path.relative_to(folder()): path.read_bytes() for path in files}
    # Reject changed files before anything is written.
    existing = {path for path in content if path.exists()}
    changed = [p for p in sorted(existing) if not p.is_file() or p.read_bytes() != content[p]]
    if changed:
        what = "exists with another content; copy to another folder, or remove this file"
        raise UserError(*(Problem(Mark(f"copy {name}"), str(p), what) for p in changed))
    for path in content.keys() - existing:
        ensure_folder(path.parent)
        write_bytes(path, content[path])
    return sorted(content.keys() - existing)


def suite_names() -> list[str]:
    """List the shipped suites' names, sorted."""
    return sorted(path.stem for path in (folder() / "suites").glob("*.yaml"))


def suite_file(suite: Path) -> Path:
    """Find a suite's file: of that path, or else the shipped suite of that name; raises UserError."""
    word = str(suite)
    if suite.is_file() or suite.suffix:
        return suite
    if word in suite_names():
        return folder() / "suites" / f"{word}.yaml"
    from trackbench.config.mistakes import unknown

    what = f"is neither a file nor a shipped suite; {unknown(word, suite_names())}"
    raise UserError(Problem(Mark(word), "", what))


class SuiteTime(NamedTuple):
    """Recorded time of a problem of a shipped suite: seconds on one processor for so many runs."""

    runs: int
    cpu_s: float


def suite_times(name: str) -> dict[str, SuiteTime]:
    """Return the recorded times of a shipped suite's problems by name; empty for another suite."""
    with (folder() / "suites" / _TIMES).open(encoding="utf-8", newline="") as file:
        return {
            row["problem"]: SuiteTime(int(row["runs"]), float(row["cpu_s"]))
            for row in csv.DictReader(file)
            if row["suite"] == name
        }


def with_parts(file: Path, files: frozenset[Path] = frozenset()) -> frozenset[Path]:
    """Collect a YAML file and every file that it names, directly or through another; some may not exist.

    Raises UserError if one of them is no YAML.
    """
    from trackbench.yaml_source import read

    files |= {file}
    if file.suffix in (".yaml", ".yml") and file.is_file():
        parts = {file.parent / word for word in _words(read(file).data)}
        for part in sorted(part for part in parts - files if part.suffix):
            files = with_parts(part, files)
    return files


def _words(data: object) -> Iterator[str]:
    inner = data.values() if isinstance(data, dict) else data if isinstance(data, list) else ()
    for value in inner:
        yield from [value] if isinstance(value, str) else _words(value)


def _file(name: str) -> Path:
    return folder() / f"{name}.yaml"


def _title(text: str) -> str:
    """Return the title, with the number of runs where it asks for it."""
    return _line("title", text).replace("{runs}", _line("runs", text) or "100")


def _line(key: str, text: str) -> str:
    """Return the value of a key that stands on a line of its own."""
    match = re.search(rf"^{key}: (.+)$", text, re.MULTILINE)
    return match[1].strip("\"'") if match else ""
