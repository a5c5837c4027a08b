"""Pages of the reference, made from the code: kinds, metrics, statistics, commands, Python."""

import ast
import dataclasses
import inspect
import re
import textwrap
from collections.abc import Iterable, Iterator
from itertools import pairwise
from pathlib import PurePosixPath
from typing import Any

import trackbench
from trackbench import api
from trackbench.help import descriptions, lists, metrics
from trackbench.metrics import METRICS
from trackbench.registry import GROUPS, documentation

_WHAT = {
    "scenarios": "What is simulated, as a whole.",
    "targets": "How the target moves, or what was recorded of it: `scenario.target`.",
    "motions": "How a state moves: what drives a target, and what filters `assume`.",
    "sensors": "What is measured: `scenario.sensor`, one or a list of them.",
    "starts": "What filters know before the first measurement: `scenario.start`.",
    "filters": "What is compared: the entries of `filters`.",
    "tables": "The entries of `tables`.",
    "figures": "The entries of `figures`.",
}
_BETTER = {"zero": "nearer 0", "one": "nearer 1"}


def pages() -> dict[str, str]:
    """Every page by its place on the site."""
    found = {f"reference/{group}.md": _group(group) for group in GROUPS}
    return found | {
        "reference/config.md": _config(),
        "reference/metrics.md": _metrics(),
        "reference/commands.md": _commands(),
        "reference/python.md": _python(),
    }


def _config() -> str:
    lines = [
        "# The experiment file",
        "A YAML file. Numbers follow YAML 1.2 (`1e-5` is a number), and whatever is a mapping may be "
        "the path of a file that holds it, or `{use: path, key: another value}`.",
        "## Keys",
        *_key_table(descriptions.experiment_keys()),
        "## What every filter may assume",
        "Beside the keys of its kind and `preset`, an entry of `filters` may name what it assumes of "
        "the target and of the sensors; by default the scenario's own `assume`, or what is true.",
        *_key_table(descriptions.assume_keys()),
    ]
    return _page(lines)


def _group(group: Any) -> str:
    kinds = documentation(group)
    lines = [
        f"# {group.capitalize()}",
        _WHAT[group],
        _table(
            ["kind", "what it is"],
            [[f"[`{kind}`](#{kind})", _text(_first(doc))] for kind, doc in kinds.items()],
        ),
    ]
    for kind in kinds:
        (entry,) = (e for e in descriptions.entries(kind) if e["group"] == group)
        lines += [f"## {kind} {{ #{kind} }}", *_kind(entry)]
    lines += [
        "## One of your own",
        f"What a class of the group has (`trackbench describe {group}`); [how](../extending.md).",
        _table(
            ["method or attribute", "", "what it is"],
            [
                [f"`{hook['hook']}`", "needed" if hook["needed"] else "", _text(hook["text"])]
                for hook in descriptions.entries(group)
            ],
        ),
    ]
    return _page(lines)


def _kind(entry: dict[str, Any]) -> Iterator[str]:
    yield from map(_text, entry["text"].split("\n\n"))
    keys = [key for key in entry["keys"] if not key["key"].startswith("assume.")]
    yield from _key_table(keys)
    for name, given in entry["presets"].items():
        yield f"`preset: {name}` is `{descriptions.preset_text(given)}`."
    for note in entry["notes"]:
        head, _, rest = note.partition(": ")
        if head.startswith("hooks"):
            continue
        yield f"{head.capitalize()}: {_text(rest)}"


def _key_table(keys: list[dict[str, str]]) -> Iterator[str]:
    if not keys:
        yield "It has no keys."
        return
    rows = [[f"`{k['key']}`", _default(k["default"]), _linked(_text(k["text"]))] for k in keys]
    # On a phone the cells of a row stand one below another.
    yield '<div class="keys" markdown="1">'
    yield _table(["key", "default", "what it is"], rows)
    yield "</div>"


def _default(text: str) -> str:
    return text if text in ("required", "none", "empty", "as below", "") else f"`{text}`"


