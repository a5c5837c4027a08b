"""The experiments that come with the package: found by their names, listed, and copied to be edited.

Each stands in the folder of its paper or topic, and no two have the same name. A wheel holds them
beside the code; in a checkout, editable installs included, they are the repository's.
"""

import csv
import os
import re
from collections.abc import Callable, Iterable, Iterator
from importlib import resources
from pathlib import Path
from typing import NamedTuple

from trackbench.atomic_files import ensure_folder, write_bytes
from trackbench.errors import Mark, Problem, UserError

_TIMES = "times.csv"
_SUITES = "suites"
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
    """Find the folder that holds the folders of the shipped experiments, the data and the suites."""
    package = Path(str(resources.files("trackbench")))
    in_package = package / "experiments"
    if in_package.is_dir():
        return in_package
    return package.parent / "experiments"


def files() -> dict[str, Path]:
    """Map every shipped experiment's name to its file, sorted by name."""
    paths = [path for path in folder().glob("*/*.yaml") if path.parent.name != _SUITES]
    return {path.stem: path for path in sorted(paths, key=lambda path: path.stem)}


def names() -> list[str]:
    """List every shipped experiment's name, sorted."""
    return [*files()]


def listed() -> list[Shipped]:
    """List every shipped experiment, sorted by name.

    The few keys are found by a pattern, as the import of YAML takes longer.
    """
    with (folder() / _TIMES).open(encoding="utf-8", newline="") as file:
        times = {row["experiment"]: float(row["cpu_s"]) for row in csv.DictReader(file)}
    shipped = []
    for name, path in files().items():
        text = path.read_text(encoding="utf-8")
        # The title has the number of runs in place of {runs}.
        runs = _value_of_key("runs", text) or "100"
        shipped.append(
            Shipped(
                name=name,
                title=_value_of_key("title", text).replace("{runs}", runs),
                paper=_value_of_key("paper", text),
                cpu_s=times.get(name),
            )
        )
    return shipped


def problems() -> list[ShippedProblem]:
    """List every standard problem, sorted by name.

    Its reference is that of the key `problem`, else the experiment's reference filter, else its bound.
    """
    shipped_problems = []
    file_by_name = files()
    for shipped in listed():
        file = file_by_name[shipped.name]
        text = file.read_text(encoding="utf-8")
        mark = _PROBLEM.search(text)
        if mark is None:
            continue
        version, reference = mark.groups()
        shipped_problems.append(
            ShippedProblem(
                name=shipped.name,
                version=int(version),
                title=shipped.title,
                numbers=_count_published_numbers(file, _value_of_key("published", text)),
                reference=(
                    reference or _value_of_key("reference", text) or _value_of_key("bound", text)
                ),
                paper=shipped.paper,
                cpu_s=shipped.cpu_s,
            )
        )
    return shipped_problems


def _count_published_numbers(experiment: Path, published: str) -> int:
    """Count the published numbers that an experiment's file measures, each once.

    ``published`` is the YAML list of the files with the numbers.
    """
    printed_places = set()
    for path in re.findall(r"[^\[\], ]+", published):
        with (experiment.parent / path).open(encoding="utf-8", newline="") as file:
            for row in csv.DictReader(file):
                experiments = (row["experiment"] or experiment.stem).split("; ")
                # A number without the label of a filter here is printed and not measured.
                is_measured = row.get("label") and experiment.stem in experiments
                # The values "biased" and "unbiased" are words, not numbers.
                if is_measured and not row["value"].endswith("biased"):
                    # Several readings of a number are rows with one place in the paper.
                    printed_places.add(tuple(row.get(key) for key in _PRINTED_AT))
    return len(printed_places)


