"""README.md of a folder of experiments: all verdicts on published numbers and claims, by topic."""

import sys
from pathlib import Path

from trackbench.atomic_files import write_text
from trackbench.report.markdown_table import markdown_text
from trackbench.report.overview.experiment_topics import group_by_topic
from trackbench.report.overview.open_experiments import Overview, relative_link
from trackbench.report.overview.result_on_card import result_in_words
from trackbench.report.verdicts.all_verdicts import Verdicts
from trackbench.report.verdicts.verdict_counts import summary_lines
from trackbench.report.verdicts.verdict_tables import verdict_tables

_HEAD = """# Published and measured

Every number, word and claim of the papers that an experiment here measures, with its verdict. Of a
number only `agrees` says that it reproduces; `compatible` is an error too wide to show it. Written by
`trackbench report results`; `make check-results` fails if a verdict is not reproduced.
"""


def write_readme(
    folder: Path, experiments: Overview, everything: Verdicts, left_out: int
) -> list[Path]:
    """Write README.md into ``folder``; return a list of its path.

    ``everything`` has the verdicts of all ``experiments``. ``left_out`` is the number of further
    experiments in the folder that could not be opened because their runs are missing, as in a git clone.
    If there are any, the file stays as it is, and the list is empty.
    """
    path = folder / "README.md"
    if left_out:
        missing = f"per_run.csv is missing in {left_out} of {left_out + len(experiments)} folders"
        print(f"note: {path} is not written again: {missing}", file=sys.stderr)
        return []
    write_text(path, readme_text(folder, experiments, everything))
    return [path]


def readme_text(folder: Path, experiments: Overview, everything: Verdicts) -> str:
    """Return the text of README.md: the counts, then each experiment with its verdicts, by topic.

    README.md is for ``folder``, to which links are relative. ``everything`` has the verdicts of all
    experiments.
    """
    counts = "\n".join(f"- {line}" for line in summary_lines(everything))
    paragraphs = [_HEAD.rstrip(), counts or "Nothing is published about these experiments."]
    for topic, group in group_by_topic(experiments).items():
        paragraphs.append(f"## {topic}")
        for results, comparison in group:
            link = relative_link(results.folder.relative_to(folder))
            title = markdown_text(results.title)
            paragraphs.append(f"### [{results.config['name']}]({link}/): {title}")
            result = result_in_words(results)
            if result:
                paragraphs.append(f"- Result: {result}")
            paragraphs += [f"- {line}" for line in summary_lines(comparison)]
            paragraphs += [table.markdown().rstrip() for table in verdict_tables(comparison)]
    return "\n\n".join(paragraphs) + "\n"
