"""File codecheck.yml for those who check that a paper is reproducible: its head and its manifest."""

import os
from collections.abc import Iterator, Sequence
from pathlib import Path

import yaml

from trackbench.report.tables_and_figures import Results

_HEAD = """\
---
# What `{command}` computes again. Fill in the paper; the checker adds the certificate.
version: https://codecheck.org.uk/spec/config/1.0/
paper:
  title:
  authors:
    - name:
  reference:
"""


def codecheck_text(folders: Sequence[Path], root: Path) -> str:
    """Write the text of codecheck.yml about results folders, with paths relative to ``root``.

    Raises UserError if a folder has no results.
    """
    manifest: list[dict[str, str]] = []
    for results in [Results(folder) for folder in folders]:
        manifest += _outputs(results, root)
    names = " ".join(os.path.relpath(folder, root) for folder in folders)
    body = yaml.safe_dump({"manifest": manifest}, sort_keys=False, allow_unicode=True, width=1000)
    return _HEAD.format(command=f"trackbench verify {names}") + body


def _outputs(results: Results, root: Path) -> Iterator[dict[str, str]]:
    """Yield an entry of codecheck.yml for each table and figure, then for the data of the runs.

    An entry has the file, relative to ``root``, and a comment, which is the title. Files that are
    missing are left out.
    """
    for group, suffix in (("tables", "csv"), ("figures", "svg")):
        entries = results.config.get(group) or {}
        for name, entry in entries.items():
            file = results.folder / group / f"{name}.{suffix}"
            if file.is_file():
                title = results.fill_title(entry.get("title") or name)
                yield {"file": os.path.relpath(file, root), "comment": title}
    runs_file = results.per_run_file
    for name, comment in ((runs_file, "Metrics of every run"), ("summary.csv", "Statistics")):
        file = results.folder / name
        if file.is_file():
            yield {"file": os.path.relpath(file, root), "comment": comment}
