"""Results folder that a run writes to: its name, and checks for foreign files and permissions."""

import json
import os
import stat
from collections.abc import Collection
from contextlib import suppress
from pathlib import Path

from trackbench.commands.run_options import Options, say
from trackbench.config.experiment import Experiment
from trackbench.config.resolved_config import as_yaml
from trackbench.config.suite import Suite
from trackbench.errors import Mark, Problem, UserError, reason
from trackbench.results.file_names import DERIVED_FILES, RUN_FILES
from trackbench.yaml_source import read


def choose_folder(experiment: Experiment, options: Options, is_only_config: bool) -> Path:
    """Return the results folder of an experiment.

    The option ``out`` is the results folder if there is only one config. If there are several, it
    contains their folders.
    """
    folder = Path("results" if options.out is None else options.out)
    if options.out is None or not is_only_config:
        # The folder is named after the experiment and the files of its additional filters.
        words = [experiment.settings.name]
        if options.filters:
            words.append("with")
            words += [Path(file).stem for file in options.filters]
        folder /= "-".join(words)
    if options.spare:
        # A quick run leaves results of more runs as they are.
        runs_in_folder = stored_runs(folder)
        if runs_in_folder > experiment.settings.runs:
            say(
                f"note: {folder}/ has {runs_in_folder} runs and stays; --force replaces them",
                options,
            )
            folder = folder.with_name(f"{folder.name}-quick")
    return folder


def check_out(folder: Path, data: Collection[str]) -> None:
    """Raise UserError if a run cannot write into the results folder, or would replace foreign files.

    ``data`` names the data files that the run writes.
    """
    # The folder itself may be missing, but all that exists on the way to it must be folders.
    for path in (folder, *folder.parents):
        message = ""
        try:
            if not stat.S_ISDIR(path.stat().st_mode):
                message = f"{path} is a file, not a folder"
        except (FileNotFoundError, NotADirectoryError):
            if path.is_symlink():
                message = f"{path} is a link to nothing"
        except OSError as error:
            message = f"{path}: {reason(error)}"
        if message:
            raise UserError(Problem(Mark(f"--out {folder}"), "", message))
    foreign_file = _foreign_file(folder, data)
    if foreign_file is not None:
        message = "no run wrote this file, and this run would replace it; choose another --out"
        raise UserError(Problem(Mark(str(foreign_file)), "", message))
    if not may_write(folder):
        message = "may not be written in; another folder: --out DIR"
        raise UserError(Problem(Mark(f"{folder}/"), "", message))


def stored_runs(folder: Path) -> int:
    """Read the number of runs of the results in a folder; 0 without results."""
    with suppress(OSError, ValueError, LookupError, TypeError):
        return int(json.loads((folder / "manifest.json").read_bytes())["runs"])
    return 0


def _foreign_file(folder: Path, data: Collection[str]) -> Path | None:
    """Find a file that a run would replace although no run wrote it; None if there is none.

    ``data`` names the data files that the run writes. A config.yaml as runs write it may be replaced.
    """
    # Every file in a folder of a run, even of a killed one, may be replaced. It has one of these files.
    if any((folder / name).exists() for name in ("manifest.json", "points.json")):
        return None
    for name in ("config.yaml", *data, *RUN_FILES, *DERIVED_FILES):
        path = folder / name
        if not path.is_file():
            continue
        is_config_of_run = name == "config.yaml" and _is_written_by_run(path)
        if not is_config_of_run:
            return path
    return None


def _is_written_by_run(config: Path) -> bool:
    """Test whether a config has the form in which runs write theirs; False if it cannot be read.

    A run writes the YAML that `as_yaml` makes of the data.
    """
    with suppress(OSError, UserError, ValueError, LookupError):
        text = config.read_text(encoding="utf-8")
        return as_yaml(read(config).data) == text
    return False


def may_write(folder: Path) -> bool:
    """Test whether the folder, or its first existing parent, is writable."""
    first_existing = folder
    for path in (folder, *folder.absolute().parents):
        if path.exists():
            first_existing = path
            break
    return os.access(first_existing, os.W_OK | os.X_OK)


def suite_folder(suite: Suite, options: Options) -> Path:
    """Return the folder of the suite's scores, in which each problem has a results folder.

    Without the option ``out`` its name is that of the suite, and of all by which the run differs from
    the whole suite.
    """
    if options.out is not None:
        return Path(options.out)
    parts = [suite.settings.name]
    # Names differ, so that scores of the whole suite and those of another problem are not replaced. A
    # suite is a part if the user has chosen some of its problems.
    is_single = suite.is_part and len(suite.problems) == 1
    if is_single:
        parts.append(suite.problems[0].name)
    if options.only or (suite.is_part and not is_single):
        parts.append("part")
    if options.quick:
        parts.append("quick")
    if options.filters:
        parts += ["with", *(Path(path).stem for path in options.filters)]
    return Path("results") / "-".join(parts)
