"""Labels of filters in a config: those to run, and those that other keys, tables and figures name."""

from collections.abc import Iterator

from trackbench.component_parts import field_values
from trackbench.config.experiment import Exhibit, Labeled, labels_to_run
from trackbench.config.experiment_keys import Settings
from trackbench.config.key_mistakes import unknown
from trackbench.config.requested_metrics import why_not_controlled
from trackbench.evaluation.metric_expression import Measure, exact_label
from trackbench.registry import Group
from trackbench.yaml_source import Keys, Source


def chosen_labels(source: Source, settings: Settings) -> list[str]:
    """Return the labels of the filters to run.

    A label in `only`, `smoothed`, `exact` or `reference` that no filter has is a mistake, which is added
    to the source, and so is a bound or an exact error under the label of a filter.
    """
    known = list(settings.filters)
    if not known:
        source.add_problem(("filters",), "name at least one filter")
    for i, label in enumerate(settings.only):
        if label not in known:
            add_label_problem(source, settings, ("only", i), label)
    if settings.bound in known:
        source.add_problem(("bound",), f"{settings.bound!r} is already the label of a filter")
    for i, label in enumerate(settings.smoothed):
        if label not in known:
            add_label_problem(source, settings, ("smoothed", i), label)
    for i, label in enumerate(settings.exact):
        if label not in known:
            add_label_problem(source, settings, ("exact", i), label)
        if exact_label(label) in (*known, settings.bound):
            source.add_problem(("exact", i), f"{exact_label(label)!r} is already a label")
    if settings.reference is not None and settings.reference not in known:
        add_label_problem(source, settings, ("reference",), settings.reference)
    return labels_to_run(known, settings.only, settings.reference)


def check_problem(source: Source, settings: Settings) -> None:
    """Check that a standard problem's reference is a filter or the bound."""
    if settings.problem is None:
        return
    label = settings.problem.reference
    if label is not None and label not in (*settings.filters, settings.bound):
        add_label_problem(source, settings, ("problem", "reference"), label)


def check_named_filters(
    source: Source, settings: Settings, group: Group, exhibits: dict[str, Exhibit]
) -> None:
    """Check that tables and figures name existing filters only.

    Labels stand under the key `filters`, under the keys in ``label_keys``, and in measures such as
    ``ratio(rmse, PF)``.
    """
    known_labels = [*settings.filters, settings.bound]
    known_labels += [exact_label(label) for label in settings.exact]
    first_tuned = next(iter(settings.tune), "")
    for name, exhibit in exhibits.items():
        named_labels: list[tuple[Keys, str]] = []
        # Step 1: labels under `filters` and under the declared keys.
        for key in ("filters", *exhibit.label_keys):
            for where, leaf in _walk_leaves(getattr(exhibit, key), (group, name, key)):
                if isinstance(leaf, str):
                    named_labels.append((where, leaf))
        # Step 2: labels in measures that compare with another filter.
        for key, value in field_values(exhibit).items():
            for where, leaf in _walk_leaves(value, (group, name, key)):
                if not isinstance(leaf, Measure) or not leaf.other:
                    continue
                named_labels.append((where, leaf.other))
                message = why_not_controlled(leaf, settings.exact)
                if message:
                    source.add_problem(where, message)
        # Step 3: the filter whose tuning is shown.
        shown_filter = getattr(exhibit, "filter", first_tuned)
        if exhibit.kind == "tuning" and shown_filter not in settings.tune:
            message = f"{shown_filter!r} is not tuned" if shown_filter else "no filter is tuned"
            source.add_problem((group, name), f"{message}; name its keys under `tune`")
        for where, label in named_labels:
            if label not in known_labels:
                add_label_problem(source, settings, where, label)


def _walk_leaves(value: object, where: Keys) -> Iterator[tuple[Keys, object]]:
    """Yield every label and measure in the ``value`` of a key, each with the keys that lead to it.

    ``where`` are the keys that lead to the value.
    """
    inner: dict[str | int, object] = {}
    if isinstance(value, dict):
        inner = value
    elif isinstance(value, tuple) and not isinstance(value, Measure):  # a Measure is a tuple, too
        inner = dict(enumerate(value))
    elif isinstance(value, Labeled):
        inner = {key: getattr(value, key) for key in value.label_keys}
    else:
        yield where, value
    for key, part in inner.items():
        yield from _walk_leaves(part, (*where, key))


def add_label_problem(source: Source, settings: Settings, where: Keys, label: str) -> None:
    """Add the problem of a label that no filter has."""
    hint = unknown(label, list(settings.filters))
    parts = [part.strip() for part in label.split(",")]
    if len(parts) > 1 and all(part in settings.filters for part in parts):
        hint = "write several as a list, [A, B], or as several options: --only A --only B"
    source.add_problem(where, f"{label!r} is not a filter here; {hint}")
