"""Command `report`: write report.html of stored results, or an index over a folder of several."""

from trackbench.cli.options import AllowPlugins, Folder
from trackbench.cli.printed_outcome import print_written_files


def report(folder: Folder, allow_plugins: AllowPlugins = False) -> None:
    """Write report.html of stored results, or index.html and README.md over a folder of several."""
    from trackbench.commands import read_and_rewrite_stored_results

    print_written_files(lambda: read_and_rewrite_stored_results.report(folder, allow_plugins))