def _metrics() -> str:
    rows = [
        [
            f"`{m.name}{'_QUANTITY' if m.is_family else ''}`",
            _text(m.help),
            {"1": "", "quantity": "the quantity's"}.get(m.unit, m.unit),
            _BETTER.get(m.better, m.better),
        ]
        for m in METRICS.values()
    ]
    statistics = [[f"`{row['kind']}`", _text(row["text"])] for row in lists.rows(("statistics",))]
    return _page(
        [
            "# Metrics and statistics",
            "A metric is a number per run, or per step over the runs. What an experiment of yours has "
            "of them, and which windows of steps, says `trackbench list metrics CONFIG`. How each is "
            "defined, and by whom: [what they are](../statistics.md).",
            "## Metrics",
            "A quantity is what the scenario scores: `position`, `velocity`, or nothing where there is "
            "only one. A filter or scenario of your own may bring more.",
            _table(["metric", "what it is", "unit", "better"], rows),
            "## Statistics",
            "Over the runs, each with a standard error.",
            _table(["statistic", "what it is"], statistics),
            "## How it is written",
            f"```text\n{metrics.WRITTEN.partition(chr(10))[2]}\n```",
        ]
    )


def _commands() -> str:
    import typer

    from trackbench.cli.app import app

    codes = "Exit codes: 0 done, 1 a filter failed, 2 bad input, 130 interrupted."
    lines = ["# Commands", f"`trackbench COMMAND --help` says the same. {codes}"]
    commands = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    for name, command in sorted(commands.items()):
        context = command.make_context(name, [], resilient_parsing=True)
        usage = " ".join(command.collect_usage_pieces(context))
        records = [(p, p.get_help_record(context)) for p in command.params]
        rows = [
            [f"`{re.sub(' <[^>]*>', '', r[0])}`", _text(r[1])] for p, r in records if r and r[1]
        ]
        lines += [f"## {name}", f"```text\ntrackbench {name} {usage}\n```", _text(command.help)]
        lines += [_table(["", "what it is"], rows)] if rows else []
    return _page(lines)


def _python() -> str:
    lines = [
        "# Python",
        "`import trackbench` imports nothing heavy; the rest comes when it is first used. "
        "How it looks in a notebook: [Python and notebooks](../notebooks.md).",
    ]
    for name in trackbench.__all__:
        found = getattr(trackbench, name)
        if inspect.isclass(found):
            lines += [f"## {name}", *_class(found)]
        else:
            lines += [f"## {name} {{ #{name} }}", *_function(f"trackbench.{name}", found)]
    from trackbench.report.findings.ranking_of_settings import Best
    from trackbench.report.table import Table
    from trackbench.report.tables_and_figures import Results

    for cls in (Results, Table, Best):
        lines += [f"## {cls.__name__}", *_class(cls)]
    return _page(lines)


def options_table() -> str:
    """Fields of `trackbench.Options` as a table, which `docs/programs.md` has, too."""
    return _table(
        ["keyword", "what it is"],
        [[f"`{name}`", _text(text)] for name, text in _fields(api.Options).items()],
    )


def _function(name: str, function: Any) -> Iterator[str]:
    shown = re.sub(r"\b(?:\w+\.)+(\w+)", r"\1", str(inspect.signature(function))).replace("'", "")
    yield f"```python\n{name}{shown}\n```"
    yield from _documented(function.__doc__)


def _class(cls: type[Any]) -> Iterator[str]:
    if dataclasses.is_dataclass(cls) and cls.__doc__:
        yield from _documented(cls.__doc__)
    elif cls.__doc__:
        yield _text(_first(cls.__doc__))
    fields = [
        [f"`{name}`", _text(text)]
        for name, text in {**_fields(cls), **_members(cls)}.items()
        if not name.startswith("_")
    ]
    if fields:
        yield _table(["attribute or method", "what it is"], fields)


