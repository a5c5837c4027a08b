"""Scripts that start worker processes: the main guard that they need, and the message without one."""

import ast
import multiprocessing
import os
import sys
from pathlib import Path

from trackbench.errors import Mark, Problem, UserError

leave = os._exit  # as it was before any plugin ran


def is_worker_bootstrapping() -> bool:
    """Test whether this process is a worker that still imports its parent's script.

    multiprocessing sets the attribute for that time.
    """
    return bool(getattr(multiprocessing.current_process(), "_inheriting", False))


def check_script_import(without_workers: str = "workers=1") -> None:
    """Raise UserError if worker processes cannot import the script that runs.

    Python lets each worker import the script's file first. Without a file, or without a main guard, no
    worker would start. In such a worker this function ends the process. ``without_workers`` is the
    option that computes in this process.
    """
    if is_worker_bootstrapping():
        message = no_guard_message(without_workers)
        print(
            f"a worker imports the script that starts it; {message}",
            file=sys.stderr,
            flush=True,
        )
        leave(NO_GUARD_CODE)
    if multiprocessing.current_process().daemon:
        raise UserError(
            "this process is a worker of multiprocessing.Pool, which may start no processes of its own: "
            f"run with {without_workers}"
        )
    main = sys.modules["__main__"]
    file = getattr(main, "__file__", None)
    # Workers of an interpreter or a notebook import no script. Those of `python -m` import the module by
    # its name: without a guard the first lines of this function end them, and the pool reports it.
    if file is None or getattr(main, "__spec__", None) is not None:
        return
    if not os.path.isfile(file):
        raise UserError(
            f"{file}: several worker processes import the script from its file, and it has none; "
            f"save it as a file, or run it with {without_workers}"
        )
    line = _line_of_script(file)  # 0 if no line outside of functions is running
    if line and not _is_guarded(file, line):
        mark = Mark(file, line, column=1)
        message = no_guard_message(without_workers)
        raise UserError(Problem(mark, path="", message=message))  # no place in a config


def no_guard_message(without_workers: str = "workers=1") -> str:
    """Return the message on a script without a main guard.

    ``without_workers`` is the option that computes in this process.
    """
    return (
        "several worker processes import this script, and would run it again: put the call under "
        f'`if __name__ == "__main__":`, or run it with {without_workers}'
    )


NO_GUARD_CODE = 77
"""Exit code of a worker that was about to run its parent's script again."""


def _line_of_script(file: str) -> int:
    """Return the number of the script's line, outside of functions, that is running; 0 if none is.

    ``file`` is the path of the script, as its code has it.
    """
    frame = sys._getframe(1)
    line = 0
    while frame is not None:
        if frame.f_code.co_name == "<module>" and frame.f_code.co_filename == file:
            line = frame.f_lineno
        frame = frame.f_back  # type: ignore[assignment]
    return line


def _is_guarded(file: str, line: int) -> bool:
    """Test whether a script's line is protected from running again in a worker that imports the script.

    An ``if`` at the top level, with ``__name__`` or ``current_process`` in its condition, must stand
    around the line or before it: one before may end the script in a worker, as by ``sys.exit()``. A
    script that cannot be read counts as guarded.
    """
    try:
        statements = ast.parse(Path(file).read_bytes()).body
    except (OSError, SyntaxError, ValueError):
        return True
    for statement in statements:
        if statement.lineno > line:
            break
        if isinstance(statement, ast.If):
            # Names in the condition: of variables (`id`) and of attributes (`attr`).
            names = {
                getattr(node, "id", getattr(node, "attr", "")) for node in ast.walk(statement.test)
            }
            if names & {"__name__", "current_process"}:
                return True
    return False
