"""Signals to stop the program, and how they are held back while processes are started."""

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


class Interrupted(KeyboardInterrupt):
    """A signal to stop the program; plugin code cannot raise it by accident."""


def interrupt(signal_number: int, frame: FrameType | None) -> None:
    """Handle an interrupt signal."""
    raise Interrupted


@contextmanager
def blocked(number: int) -> Iterator[None]:
    """Block the signal of this ``number`` for processes started meanwhile.

    This process receives it afterwards.
    """
    if sys.platform == "win32":
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [number])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def postponed() -> Iterator[None]:
    """Postpone signals to stop until the block is done; only the main thread receives signals."""
    # Record the signals in place of handling them, and raise the first one afterwards.
    received: list[int] = []
    replaced_handlers = {}
    if threading.current_thread() is threading.main_thread():
        for number in (signal.SIGINT, signal.SIGTERM):
            handler = signal.getsignal(number)
            if callable(handler):  # SIG_DFL, SIG_IGN and a handler that is not Python's stay
                replaced_handlers[number] = handler
    for number in replaced_handlers:
        signal.signal(number, lambda number, frame: received.append(number))
    try:
        yield
    finally:
        for number, handler in replaced_handlers.items():
            signal.signal(number, handler)
        if received:
            signal.raise_signal(received[0])


@contextmanager
def with_own_interrupt() -> Iterator[None]:
    """Let Ctrl-C raise Interrupted in place of KeyboardInterrupt; workers ignore it."""
    is_main = threading.current_thread() is threading.main_thread()
    if not is_main or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    signal.signal(signal.SIGINT, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
