"""Checks of the rows of published files against the experiment: filters, steps, points, claims."""

from collections.abc import Mapping, Sequence

from trackbench.config.did_you_mean import unknown
from trackbench.config.published_numbers_and_claims import Claim, PublishedNumber, picks, split_cell
from trackbench.yaml_source import Source


def check_labels(row: PublishedNumber | Claim, source: Source, labels: list[str] | None) -> None:
    """Check that the filters that a row names exist, if the ``labels`` of all filters are known.

    ``source`` has the cells of the row, and gets the mistakes.
    """
    if labels is None:
        return
    # The labels in each column.
    if isinstance(row, Claim):
        named_labels = {"left": split_cell(row.left), "right": row.rights}
        expressions = {"expression": row.expression, "right_expression": row.right_expression}
    else:
        named_labels = {"label": row.labels}
        expressions = {"expression": row.expression}
    for key, expression in expressions.items():
        if expression and expression.other:
            named_labels[key] = [expression.other]
    for key, column_labels in named_labels.items():
        for label in column_labels:
            if label not in labels:
                message = f"{label!r} is not a filter here; {unknown(label, labels)}"
                source.add_problem((key,), message)


def check_steps(row: PublishedNumber | Claim, source: Source) -> None:
    """Check that a number is of one step, and that both sides of a claim are of equal steps.

    A right side that names no range of steps is compared with each step of the left side. ``source`` has
    the cells of the row, and gets the mistakes.
    """
    left = row.expression
    if isinstance(row, PublishedNumber):
        if left and left.is_many:  # a range of steps
            source.add_problem(("expression",), f"{str(left)!r} is no number: name one step")
        return
    right = row.right_expression
    if right and right.is_many and not (left and left.steps == right.steps):
        message = f"{str(right)!r} is not at the steps of {str(left)!r}"
        source.add_problem(("right_expression",), message)


def check_point(
    row: PublishedNumber | Claim, source: Source, points: Sequence[Mapping[str, object]] | None
) -> None:
    """Check that a row's point, such as ``path=value; path=value``, is one of the grid.

    ``points`` are the values of each point by path. Without them any point is allowed.
    """
    if not all("=" in condition for condition in split_cell(row.point)):
        source.add_problem(("point",), f"{row.point!r} is not path=value; path=value")
    elif points and not any(picks(row.point, values) for values in points):
        source.add_problem(("point",), f"{row.point!r} is no point of the grid")


def check_repeated(row: PublishedNumber, source: Source, earlier: list[PublishedNumber]) -> None:
    """Check a row against the rows of the same printed number among the ``earlier`` rows.

    They must have the same value, and each an interpretation of its own in ``reading``.
    """
    for other in earlier:
        if other.printed_at != row.printed_at:
            continue
        repeated = "an earlier row has this paper, table, row, filter, metric and point, too"
        if other.value != row.value:
            message = f"is {row.value} here and {other.value} there: {repeated}"
            source.add_problem(("value",), message)
            return
        have_readings = row.reading and other.reading
        if not have_readings or row.reading == other.reading:
            message = f"{repeated}: give each a `reading` of its own, or leave one out"
            source.add_problem(("reading",), message)
            return


def check_claim(row: Claim, source: Source) -> None:
    """Check a claim's text, filter and comparison, which is ``left relation factor * right``.

    Both sides are metric expressions of filters; a claim without any is text alone, and is not tested.
    Without labels on the right side the left one is compared with the number ``factor``. ``source`` has
    the cells of the row, and gets the mistakes.
    """
    if not row.claim.strip():
        source.add_problem(("claim",), "is empty")
    if (row.expressions or row.rights) and not row.left.strip():
        source.add_problem(("left",), "is empty: name the filter that is spoken of")
    if row.expressions and not row.rights and "factor" not in source.data:
        source.add_problem(("factor",), "is empty, as right is: there is nothing to compare with")
    if row.rights and row.factor <= 0.0:
        message = (
            f"{row.factor:g} times the right side means nothing; a factor of `right` is above 0"
        )
        source.add_problem(("factor",), message)
    elif row.expressions and row.relation == "~" and not (row.factor and row.tolerance):
        key = "factor" if row.factor == 0.0 else "tolerance"
        message = "is 0, and `~` allows `tolerance` times it: nothing measured can be equal"
        source.add_problem((key,), message)
