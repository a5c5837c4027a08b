"""Checks of names of metrics: unknown ones and impossible ones, with what to write or to add."""

import re
from collections.abc import Collection, Sequence
from difflib import SequenceMatcher
from pathlib import Path

from trackbench.config.available_metrics import Names, names_of
from trackbench.config.did_you_mean import nearest, unknown
from trackbench.config.experiment import Exhibit, Point
from trackbench.config.experiment_keys import Settings
from trackbench.config.published_numbers_and_claims import Published
from trackbench.config.requested_metrics import (
    MetricRequest,
    requests_of,
    requests_of_settings,
    role_and_name,
)
from trackbench.config.requested_truth import (
    SERIES_OF_ERRORS,
    RequestedTruth,
    needs_truth,
    shows_default_errors,
)
from trackbench.config.stored_metrics import why_not_stored
from trackbench.errors import Mark, Problem
from trackbench.evaluation.metric_expression import Measure, measured
from trackbench.filters.base import AnyFilter
from trackbench.metrics import is_of_prediction
from trackbench.models.component_names import has_position_and_velocity
from trackbench.registry import Group
from trackbench.yaml_source import Source, dotted

_ERROR_SERIES = (*SERIES_OF_ERRORS, "rmsd")
"""Series that only a scenario with a truth has.

The RMSD is one of them. It compares estimates with those of the reference, and needs no truth at a step.
"""
_ADDED_BY_ERRORS = ("squared", "error")
"""Series of an error that the key `errors` of a scenario's `score` adds."""
_MOST_RELATIVES = 6
"""Known metrics of one name or quantity that a message lists."""
_USUAL_ERRORS = ("rmse", "bias", "crps", "mae", "std", "mse")
"""Metrics of one quantity, the most used first."""
_AFTER = "after "
"""Beginning of the window after a fault."""
_TYPO = 0.9
"""Likeness from which on a word is taken for another one with a slip."""
_ADDED_BY = {
    "settling_s": "`settled_error` of a target `legs`",
    "not_settled": "`settled_error` of a target `legs`",
    "damage": "`faults` of the scenario",
    "recovery_s": "`faults` of the scenario",
    "not_recovered": "`faults` of the scenario",
    "arrived_late": "`delay` of a sensor",
    "late_dropped": "`delay` of a sensor",
    "held_log_score": "`hold_out`",
}
"""Keys that add metrics, by metric."""
_GATE = "a filter with a `gate`, such as `gate: 0.999`"
_LEGS = "a target `legs` and a filter with a maneuvering mode, such as `imm`"
_PATH = "a target with positions, such as `legs` or `waypoints`, or a recording with their truth"
_PARTICLES = "a particle filter, such as `pf`"
_ALARMS = "a filter that decides on maneuvers, `adaptive-kf` or `input-estimation`"
_MEASURED_WITH = {
    "gated": _GATE,
    "rejected_good": f"`faults` of the scenario and {_GATE}",
    "accepted_bad": f"`faults` of the scenario and {_GATE}",
    "measurement_weight": "a filter with the key `robust`, such as `robust: {kind: huber}`",
    "nis": "a filter with innovations, such as `kf` or `ekf`",
    "log_score": "a filter that computes the likelihood of measurements",
    "mode": "a filter with several modes, such as `imm`",
    "alarm": _ALARMS,
    "alarm_age_s": _ALARMS,
    "zeta": "`adaptive-kf` with `onset_rule: argmax` of its `detector`",
    "zeta_beyond": "`adaptive-kf` with `onset_rule: argmax` of its `detector`",
    "collapsed_steps": _PARTICLES,
    "ess": _PARTICLES,
    "distinct_particles": _PARTICLES,
    "acceptance_rate": "`hdepf`",
    "spread_ratio": "`hdepf`",
    "detection_delay_s": _LEGS,
    "missed_maneuvers": _LEGS,
    "already_maneuvering": _LEGS,
    "onset_error_s": _LEGS,
    "onset_abs_error_s": _LEGS,
    "onset_age_s": _LEGS,
    "false_maneuvers_per_1000": _LEGS,
    "overshoot_m": "a target `legs` that turns",
    "peak": _PATH,
    "beyond_10_sigma": _PATH,
    "rmsd": "the key `reference`, which names the filter to compare with",
}
"""Filters and parts of the scenario that have metrics, by metric."""


