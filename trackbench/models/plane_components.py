"""Components that are x and y in the plane, for maps of tracks."""

from collections.abc import Mapping, Sequence


def rows_in_plane(
    components: Sequence[str], errors: Mapping[str, Sequence[str]]
) -> tuple[int, int] | None:
    """Return the rows of the two components of a position.

    They are px and py, or the first two of the error ``position`` if the ``errors`` of a score have it.

    Parameters
    ----------
    components : sequence of str
        Names of the state's components, in order.
    errors : mapping of str to sequence of str
        Names of the components of each error, by the error's name.

    Returns
    -------
    tuple of int or None
        Rows of x and y. None if the state has no such components.
    """
    named = [name for name in errors.get("position", ()) if name in components]
    if len(named) < 2:
        named = [name for name in ("px", "py") if name in components]
    if len(named) < 2:
        return None
    return components.index(named[0]), components.index(named[1])
