"""Include components of a config from other files: a path, or ``{use: path, key: value}``."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from trackbench.config.did_you_mean import unknown
from trackbench.errors import Problem, UserError, reason
from trackbench.readable_files import require_regular_file
from trackbench.registry import Group, kinds, of_kind
from trackbench.yaml_source import Keys, MarkedMapping, Source, dotted, put, read

COMPONENT_GROUPS: dict[str, Group] = {
    "scenario": "scenarios",
    "filters": "filters",
    "tables": "tables",
    "figures": "figures",
}
_GROUPS_BY_LABEL = ("filters", "tables", "figures")
_MOST_NESTED_FILES = 10  # files that use another file


def inline_parts(source: Source, folder: Path) -> dict[str, list[Problem]]:
    """Replace every path, and every ``{use: path, ...}``, by the mapping in that file.

    A component that cannot be read becomes an empty mapping. Return the reasons by the path of each such
    component. Paths of files count from ``folder``.
    """
    # Step 1: where a component may stand.
    places: list[Keys] = []
    if "scenario" in source.data:
        places.append(("scenario",))
    tuning = source.data.get("tuning")
    if isinstance(tuning, dict) and tuning.get("scenario") is not None:
        places.append(("tuning", "scenario"))
    for group in _GROUPS_BY_LABEL:
        if isinstance(source.data.get(group), dict):
            places += [(group, label) for label in source.data[group]]
    # Step 2: replace each by its file, then those within it.
    unread: dict[str, list[Problem]] = {}
    for keys in places:
        try:
            _inline(source, keys, folder, depth=0)
            if isinstance(source.value_at(keys), dict):
                _include_nested(source, keys, depth=0)
        except UserError as error:
            problems = [p for p in error.problems if isinstance(p, Problem)]
            unread[dotted(keys)] = [replace(p, path=p.path or dotted(keys)) for p in problems]
            source.value_at(keys[:-1])[keys[-1]] = MarkedMapping()  # to check the rest, too
    return unread


def _include_nested(source: Source, keys: Keys, depth: int) -> None:
    """Replace the paths of YAML files within the component at ``keys`` by the mappings in the files.

    Paths are relative to the file that names them. ``depth`` is the number of files that use one another
    down to this component.
    """
    data = source.value_at(keys)
    inner_keys: list[str | int] = list(data) if isinstance(data, dict) else [*range(len(data))]
    for key in inner_keys:
        value = data[key]
        place = (*keys, key)
        is_file = isinstance(value, str) and key != "use" and value.endswith((".yaml", ".yml"))
        uses_file = isinstance(value, dict) and "use" in value
        if is_file or uses_file:
            folder = Path(source.mark(place).file).parent
            _inline(source, place, folder, depth + 1)
            _include_nested(source, place, depth + 1)
        elif isinstance(value, dict | list):
            _include_nested(source, place, depth)


def _inline(source: Source, keys: Keys, folder: Path, depth: int) -> None:
    """Replace the path of a YAML file at ``keys`` by the mapping in that file.

    Of ``{use: path, key: value}`` the further keys replace those of the file. The path is relative to
    ``folder``. ``depth`` is the number of files that use one another down to this one.
    """
    # Step 1: the path, and the keys beside `use`.
    parent = source.value_at(keys[:-1])
    name = parent[keys[-1]]
    changes = MarkedMapping()
    mark = source.mark(keys)
    if isinstance(name, dict):
        if "use" not in name:
            return
        mark = source.mark((*keys, "use"))
        changes = MarkedMapping(name)
        name = changes.pop("use")
        changes.marks.pop("use", None)
    if not isinstance(name, str):
        message = "is neither a mapping nor a path; write {kind: ...} or the path of a YAML file"
        raise UserError(Problem(mark, dotted(keys), message))
    if depth > _MOST_NESTED_FILES:
        raise UserError(Problem(mark, dotted(keys), "use: files that use each other in a circle"))
    # Step 2: read the file, and lay the keys over its mapping.
    path = folder / name
    try:
        require_regular_file(path)
    except OSError as error:
        message = f"cannot read {path}: {reason(error)}"
        group = COMPONENT_GROUPS.get(str(keys[0]))
        is_word = isinstance(parent[keys[-1]], str) and not name.endswith((".yaml", ".yml"))
        # A word in place of a scenario, filter, table or figure itself (depth 0) may be meant as a kind.
        if group is not None and is_word and depth == 0:
            if of_kind(group, name) is not None:
                message = f"{name!r} is a kind, and not the path of a file; write {{kind: {name}}}"
            else:
                hint = unknown(name, list(kinds(group)))
                message += f"; a component is written {{kind: ...}}, {hint}"
        raise UserError(Problem(mark, dotted(keys), message)) from None
    file_source = read(path)
    if not isinstance(file_source.data, dict):
        raise UserError(Problem(file_source.start, dotted(keys), "is not a mapping with a kind"))
    # A mapping among the keys replaces that of the file if it has another kind, else both are merged.
    whole = deep_merge(file_source.data, changes, by_kind=True)
    put(parent, keys[-1], whole, file_source.start)  # its position is the beginning of its file
    if "use" in whole:
        _inline(source, keys, path.parent, depth + 1)


def deep_merge(
    base: Mapping[str, object], top: Mapping[str, object], by_kind: bool = False
) -> MarkedMapping:
    """Merge the keys of ``top`` into ``base``; a mapping in both is merged in the same way.

    ``by_kind``: a mapping of another kind, and so with other keys, replaces that of the base.
    """
    merged = MarkedMapping(base)
    marked_top = MarkedMapping(top)
    merged.marks |= marked_top.marks
    merged.key_marks |= marked_top.key_marks
    for key, value in top.items():
        base_value = base.get(key)
        merged[key] = value
        if isinstance(base_value, dict) and isinstance(value, dict):
            base_kind = base_value.get("kind")
            is_other_kind = value.get("kind", base_kind) != base_kind
            if not (by_kind and is_other_kind):
                merged[key] = deep_merge(base_value, value, by_kind)
    return merged
