"""The command ``trackbench``, and ``python -m trackbench``."""

import atexit
import gc
import sys


def leave_working_folder() -> None:
    """Remove the working folder, where ``python -m`` looks for modules first, from Python's path.

    Otherwise a user's file ``numpy.py`` there would stand in place of the package. The folder stays if
    trackbench itself was found there, as in a clone that is not installed.
    """
    # Of a program that is run as a file, Python has not put the working folder there.
    if sys.flags.safe_path or "trackbench" not in sys.modules:
        return
    package_folder = sys.modules["trackbench"].__path__[0].replace("\\", "/")
    if package_folder != f"{sys.path[0]}/trackbench".replace("\\", "/"):
        del sys.path[0]


def main() -> None:
    """Run the command line; an interrupt during imports is reported, too."""
    # Nearly all that is imported, read and drawn stays in use. The garbage collector looks through it
    # seldom, as this takes long, and not at all when the program ends.
    gc.set_threshold(50_000)
    atexit.register(gc.freeze)
    try:
        from trackbench.cli.app import main as run

        run()
    except KeyboardInterrupt:
        print("\ninterrupted", file=sys.stderr)
        sys.exit(130)  # 128 and SIGINT's number 2, as of a shell


if __name__ == "__main__":
    leave_working_folder()
    main()
