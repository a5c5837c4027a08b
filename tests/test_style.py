"""Measure the words: docstrings begin with a verb, sentences of the docs state what is the case."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parent.parent
PACKAGE = sorted((HERE / "trackbench").rglob("*.py"))
DOCS = sorted(p for p in (HERE / "docs").rglob("*.md"))
BANNED = ("What", "Whether", "Of", "Where", "That", "How", "The same", "All of", "None")
VERBS = """
    accept accumulate add adopt advance align allocate allow answer append apply approximate
    arrange ask assemble assert assign attach average begin bind block bound bring broadcast
    build cache calculate call cancel carry cast catch change check choose clamp classify clean
    clear clip close collapse collect color combine compare complete compose compress compute
    concatenate condition connect construct continue convert copy correct count create cross
    cut decide declare decode decompose define delete derive describe detect determine
    differentiate digest discard display distribute divide draw drop dump embed empty encode
    end enforce ensure enter enumerate escape estimate evaluate evolve examine exclude execute
    exit expand explain expose express extend extract factor fail fill filter find finish fit
    flag flatten flush fold follow forecast forget fork form format forward freeze gather
    generate get give group guess halve handle hide highlight hold identify ignore import
    include increase infer inflate initialize inline insert inspect install integrate
    interpolate interpret invert iterate join judge keep kill label lay leave let limit
    linearize link list load locate lock look lower make map mark mask match maximize measure
    merge minimize mirror move multiply mutate name normalize note notify number observe omit
    open optimize order overlay pack pad paint pair parse part pass pause perform perturb pick
    plan plot point pool predict prefix prepare print probe process produce project prompt
    propagate propose prove provide prune publish pull push put quantize query quote raise
    randomize rank read rebase rebuild receive recompute reconstruct record redirect reduce
    refer refine refuse register regroup reject release reload remember remove rename render
    repair repeat replace report represent request require resample rescale reserve reset
    reshape resolve restart restore restrict resume return reuse reverse rewrite rotate round
    run sample save scale scan score search select send separate serialize set shade shape
    share shift shorten show shrink shuffle shut simulate skip smooth solve sort sow specify
    split spread stack standardize start step stop store stream stretch strip study submit
    subtract sum summarize supply suppress swap switch take tear tell terminate test tie time
    trace track train transform translate transpose traverse treat trim truncate try tune turn
    undo unite unlock unpack unregister unwrap update use validate verify visit wait walk warm
    warn watch weigh whiten widen wrap write yield
"""
NEGATION = re.compile(
    r"\b(not|no|none|never|nothing|nobody|nor|neither|cannot|without|\w+n't)\b", re.IGNORECASE
)


def docstrings(functions: bool) -> Iterator[tuple[str, str]]:
    """Yield place and first line of each docstring, of functions or of modules and classes."""
    kinds = (ast.FunctionDef,) if functions else (ast.Module, ast.ClassDef)
    for path in PACKAGE:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, kinds) and (text := ast.get_docstring(node)):
                yield f"{path.relative_to(HERE)}:{getattr(node, 'lineno', 1)}", text.split("\n")[0]


def begins_with_verb(line: str) -> bool:
    return re.split(r"\W", line, maxsplit=1)[0].lower() in VERBS.split()


def sentences(path: Path) -> Iterator[str]:
    """Yield the sentences of a page, without code, tables, headings and the targets of links."""
    text = re.sub(r"```.*?```|<!--.*?-->", "", path.read_text(encoding="utf-8"), flags=re.DOTALL)
    text = re.sub(r"^(#.*|\|.*|    .*)$", "\n", text, flags=re.MULTILINE)
    text = re.sub(r"!?\[([^\]]*)\]\((?:[^()]|\([^()]*\))*\)", r"\1", text)
    for paragraph in re.split(r"\n\s*\n|\n(?=\s*(?:[-*]|\d+\.) )", text):
        words = re.sub(r"^\s*(?:[-*>]|\d+\.)\s+", "", " ".join(paragraph.split()))
        yield from (
            s for s in re.split(r"(?<=[.!?:;])\s+(?=[A-Z`*\[\"(])", words) if len(s.split()) > 2
        )


def share(hits: int, total: int) -> float:
    return 100 * hits / max(total, 1)


def test_functions_say_what_they_do() -> None:
    lines = list(docstrings(functions=True))
    assert share(sum(begins_with_verb(line) for _, line in lines), len(lines)) >= 75


@pytest.mark.parametrize("functions", [True, False])
def test_first_lines_name_their_subject(functions: bool) -> None:
    assert [
        f"{at}: {line}"
        for at, line in docstrings(functions)
        if re.match(rf"({'|'.join(BANNED)})\b", line)
    ] == []


def test_docs_say_what_is() -> None:
    """Sentences with a negation are at most 15 %, openings by What, Of, Where or That 1 %."""
    every = [s for path in DOCS for s in sentences(path)]
    assert share(sum(bool(NEGATION.search(s)) for s in every), len(every)) <= 15
    assert (
        share(sum(s.split()[0] in ("What", "Of", "Where", "That") for s in every), len(every)) <= 1
    )


def test_modules_and_functions_have_a_readable_size() -> None:
    long = []
    for path in PACKAGE:
        text = path.read_text(encoding="utf-8")
        if len(text.splitlines()) > 400:
            long.append(str(path))
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef) and (node.end_lineno or 0) - node.lineno >= 60:
                long.append(f"{path}:{node.lineno} {getattr(node, 'name', '')}")
    assert long == []
