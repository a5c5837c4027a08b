"""Page index.html of a folder of experiments, which is written together with its README.md."""

from pathlib import Path
from typing import Any

from trackbench.errors import UserError
from trackbench.report.html.page_templates import write_page
from trackbench.report.html.stored_pictures import key_picture
from trackbench.report.html.thumbnail import thumbnail
from trackbench.report.overview.experiment_topics import group_by_topic
from trackbench.report.overview.open_experiments import Overview, open_experiments, relative_link
from trackbench.report.overview.readme_of_verdicts import write_readme
from trackbench.report.overview.result_on_card import result_in_words
from trackbench.report.tables_and_figures import Results
from trackbench.report.verdicts.all_verdicts import Verdicts
from trackbench.report.verdicts.cpu_time_verdicts import TimeVerdict, time_verdicts
from trackbench.report.verdicts.verdict_counts import bars, join_verdicts, summary_lines
from trackbench.report.verdicts.verdict_tables import time_tables, verdict_tables


def write_overview(folder: Path) -> list[Path]:
    """Write index.html and README.md about the results folders in ``folder``; return what was written.

    If folders lack the runs that their verdicts need, as in a git clone, index.html leaves them out and
    README.md stays.
    """
    experiments, left_out = open_experiments(folder)
    everything = join_verdicts([comparison for _, comparison in experiments])
    index = _write_index(folder, experiments, everything)
    return [index, *write_readme(folder, experiments, everything, left_out)]


def _write_index(folder: Path, experiments: Overview, everything: Verdicts) -> Path:
    """Write index.html and return its path; ``everything`` has the verdicts of all experiments."""
    # The verdicts on CPU times of all experiments are counted separately.
    times: list[TimeVerdict] = []
    for results, _ in experiments:
        times += time_verdicts(results)
    cards = {}
    for topic, group in group_by_topic(experiments).items():
        cards[topic] = [_card(folder, results, comparison) for results, comparison in group]
    return write_page(
        folder / "index.html",
        template="index.html",
        live=False,  # without the script of interactive figures
        title="Experiments and what they say of the papers",
        topics=cards,
        counted=bars(everything),
        verdict_lines=summary_lines(everything),
        ledger=[*verdict_tables(everything), *time_tables(times)],
    )


def _card(folder: Path, results: Results, comparison: Verdicts) -> dict[str, Any]:
    """Return what the index shows of an experiment: values for the template index.html, by name.

    The thumbnail is empty if there is no picture of it, and the link if it has no report. The link is
    relative to ``folder``, which the index is for. Under ``counted`` are bars: how many verdicts on
    published numbers and claims are of each word.
    """
    from markupsafe import Markup

    config = results.config
    report = results.folder / "report.html"
    picture = _picture(results)
    return {
        "name": config["name"],
        "title": results.fill_title(config["title"]),
        "filters": len(results.filters),
        "runs": config["runs"],
        "result": result_in_words(results),
        "counted": bars(comparison),
        "thumbnail": Markup(thumbnail(picture)) if picture else "",
        "link": relative_link(report.relative_to(folder)) if report.is_file() else "",
    }


def _picture(results: Results) -> bytes | None:
    """Return the SVG of the key figure.

    None if the experiment has no figure, or if the figure is missing and cannot be drawn, because the
    folder lacks the data of the runs, as in a git clone.
    """
    try:
        return key_picture(results)
    except UserError:
        if results.has_runs:
            raise
        return None
