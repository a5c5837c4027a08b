"""The experiments that come with the package: found by their names, and listed.

Each stands in the folder of its paper or topic, and no two have the same name. A wheel holds them
beside the code; in a checkout, editable installs included, they are the repository's.
"""

import csv
import re
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from trackbench.config.shipped_folder import SUITES, TIMES, folder
from trackbench.config.shipped_suites import all_problems, problems_of_suites, suite_names
from trackbench.errors import Mark, Problem, UserError, first_names

_MOST_LISTED = 12
"""Largest number of names that a message lists."""
_DEFAULT_RUNS = "100"
"""Default of the key `runs`, that of `Settings`, whose import takes longer than a list."""


class Shipped(NamedTuple):
    """A shipped experiment: name, title, the paper that it reproduces, and seconds on one processor."""

    name: str
    title: str
    paper: str
    cpu_s: float | None


def files() -> dict[str, Path]:
    """Map every shipped experiment's name to its file, sorted by name."""
    paths = [path for path in folder().glob("*/*.yaml") if path.parent.name != SUITES]
    return {path.stem: path for path in sorted(paths, key=lambda path: path.stem)}


def names() -> list[str]:
    """List every shipped experiment's name, sorted."""
    return [*files()]


def listed() -> list[Shipped]:
    """List every shipped experiment, sorted by name.

    The few keys are found by a pattern, as the import of YAML takes longer.
    """
    with (folder() / TIMES).open(encoding="utf-8", newline="") as file:
        times = {row["experiment"]: float(row["cpu_s"]) for row in csv.DictReader(file)}
    shipped = []
    for name, path in files().items():
        text = path.read_text(encoding="utf-8")
        # The title has the number of runs in place of {runs}.
        runs = value_of_key("runs", text) or _DEFAULT_RUNS
        shipped.append(
            Shipped(
                name=name,
                title=value_of_key("title", text).replace("{runs}", runs),
                paper=value_of_key("paper", text),
                cpu_s=times.get(name),
            )
        )
    return shipped


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
    configs = sorted(file.name for file in path.glob("*.yaml") if file.is_file())
    if not configs:
        return "is a folder; name a file in YAML, or an experiment of `trackbench list`"
    return f"is a folder; name one of its files: {first_names(configs, _MOST_LISTED)}"


def find_shipped(name: str) -> Path:
    """Find the file of the shipped experiment; raises UserError if there is none of this name."""
    file_by_name = files()
    if name in file_by_name:
        return file_by_name[name]
    from trackbench.config.did_you_mean import unknown

    hint = unknown(name, [*file_by_name])
    for ending in (".yml", ".yaml"):
        if Path(f"{name}{ending}").is_file():
            hint = f"did you mean {name}{ending}?"
    # The name of another shipped thing, such as a suite, is explained; any other word gets the hint.
    message = _describe_word(name) or f"is neither a file nor a shipped experiment; {hint}"
    raise UserError(Problem(Mark(name), "", message))


def _describe_word(word: str) -> str:
    """Describe a problem of a suite, a suite, or a folder of shipped experiments; empty for other words.

    The text says what to name in place of the word.
    """
    file_by_name = files()
    for suite, problem in problems_of_suites(word):
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
        file = folder() / SUITES / experiment
        return f"{message}; for other commands, name the file of its experiment: {file}"
    if word in suite_names():
        used = {problem.get("use") or name for name, problem in all_problems(word)}
        experiments = sorted(name for name in used if name in file_by_name)
        return (
            f"is a suite, which is a list of problems: `trackbench suite {word}` runs it; for other "
            f"commands, name one of its experiments: {first_names(experiments, _MOST_LISTED)}"
        )
    in_folder = sorted(name for name, file in file_by_name.items() if file.parent.name == word)
    if in_folder:
        return (
            f"is the folder of several shipped experiments; name one of them: "
            f"{first_names(in_folder, _MOST_LISTED)}"
        )
    return ""


def value_of_key(key: str, text: str) -> str:
    """Return the value of a key that stands on a line of its own; empty if there is none."""
    match = re.search(rf"^{key}: (.+)$", text, re.MULTILINE)
    if match is None:
        return ""
    return match[1].strip("\"'")