def located(config: Path, note: Callable[[str], None]) -> Path:
    """Return the path of a config file, or the file of the shipped experiment of this name.

    ``config`` is what the user wrote. Raises UserError for a word that is neither, and for a missing
    file with the name of a shipped experiment. If the word is both, ``note`` is called with a line to
    print.
    """
    word = str(config)
    # A word with a point or a slash is a path, and can be no shipped name.
    if config.is_file() or not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_-]*", word):
        shipped_file = files().get(config.stem)
        if shipped_file is not None and word == config.stem:
            note(f"note: using the file {word}; the shipped experiment is {shipped_file}")
        if shipped_file is not None and config.suffix == ".yaml" and not config.exists():
            message = f"no such file or directory; the shipped experiment is {shipped_file}"
            raise UserError(Problem(Mark(word), "", message))
        if config.is_dir():
            # A path that cannot be read is reported at its first line and column, as `read` does.
            raise UserError(Problem(Mark(word, 1, 1), "", _describe_folder(config)))
        return config
    # A plain word is no path of a file, and its mark has no line.
    if config.is_dir() and word not in files():
        raise UserError(Problem(Mark(word), "", _describe_word(word) or _describe_folder(config)))
    if config.exists():
        note(f"note: using the shipped experiment {word}; the folder of this name is ignored")
    return find_shipped(word)


def _describe_folder(path: Path) -> str:
    """Describe a folder that was named in place of a config, and list its configs."""
    if (path / "manifest.json").is_file() and (path / "config.yaml").is_file():
        return f"is a results folder; name its config, {path / 'config.yaml'}, or the experiment"
    configs = sorted(file.name for file in path.glob("*.yaml"))
    if not configs:
        return "is a folder; name a file in YAML, or an experiment of `trackbench list`"
    return f"is a folder; name one of its files: {_first_names(configs)}"


def find_shipped(name: str) -> Path:
    """Find the file of the shipped experiment; raises UserError if there is none of this name."""
    file_by_name = files()
    if name in file_by_name:
        return file_by_name[name]
    from trackbench.config.key_mistakes import unknown

    hint = unknown(name, [*file_by_name])
    for ending in (".yml", ".yaml"):
        if Path(f"{name}{ending}").is_file():
            hint = f"did you mean {name}{ending}?"
    message = _describe_word(name) or f"is neither a file nor a shipped experiment; {hint}"
    raise UserError(Problem(Mark(name), "", message))


def _describe_word(word: str) -> str:
    """Describe a problem of a suite, a suite, or a folder of shipped experiments; empty for other words.

    The text says what to name in place of the word.
    """
    file_by_name = files()
    for suite, problem in _problems_of_suites(word):
        message = (
            f"is a problem of the suite {suite}: `trackbench suite {suite} --problem {word}` "
            "runs it, and with --dry-run shows its state and measurement"
        )
        experiment = str(problem.get("use") or word)
        if experiment in file_by_name:
            return (
                f"{message}; `trackbench show {experiment}` prints the experiment with its scenario, "
                f"and {experiment} is the name for other commands"
            )
        file = folder() / _SUITES / experiment
        return f"{message}; for other commands, name the file of its experiment: {file}"
    if word in suite_names():
        used = {problem.get("use") or name for name, problem in _all_problems(word)}
        experiments = sorted(name for name in used if name in file_by_name)
        return (
            f"is a suite, which is a list of problems: `trackbench suite {word}` runs it; for other "
            f"commands, name one of its experiments: {_first_names(experiments)}"
        )
    in_folder = sorted(name for name, file in file_by_name.items() if file.parent.name == word)
    if in_folder:
        return (
            f"is the folder of several shipped experiments; name one of them: "
            f"{_first_names(in_folder)}"
        )
    return ""


_MOST_LISTED = 12


def _first_names(listed_names: list[str]) -> str:
    """Write names with commas; of more than `_MOST_LISTED` the first ones, and how many more."""
    words = listed_names[:_MOST_LISTED]
    if len(listed_names) > _MOST_LISTED:
        words.append(f"{len(listed_names) - _MOST_LISTED} more")
    return ", ".join(words)


def _problems_of_suites(name: str) -> Iterator[tuple[str, dict[str, object]]]:
    """Yield the shipped suites that have a problem of this name, each with the problem's keys."""
    for suite in suite_names():
        for problem_name, problem in _all_problems(suite):
            if problem_name == name:
                yield suite, problem


def _all_problems(suite: str) -> Iterator[tuple[str, dict[str, object]]]:
    """Yield the problems of a shipped suite, each with its keys."""
    from trackbench.yaml_source import read

    groups = read(suite_file(Path(suite))).data["groups"]
    for group in groups.values():
        yield from group["problems"].items()