def check_metrics(
    source: Source,
    settings: Settings,
    points: list[Point],
    exhibits: dict[Group, dict[str, Exhibit]],
    left_out: dict[str, AnyFilter],
    published: Published,
    folder: Path,
) -> None:
    """Check that every metric named by tables, figures and settings exists and is stored.

    Metrics of the ``published`` rows must exist, too. They need not be stored. ``folder``
    is that of the config.

    ``points`` are all, or none if any has mistakes: the metrics are unknown then. Metrics of filters
    that are ``left_out`` of the run may be named. Diagnostics of filters with mistakes or errors are
    unknown. A request is ``named`` if a key of the config names its metric; a kind of table or figure
    requests others that it always shows.
    """
    requests = [*requests_of_settings(settings), *requests_of(exhibits)]
    if not points:
        return
    # An option such as `--set scenario.last=50` may take away steps and windows that the files of the
    # experiment name rightly. Then published rows are not measured, and columns of tables are empty. The
    # config in a results folder has the values of such options.
    is_results_folder = (folder / "manifest.json").is_file()
    is_as_written = not is_results_folder and not _has_options(source)
    of_published = []
    if is_as_written:
        for measure, mark, column in published.marked_expressions:
            request = MetricRequest((column,), measure, role="expression")
            of_published.append((request, mark))
    # Diagnostics may take a step of each filter: they are listed only if they are needed.
    names = names_of(settings, points, left_out, with_diagnostics=False)
    all_requests = [*requests, *(request for request, _ in of_published)]
    if any(not request.named or why_unknown(request, names, settings) for request in all_requests):
        names = names_of(settings, points, left_out, with_diagnostics=True)
    truth = RequestedTruth([point.scenario for point in points])
    requests_truth = shows_default_errors(settings, points)
    for request in requests:
        message = why_unknown(request, names, settings) or why_not_stored(request, names, settings)
        if message is None and truth.why_missing:
            # This is one mistake of the experiment, and no mistake of each metric.
            requests_truth = requests_truth or needs_truth(request.measure)
        elif message is None and request.named:
            message = truth.why_unmeasured(request.measure)
        if message is None and request.named and is_as_written:
            message = _why_no_step(request.measure, points)
        if message is not None:
            source.add_problem(request.keys, message)
    for request, mark in of_published:
        message = why_unknown(request, names, settings) or _why_no_step(request.measure, points)
        if message is not None:
            source.problems.append(Problem(mark, dotted(request.keys), message))
    if truth.why_missing and requests_truth:
        truth.add_problem(source)


def _has_options(source: Source) -> bool:
    """Test whether options of the command line change keys that decide on metrics, steps or windows."""
    return any(
        _has_mark_of_option(source.mark((key,)), source.data.get(key))
        for key in ("scenario", "filters", "grid", "metrics", "per_step", "medians", "reference")
    )


def _has_mark_of_option(mark: Mark, value: object) -> bool:
    """Test whether a value, whose position is ``mark``, or a value within it comes from an option."""
    if mark.file.startswith("--"):
        return True
    marks = getattr(value, "marks", {})
    if isinstance(value, dict):
        return any(_has_mark_of_option(marks.get(key, mark), item) for key, item in value.items())
    if isinstance(value, list):
        return any(_has_mark_of_option(marks.get(i, mark), item) for i, item in enumerate(value))
    return False


def _why_no_step(measure: Measure, points: Sequence[Point]) -> str | None:
    """Explain that a run ends before the first step that an expression names; None if it does not."""
    if measure.steps is None or not measure.steps.first.isdigit():
        return None
    # The steps may differ between points of the grid.
    last = max(int(point.scenario.steps[-1]) for point in points)
    if int(measure.steps.first) <= last:
        return None
    return f"'{measure}': the last step of a run is {last}"