def _fields(cls: type[Any]) -> dict[str, str]:
    """Fields with their defaults and what is said under them."""
    found = {}
    (tree,) = ast.parse(textwrap.dedent(inspect.getsource(cls))).body
    for node, after in pairwise([*tree.body, ast.Pass()]):  # type: ignore[attr-defined]
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            said = isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant)
            text = after.value.value if said else ""  # type: ignore[attr-defined]
            default = ast.unparse(node.value) if node.value else ""
            if default not in ("", "None", "()", "''") and "default" not in text:
                text = f"{text} (default: `{default}`)".lstrip()
            found[node.target.id] = text
    return found


def _members(cls: type[Any]) -> dict[str, str]:
    """Public methods and properties that have something to say."""
    found = {}
    for name, member in inspect.getmembers(cls):
        doc = getattr(member, "__doc__", None)
        own = callable(member) or hasattr(member, "fget") or hasattr(member, "func")
        if name.startswith("_") or not own or not doc or issubclass(cls, Exception):
            continue
        if name in dir(tuple) or inspect.isclass(member):
            continue
        shown = f"{name}{_arguments(member)}" if inspect.isfunction(member) else name
        found[shown] = _first(doc)
    return found


def _arguments(function: Any) -> str:
    names = [name for name in inspect.signature(function).parameters if name != "self"]
    return f"({', '.join(names)})"


def _linked(text: str) -> str:
    """Words that name a group's listing, as a link to its page."""
    return re.sub(r"\(see `trackbench list (\w+)`\)", r"([\1](\1.md))", text)


def _documented(doc: str | None) -> Iterator[str]:
    """Write a docstring as Markdown: its paragraphs, and a list for each numpydoc section."""
    text, *sections = re.split(r"^(\w+)\n-{3,}\n", inspect.cleandoc(doc or ""), flags=re.MULTILINE)
    yield from map(_text, _paragraphs(text))
    for title, entries in zip(sections[::2], sections[1::2], strict=True):
        yield f"**{title}**"
        # A line that is not indented is a name, perhaps with its type; its description follows it.
        items = []
        for name, description in re.findall(
            r"^(\S.*)\n((?:[ \n].*\n?)*)", f"{entries}\n", re.MULTILINE
        ):
            items.append(f"- {_text(f'``{name}``')}: {_text(description)}")
        yield "\n".join(items)


def _paragraphs(doc: str | None) -> list[str]:
    return [" ".join(p.split()) for p in inspect.cleandoc(doc or "").split("\n\n")]


def _first(doc: str) -> str:
    return _paragraphs(doc)[0]


def _text(text: str) -> str:
    """What a docstring says, as Markdown: code stays code, and nothing else is markup.

    Braces are escaped because the site would read `key: {name: value}` as attributes of a cell.
    """
    parts = re.split(r"(``[^`]+``|`[^`]+`|docs/[\w/-]+\.(?:md|svg))", " ".join(text.split()))
    written = []
    for part in parts:
        if part.startswith("docs/"):
            place = part.removeprefix("docs/")
            written.append(f"[{PurePosixPath(part).stem}](../{place})")
        elif part.startswith("`"):
            written.append(f"`{part.strip('`')}`")
        else:
            escaped = re.sub(r"([*_\[\]{}|])", r"\\\1", part)
            written.append(escaped.replace("<", "&lt;"))
    return "".join(written)


def _table(heads: list[str], rows: Iterable[list[str]]) -> str:
    def line(cells: list[str]) -> str:
        # A bar within code would end the cell.
        cells = [re.sub(r"(?<!\\)\|", "&#124;", _unspoilt(cell)) for cell in cells]
        return f"| {' | '.join(cells)} |"

    return "\n".join([line(heads), line(["---"] * len(heads)), *map(line, rows)])


def _unspoilt(cell: str) -> str:
    """Code with a bar in it, as HTML, where Markdown would show the bar's name."""
    return re.sub(
        r"`([^`]*\|[^`]*)`", lambda m: f"<code>{m[1].replace('|', '&#124;')}</code>", cell
    )


def _page(parts: Iterable[str]) -> str:
    return "\n\n".join(parts) + "\n"
