"""Option `--allow-plugins`: which plugins and programs of a config may not run without it."""

from collections.abc import Mapping

from trackbench.yaml_source import Source

PROGRAM_REFUSED = "a program is run only with --allow-plugins"
"""Mistake of a filter whose ``command`` may not run."""


def plugin_refused(name: str) -> str:
    """Explain that the code of the plugin file ``name`` may not run."""
    return f"the code in {name} is run only with --allow-plugins"


def is_allowed(source: Source, values: Mapping[str, object]) -> bool:
    """Test whether the program of a filter's ``command``, among its keys ``values``, may be run.

    ``source.programs`` are the absolute paths of the files that the user allows, None if all may be run.
    """
    command = values.get("command")
    if source.programs is None:  # all are allowed
        return True
    if not isinstance(command, list) or not command:  # it cannot be run, and is reported
        return True
    # The user has allowed files, and no further words: with these a program may do anything. A list is
    # searched, as the word may be a value that a set cannot look up.
    return len(command) == 1 and command[0] in list(source.programs)
