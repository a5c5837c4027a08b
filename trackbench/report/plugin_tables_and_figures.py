"""Tables and figures of plugins: kinds that are unavailable, and checks of what a plugin returns."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from trackbench.component_parts import is_foreign
from trackbench.filters.base import WrongReturnError
from trackbench.plugins.plugin_errors import message_of
from trackbench.registry import Group, kinds
from trackbench.report.table import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def unavailable_kinds(config: Mapping[str, Any], group: Group) -> dict[str, str]:
    """Find the tables or figures of a config whose kind is unknown, as its plugin is not loaded.

    Parameters
    ----------
    config
        resolved config
    group
        ``tables`` or ``figures``

    Returns
    -------
    dict
        kinds of these tables or figures by their names; empty for a config without plugins
    """
    if not config.get("plugins"):  # all kinds are of the package
        return {}
    known = kinds(group)
    unavailable = {}
    for name, keys in (config.get(group) or {}).items():
        kind = keys.get("kind")
        if kind not in known:
            unavailable[name] = kind
    return unavailable


def as_table(table: object, exhibit: Any) -> Table:
    """Return a table that a table kind made, if it can be written.

    Parameters
    ----------
    table
        object that the method ``table`` returned
    exhibit
        table kind that returned it

    Returns
    -------
    Table
        ``table`` itself

    Raises
    ------
    WrongReturnError
        if it is not a `Table`, or if a plugin made it and it cannot be written. An error in a table of
        the package's own kinds is raised as it is
    """
    if not isinstance(table, Table):
        raise WrongReturnError("table", f"table gives a {type(table).__name__}, not a Table")
    # Every form of the table is made once, so that an error shows before any file is written.
    try:
        table.csv_rows()
        table.markdown()
        table.texts().tex("")
    except Exception as error:
        if not is_foreign(exhibit):
            raise
        message = f"the table cannot be written: {message_of(error)}"
        raise WrongReturnError("table", message) from None
    return table


def as_figure(figure: object) -> "Figure":
    """Return a plugin's figure.

    Parameters
    ----------
    figure
        object that the method ``draw`` returned

    Returns
    -------
    matplotlib.figure.Figure
        ``figure`` itself

    Raises
    ------
    WrongReturnError
        if it is no matplotlib figure
    """
    from matplotlib.figure import Figure

    if not isinstance(figure, Figure):
        raise WrongReturnError("draw", f"draw gives a {type(figure).__name__}, not a Figure")
    return figure