def _nearest_metric(word: str, known: Collection[str], bases: Sequence[str]) -> str:
    """Return the known metric that was probably meant by ``word``; empty if none is near.

    ``bases`` are the known metrics without statistic. A statistic is added if only the metric with it is
    known at the place.
    """
    lower = word.lower()
    base = nearest(word, bases) if word.isidentifier() else ""  # an expression, rms(x), is no base
    # A word that is the beginning or a part of a metric's name, as `position` of `rmse_position`, gets a
    # statistic if the metric is known only with one. A misspelled name is compared with those below.
    if base.startswith(lower) or lower in base.split("_"):
        for expression in (base, f"rms({base})", f"mean({base})"):
            if expression in known:
                return expression
    return nearest(word, sorted(known))


def _related_metrics(measure: Measure, known: Collection[str]) -> list[str]:
    """Return the known metrics that have the name or the quantity of ``measure``, 6 at most.

    Those of its name come first, the nearest first. Each has the statistic with which it is known. They
    also have the relation of ``measure``: the comparison with another filter, such as gain or ratio, or
    "" without one. ``base`` is the name of the stored metric, without statistic, window and step.
    """
    of_name: dict[str, str] = {}
    of_quantity: dict[str, str] = {}
    for name in sorted(known, key=lambda name: (len(name), name)):
        other = measured(name)
        if other.relation != measure.relation:
            continue
        # Errors of predictions are related only to a metric of predictions, whose name may be
        # misspelled: it need not begin with this word.
        if other.quantity.startswith("predicted") and "predicted" not in measure.quantity:
            continue
        if other.definition.name == measure.definition.name:
            of_name.setdefault(other.base, name)
        elif other.quantity == measure.quantity and other.definition.name in _USUAL_ERRORS:
            of_quantity.setdefault(other.base, name)
    by_likeness = sorted(of_name, key=lambda base: (-_likeness(measure.base, base), base))
    by_use = sorted(
        of_quantity, key=lambda base: _USUAL_ERRORS.index(measured(base).definition.name)
    )
    related = [of_name[base] for base in by_likeness] + [of_quantity[base] for base in by_use]
    return related[:_MOST_RELATIVES]


def _likeness(word: str, other: str) -> float:
    """Return how alike two words are, from 0 to 1."""
    return SequenceMatcher(None, word, other).ratio()


def why_unknown(request: MetricRequest, names: Names, settings: Settings) -> str | None:
    """Explain why a requested metric cannot exist or is unknown; None if it may exist.

    An unknown metric that no key of the config names, as one that a plugin requires, is no mistake.
    """
    role, word = role_and_name(request, settings)
    known = names.names_of_role(role)
    measure = request.measure
    why_impossible = _why_impossible(measure, role, word, names, settings)
    if why_impossible is not None:
        return why_impossible
    if word in known or not request.named or names.could_be_diagnostic(measure.metric):
        return None
    return _explain_unknown(measure, word, known, names)


def _why_impossible(
    measure: Measure, role: str, word: str, names: Names, settings: Settings
) -> str | None:
    """Explain why a metric cannot exist in this experiment; None if nothing rules it out.

    ``role`` and ``word`` are the metric's role and its name there, from `role_and_name`.
    """
    metric = measure.definition
    if role == "efficiency" and settings.reference is None:
        return f"{word!r} compares with the reference filter; name one under `reference`"
    if measure.relation in ("gain", "ratio") and metric.is_score:
        message = "a log score is a logarithm, and ratios of it mean nothing; take minus(...)"
        return f"'{measure}': {message}"
    known = names.names_of_role(role)
    is_of_error = metric.series in _ERROR_SERIES and not is_of_prediction(measure.quantity)
    lacks_truth = not names.has_truth and (is_of_error or needs_truth(measure))
    if word not in known and lacks_truth:
        # Of many similar metrics, only a few are suggested: autocorrelation_1, and not those at 2 to 10.
        rarely_useful = re.compile(r"(bias|std)_.*|lost|autocorrelation_(?!1$).*")
        bases = {measured(name).base for name in known}
        suggested = sorted(name for name in bases if not rarely_useful.fullmatch(name))
        hint = unknown("", suggested)
        return f"{word!r} needs ground truth, and the recording has none; {hint}"
    if measure.metric == "likelihood_ratio" and settings.reference is None:
        return "likelihood_ratio is relative to an exact filter; name one under `reference`"
    if measure.metric == "likelihood_ratio" and names.has_delays:
        return (
            "likelihood_ratio needs equal measurements for both filters, and here some arrive late"
        )
    return None


