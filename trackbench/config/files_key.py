"""Keys `files` and `environment` of a config: what its programs and plugins read."""

from pathlib import Path

from trackbench.config.experiment_keys import Settings
from trackbench.config.file_paths import folder_of
from trackbench.errors import Problem, reason
from trackbench.filters.base import Filter
from trackbench.folder_digests import digest_of_all
from trackbench.registry import of_kind
from trackbench.yaml_source import Source


def add_declared(source: Source, values: dict[str, object]) -> None:
    """Add the files and environment variables that the config declares to those of one program.

    The config declares them for all programs, at its top level. ``values`` are the keys of a filter
    that is a program; the lists ``files`` and ``environment`` in it are extended.
    """
    for key in ("files", "environment"):
        declared = source.data.get(key)
        own_words = values.get(key, [])
        if not isinstance(declared, list) or not isinstance(own_words, list):
            continue  # the validation of the whole reports it
        words = [word for word in declared if isinstance(word, str)]
        if key == "files":
            folder = folder_of(source.mark((key,)))
            words = [str((folder / word).absolute()) for word in words]
        if words:
            values[key] = own_words + [word for word in words if word not in own_words]


def digest_declared_files(
    source: Source, folder: Path, may_run: bool
) -> tuple[tuple[tuple[str, str], ...], list[Problem]]:
    """Return path and digest of each declared file, and a mistake for each that cannot be read.

    ``may_run`` is true if the user allows code of plugins to run. Without it no file is read, since the
    config may be a stranger's, and a file is a mistake only if it is missing or out of reach.
    """
    digests = []
    problems = []
    for i, name in enumerate(words_of_list(source, "files")):
        file = folder / name
        try:
            file.stat()
            if may_run:
                digests.append((str(file.absolute()), digest_of_all(file)))
        except FileNotFoundError:
            message = "no such file or folder; write its path from the config's folder"
            problems.append(source.problem(("files", i), f"{file}: {message}"))
        except OSError as error:
            problems.append(source.problem(("files", i), f"{file}: {reason(error)}"))
    return tuple(digests), problems


def words_of_list(source: Source, key: str) -> list[str]:
    """Read the words in a list of the config; the validation of the whole reports other values."""
    words = source.data.get(key) or []
    if not isinstance(words, list):
        return []
    return [word for word in words if isinstance(word, str)]


def check_idle_files(source: Source, settings: Settings) -> None:
    """Reject ``files`` and ``environment`` in a config without plugins and without programs."""
    has_program = any(_runs_program(entry) for entry in settings.filters.values())
    for key in ("files", "environment"):
        if getattr(settings, key) and not (settings.plugins or has_program):
            message = "is what plugins and programs read, and there are no `plugins`; leave it out"
            source.add_key_problem((key,), message)


def _runs_program(entry: object) -> bool:
    """Test whether a filter's entry names a kind that runs a program."""
    if not isinstance(entry, dict):
        return False
    kind = entry.get("kind")
    if not isinstance(kind, str):
        return False
    cls = of_kind("filters", kind)
    return cls is not None and issubclass(cls, Filter) and cls.runs_program
