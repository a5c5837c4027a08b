"""Guard of plugin code: it cannot end the program by an exit, and Ctrl-C can."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NoReturn

from trackbench.errors import RunError
from trackbench.plugins.stop_signals import Interrupted, with_own_interrupt


@contextmanager
def guarded() -> Iterator[None]:
    """Run plugin code: it cannot end the program, but Ctrl-C still can.

    SystemExit, ``os._exit`` and a KeyboardInterrupt without a signal become a RunError. The working
    folder is afterwards what it was: paths of results and of the cache are relative to it.
    """
    with with_own_interrupt(), _without_os_exit(), working_folder():
        try:
            yield
        except (Exception, Interrupted):
            raise
        except BaseException as error:
            raise RunError(f"code of a plugin raised {error!r}") from None


@contextmanager
def working_folder(folder: str = "") -> Iterator[None]:
    """Run code in a folder, by default the current one, and go back to the current folder afterwards.

    If the current folder was deleted, the code runs where it is, since there is no way back.
    """
    try:
        before = os.getcwd()
    except OSError:  # the current folder was deleted
        yield
        return
    try:
        if folder:
            os.chdir(folder)
        yield
    finally:
        os.chdir(before)


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
def keeping_variables() -> Iterator[None]:
    """Run a plugin's code, and give environment variables that it removed their values back.

    The code runs again in each worker, which gets the variables of this process, and other plugins read
    them, too. Variables that it sets stay: a library may read them only when it computes.
    """
    before = dict(os.environ)
    try:
        yield
    finally:
        for name in before.keys() - os.environ.keys():
            os.environ[name] = before[name]
