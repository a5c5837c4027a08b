"""Ctrl-C, told from a filter that raises the same or leaves by `sys.exit`."""

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NoReturn

from trackbench.errors import RunError


class Interrupted(KeyboardInterrupt):
    """A signal to stop the program, which no filter raises by itself."""


def interrupt(signal_number: int, frame: object) -> None:
    """Handle an interrupt signal."""
    raise Interrupted


@contextmanager
def guarded() -> Iterator[None]:
    """Run code that is not the package's own: it cannot end the program, and Ctrl-C still does.

    SystemExit, ``os._exit``, or a KeyboardInterrupt that no signal made, becomes a RunError.
    """
    with _marked(), _staying():
        try:
            yield
        except (Exception, Interrupted):
            raise
        except BaseException as error:
            raise RunError(f"code of a plugin raised {error!r}") from None


@contextmanager
def postponed() -> Iterator[None]:
    """Let signals to stop wait until this is done; only the main thread hears them at all."""
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    heard: list[int] = []
    ours = [number for number, handler in handlers.items() if callable(handler) and _is_main()]
    for number in ours:
        signal.signal(number, lambda number, frame: heard.append(number))
    try:
        yield
    finally:
        for number in ours:
            signal.signal(number, handlers[number])
        if heard:
            signal.raise_signal(heard[0])


@contextmanager
def _staying() -> Iterator[None]:
    """Let ``os._exit`` raise SystemExit: it would end the program at once, perhaps with exit code 0.

    Processes that are forked meanwhile leave by it as ever.
    """
    process, leave = os.getpid(), os._exit

    def stay(status: int) -> NoReturn:
        if os.getpid() != process:
            leave(status)
        raise SystemExit(status)

    os._exit = stay
    try:
        yield
    finally:
        os._exit = leave


def _is_main() -> bool:
    return threading.current_thread() is threading.main_thread()


@contextmanager
def _marked() -> Iterator[None]:
    """Let Ctrl-C raise Interrupted where it would raise KeyboardInterrupt; workers ignore it."""
    if not _is_main() or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    signal.signal(signal.SIGINT, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