class Copied(NamedTuple):
    """A shipped experiment in a folder of the user's."""

    config: Path
    """the copy of the experiment's file"""
    written: list[Path]
    """files that were not there before"""


def copy_experiment(name: str, target: Path) -> Copied:
    """Copy a shipped experiment and its parts into a folder.

    The copies keep their relative paths. The experiment's file is written to ``target`` itself, or one
    folder deeper if it has parts outside of its own folder, such as recorded data. An existing file with
    the same content is left alone. Raises UserError, before anything is written, for every existing file
    with another content.
    """
    experiment_file = find_shipped(name)
    parts = sorted(part for part in with_parts(experiment_file) if part.is_file())
    paths = [Path(os.path.normpath(part)) for part in parts]
    root = os.path.commonpath([path.parent for path in paths])
    content = {target / path.relative_to(root): path.read_bytes() for path in paths}
    # Step 1: reject changed files before anything is written.
    existing = {path for path in content if path.exists()}
    problems = []
    for path in sorted(existing):
        if not path.is_file() or path.read_bytes() != content[path]:
            message = "exists with another content; copy to another folder, or remove this file"
            problems.append(Problem(Mark(f"copy {name}"), str(path), message))
    if problems:
        raise UserError(*problems)
    # Step 2: write the others.
    new_files = sorted(content.keys() - existing)
    for path in new_files:
        ensure_folder(path.parent)
        write_bytes(path, content[path])
    return Copied(config=target / experiment_file.relative_to(root), written=new_files)


def suite_names() -> list[str]:
    """List the shipped suites' names, sorted."""
    return sorted(path.stem for path in (folder() / _SUITES).glob("*.yaml"))


def suite_file(suite: Path) -> Path:
    """Find a suite's file: of that path, or else the shipped suite of that name; raises UserError."""
    word = str(suite)
    if suite.is_file() or suite.suffix:
        return suite
    if word in suite_names():
        return folder() / _SUITES / f"{word}.yaml"
    from trackbench.config.key_mistakes import unknown

    message = f"is neither a file nor a shipped suite; {unknown(word, suite_names())}"
    raise UserError(Problem(Mark(word), "", message))


class SuiteTime(NamedTuple):
    """Recorded time of a problem of a shipped suite: seconds on one processor for so many runs.

    They include the tuning of the roster, which `--quick` shortens.
    """

    runs: int
    cpu_s: float


def suite_times(name: str) -> dict[str, list[SuiteTime]]:
    """Return the recorded times of a shipped suite's problems by name; empty for another suite.

    Those of a problem are sorted by runs: the first is that of `--quick`, the last that of the suite.
    """
    times: dict[str, list[SuiteTime]] = {}
    with (folder() / _SUITES / _TIMES).open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            if row["suite"] == name:
                time = SuiteTime(runs=int(row["runs"]), cpu_s=float(row["cpu_s"]))
                times.setdefault(row["problem"], []).append(time)
    return {problem: sorted(times_of_problem) for problem, times_of_problem in times.items()}


def with_parts(file: Path, files: frozenset[Path] = frozenset()) -> frozenset[Path]:
    """Return a YAML file, every file that it names directly or through another, and ``files``.

    Files that are already in ``files`` are not read. A named file may be missing. Raises UserError if a
    YAML file cannot be read.
    """
    from trackbench.yaml_source import read

    files |= {file}
    if file.suffix in (".yaml", ".yml") and file.is_file():
        # Every word with an ending may be the path of a file.
        parts = {file.parent / word for word in _walk_words(read(file).data)}
        for part in sorted(part for part in parts - files if part.suffix):
            files = with_parts(part, files)
    return files


def _walk_words(data: object) -> Iterator[str]:
    """Yield every word within a mapping or list."""
    values: Iterable[object] = ()
    if isinstance(data, dict):
        values = data.values()
    elif isinstance(data, list):
        values = data
    for value in values:
        if isinstance(value, str):
            yield value
        else:
            yield from _walk_words(value)


def _value_of_key(key: str, text: str) -> str:
    """Return the value of a key that stands on a line of its own; empty if there is none."""
    match = re.search(rf"^{key}: (.+)$", text, re.MULTILINE)
    if match is None:
        return ""
    return match[1].strip("\"'")