def _explain_unknown(measure: Measure, word: str, known: Collection[str], names: Names) -> str:
    """Explain that a metric does not exist, and what to write or to add to the config.

    ``word`` is its name in its role, and ``known`` are the metrics that exist in this role. The role is
    how the config uses the metric: as one of a results file, for example.
    """
    metric = measure.definition
    quantity = measure.quantity
    no_metric = f"{word!r} is no metric here"
    # Step 1: the right name of a metric that this experiment lacks, with what adds it.
    fault = _fault_without_steps_after(measure, known)
    if fault:
        return (
            f"{no_metric}: no scored step after the fault {fault} and before the next one is "
            "without a fault"
        )
    known_bases = sorted({measured(name).base for name in known})
    score_key = ""
    if measure.base not in known_bases:  # else the metric exists in another window
        score_key = _score_key_that_adds(measure, names.components)
    if score_key:
        return f"{no_metric}; `{score_key}` of the scenario adds it"
    has_metric = any(measured(name).definition is metric for name in known)
    if metric.name in _ADDED_BY and not has_metric:
        return f"{no_metric}; the key {_ADDED_BY[metric.name]} adds it"
    # These metrics have no quantity, or (`peak_position`) that of the position. With another quantity
    # the name is wrong, whatever the experiment has.
    needs_other_parts = metric.name in _MEASURED_WITH and quantity in ("", "position")
    if needs_other_parts and not has_metric:
        needed = _MEASURED_WITH[metric.name]
        return f"{no_metric}: it needs {needed}; add this, or leave the metric out"
    # Step 2: a metric of each run, of which the table needs a number over the runs.
    over_runs = [name for name in known if name.endswith(f"({word})")]
    if over_runs:
        return f"{word!r} is a number of each run; name a statistic: {', '.join(sorted(over_runs))}"
    # Step 3: other names, with the nearest metric that exists.
    near = _nearest_metric(word, known, known_bases)
    near_base = measured(near).base if near else ""
    is_slip = near_base.startswith(measure.base) or _likeness(measure.base, near_base) >= _TYPO
    if quantity and not is_slip:
        # The name of the metric is right, and it has no such quantity here.
        related = _related_metrics(measure, known)
        if related:
            names_of_related = ", ".join(related)
            return f"{no_metric}; of its name or quantity are known: {names_of_related}"
        near = ""
    hint = f"did you mean {near}?" if near else unknown("", known_bases)
    return f"{no_metric}; {hint}"


def _score_key_that_adds(measure: Measure, components: tuple[str, ...]) -> str:
    """Return the key `score` of the scenario that adds a metric, as YAML; empty if none does.

    ``components`` are those of the state.
    """
    metric = measure.definition
    quantity = measure.quantity
    if metric.series in _ADDED_BY_ERRORS:
        for x, y in (("px", "py"), ("x", "y")):
            if quantity == "position" and x in components and y in components:
                return f"score: {{errors: {{position: [{x}, {y}]}}}}"
        if quantity in components:
            return f"score: {{errors: {{{quantity}: [{quantity}]}}}}"
    # The NEES of a part of the state is that of its marginal.
    is_marginal = metric.name in ("nees", "anees") and quantity in ("position", "velocity")
    if is_marginal and has_position_and_velocity(components):
        return f"score: {{marginals: [{quantity}]}}"
    return ""


def _fault_without_steps_after(measure: Measure, known: Collection[str]) -> str:
    """Return the fault that the window of a metric comes after, if that window has no steps.

    The result is the name of the fault. It is empty if the metric is unknown for another reason.
    ``known`` are the metrics that exist. Those in the window of the fault itself are among them.
    """
    # The window of a recovery is the fault itself; other metrics have the window `_AFTER` and its name.
    is_recovery = measure.definition.name in ("recovery_s", "not_recovered")
    if not is_recovery and not measure.window.startswith(_AFTER):
        return ""
    fault = measure.window.removeprefix(_AFTER)
    windows = {measured(name).window for name in known}
    has_base = is_recovery or any(measured(name).base == measure.base for name in known)
    # If both the fault and the metric in other windows are known, the window after the fault is missing.
    return fault if fault and fault in windows and has_base else ""
