"""Interrupts and exits: plugin code cannot end the program, and Ctrl-C can."""

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import NoReturn

from trackbench.errors import RunError


class Interrupted(KeyboardInterrupt):
    """A signal to stop the program; plugin code cannot raise it by accident."""


def interrupt(signal_number: int, frame: FrameType | None) -> None:
    """Handle an interrupt signal."""
    raise Interrupted


@contextmanager
def guarded() -> Iterator[None]:
    """Run plugin code: it cannot end the program, but Ctrl-C still can.

    SystemExit, ``os._exit`` and a KeyboardInterrupt without a signal become a RunError. The working
    folder is afterwards what it was: paths of results and of the cache are relative to it.
    """
    with _with_own_interrupt(), _without_os_exit(), working_folder():
        try:
            yield
        except (Exception, Interrupted):
            raise
        except BaseException as error:
            raise RunError(f"code of a plugin raised {error!r}") from None


@contextmanager
def working_folder(folder: str = "") -> Iterator[None]:
    """Run code in a folder, by default the current one, and go back to the current folder afterwards."""
    try:
        before = os.getcwd()
    except OSError:  # a folder that was deleted meanwhile
        yield
        return
    try:
        if folder:
            os.chdir(folder)
        yield
    finally:
        os.chdir(before)


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
def _without_os_exit() -> Iterator[None]:
    """Let ``os._exit`` raise SystemExit, since it would end the program at once, even with exit code 0.

    In processes that are forked meanwhile it works as usual.
    """
    process = os.getpid()
    real_exit = os._exit

    def raise_exit(status: int) -> NoReturn:
        """Raise SystemExit in this process; a forked one ends."""
        if os.getpid() != process:
            real_exit(status)
        raise SystemExit(status)

    os._exit = raise_exit
    try:
        yield
    finally:
        os._exit = real_exit


@contextmanager
def _with_own_interrupt() -> Iterator[None]:
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
