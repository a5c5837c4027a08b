"""matplotlib as a program needs it: without the help texts that it writes while it is imported."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any


def import_artists() -> None:
    """Import what draws and saves figures, in two thirds of the time.

    The rest goes into the help of each artist's `set`, which is for notebooks and read by no program.
    """
    from matplotlib import artist

    with ExitStack() as stack:
        stack.enter_context(_instead(artist, "kwdoc", lambda artist: ""))
        stack.enter_context(
            _instead(artist.Artist, "_update_set_signature_and_docstring", lambda: None)
        )
        from matplotlib.backends import backend_svg  # noqa: F401

        from trackbench.report import canvas  # noqa: F401


@contextmanager
def _instead(of: Any, name: str, other: Any) -> Iterator[None]:
    """Let something else have a name, if it is there, for a while."""
    if name not in vars(of):
        yield
        return
    usual = vars(of)[name]
    setattr(of, name, other)
    try:
        yield
    finally:
        setattr(of, name, usual)
