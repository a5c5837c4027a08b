"""A codecheck.yml of results folders: what a checker has to compute again.

Format: https://codecheck.org.uk/spec/config/1.0/.
"""

import os
from collections.abc import Iterator, Sequence
from pathlib import Path

import yaml

from trackbench.report.results import Results

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
    """Return the file's content, with paths from ``root``; raises UserError for other folders."""
    results = [Results(folder) for folder in folders]
    manifest = [item for one in results for item in _items(one, root)]
    names = " ".join(os.path.relpath(folder, root) for folder in folders)
    body = yaml.safe_dump({"manifest": manifest}, sort_keys=False, allow_unicode=True, width=1000)
    return _HEAD.format(command=f"trackbench verify {names}") + body


def _items(results: Results, root: Path) -> Iterator[dict[str, str]]:
    """Yield tables and figures with their titles, then the data of the runs."""
    for group, suffix in (("tables", "csv"), ("figures", "svg")):
        for name, part in (results.config.get(group) or {}).items():
            file = results.folder / group / f"{name}.{suffix}"
            if file.is_file():
                title = results.fill_title(part.get("title") or name)
                yield {"file": os.path.relpath(file, root), "comment": title}
    for name, what in (("per_run.csv", "Metrics of every run"), ("summary.csv", "Statistics")):
        if (results.folder / name).is_file():
            yield {"file": os.path.relpath(results.folder / name, root), "comment": what}
