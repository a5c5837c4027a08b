"""File manifest.json of a results folder: facts of the run, and digests of the files."""

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from trackbench.atomic_files import ensure_folder, write_text
from trackbench.errors import UserError, WriteError
from trackbench.results.file_names import FORMAT, MACHINE, MANIFEST, is_of_one_run
from trackbench.results.links import within
from trackbench.results.missing_and_changed_files import digest_of
from trackbench.unsafe_characters import printable_json

_FACTS_OF_RESULTS = (
    "experiment",
    "seed",
    "runs",
    "steps",
    "loops_over_runs",
    "deterministic",
    "training_holds_out",
    "training_failures",
    "plugins",
    "data_notes",
    "failed",
    "format",
)
"""Facts in the manifest; ``run/machine.json`` has all others."""


def read_manifest(folder: Path) -> dict[str, Any]:
    """Read the facts and digests of both manifests, of which `MACHINE` may be missing.

    The digests of all files, by name, are under the key ``files``.
    """
    facts: dict[str, Any] = {}
    files: dict[str, str] = {}
    for name in (MACHINE, MANIFEST):
        if name == MANIFEST or (folder / name).is_file():
            content = printable_json((folder / name).read_text(encoding="utf-8"))
            facts = {**facts, **content}
            files = {**files, **content["files"]}
            facts["files"] = files
    return facts


def write_manifest(
    folder: Path, facts: Mapping[str, Any], written: Iterable[Path]
) -> dict[str, str]:
    """Write both manifests after all other files, with new digests of the files in ``written``.

    ``manifest.json`` has what every machine computes again, ``run/machine.json`` what belongs to this
    run alone, such as versions and times. ``facts`` are those of both. The digests of other files are
    those of ``facts["files"]``. Return all digests by the files' names.
    """
    digests = dict(facts.get("files", {}))
    for path in written:
        name = path.relative_to(folder).as_posix()
        digests.pop(name, None)  # stays so if the file was removed
        if path.is_file() and name not in (MACHINE, MANIFEST):
            try:
                digests[name] = digest_of(path)
            except OSError as error:
                raise WriteError.from_os_error(path, error) from error
    # Each fact and each file stands in one of both manifests.
    run_manifest: dict[str, Any] = {}
    results_manifest: dict[str, Any] = {}
    for key, value in {**facts, "format": FORMAT}.items():
        manifest = results_manifest if key in _FACTS_OF_RESULTS else run_manifest
        manifest[key] = value
    run_manifest["files"] = {}
    results_manifest["files"] = {}
    for name, digest in sorted(digests.items()):
        manifest = run_manifest if is_of_one_run(name) else results_manifest
        manifest["files"][name] = digest
    ensure_folder(within(folder, "run"))
    write_text(folder / MACHINE, json.dumps(run_manifest, indent=2) + "\n")
    write_text(folder / MANIFEST, json.dumps(results_manifest, indent=2) + "\n")
    return digests


def reject_newer_format(folder: Path, version: int, manifest: Mapping[str, Any]) -> None:
    """Raise UserError if the manifest has a newer ``version`` of the format than this program reads."""
    if version > FORMAT:
        newer = manifest.get("trackbench", "of a newer version")
        message = f"was written by trackbench {newer} in format {version}"
        raise UserError(
            f"{folder}: {message}, this version reads up to {FORMAT}: update trackbench"
        )


def steps_of_point(manifest: Mapping[str, Any], i: int) -> int | None:
    """Return the number of steps of a run at the grid point of number i; None if it is not there."""
    number = manifest.get("steps")
    # A list has the numbers of all points, where they differ.
    if isinstance(number, list) and i < len(number):
        number = number[i]
    if not isinstance(number, int) or number < 1:
        return None
    return number
