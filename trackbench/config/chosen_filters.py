"""Filters that are run: those of `only` and the reference, or all; labels that no filter has."""

from collections.abc import Collection, Iterable, Sequence

from trackbench.config.bound_and_exact_errors import exact_label
from trackbench.config.did_you_mean import unknown
from trackbench.config.experiment_keys import Settings
from trackbench.config.overrides import override
from trackbench.config.tuning import tuned_label
from trackbench.errors import Mark, Problem, UserError
from trackbench.unsafe_characters import unprintable_reason
from trackbench.yaml_source import Keys, Source, put


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


def labels_to_run(
    filters: Iterable[str], only: Collection[str], reference: str | None
) -> list[str]:
    """Select all filters in their order, or those of ``only`` and the reference."""
    return [label for label in filters if not only or label in only or label == reference]


def set_only(source: Source, labels: Sequence[str]) -> None:
    """Override the labels of the filters to run; each keeps its own option as its position."""
    for label in labels:
        message = unprintable_reason(label)
        if message:
            raise UserError(Problem(Mark(f"--only {label}"), "", message))
    if labels:
        override(source, ("only",), list(labels), Mark(f"--only {labels[0]}"))
    for i, label in enumerate(labels):
        override(source, ("only", i), label, Mark(f"--only {label}"))


def add_label_problem(source: Source, settings: Settings, where: Keys, label: str) -> None:
    """Add the problem of a label that no filter has."""
    hint = unknown(label, list(settings.filters))
    parts = [part.strip() for part in label.split(",")]
    if len(parts) > 1 and all(part in settings.filters for part in parts):
        hint = "write several as a list, [A, B], or as several options: --only A --only B"
    source.add_problem(where, f"{label!r} is not a filter here; {hint}")


def add_tuned_to_only(source: Source, labels: list[str]) -> None:
    """Add the tuned filters of ``labels`` to the key `only` where it lists their originals."""
    only = source.data.get("only")
    if not isinstance(only, list):
        return
    for label in labels:
        if label in only and tuned_label(label) not in only:
            mark = source.mark(("only", only.index(label)))
            only.append(None)
            put(only, len(only) - 1, tuned_label(label), mark)


def remove_filter(source: Source, label: str) -> None:
    """Remove a filter with its smoother and its tuned keys, or only the smoother of this label."""
    data = source.data
    # A smoother has no entry of its own: its filter is listed under `smoothed`.
    if label not in data["filters"]:
        data["smoothed"].remove(label.removesuffix(", smoothed"))
        return
    del data["filters"][label]
    if label in data.get("smoothed", ()):
        data["smoothed"].remove(label)
    if label in data.get("tune", {}):
        del data["tune"][label]
        if not data["tune"]:
            del data["tune"]
            del data["tuning"]
