"""The command ``trackbench``, and ``python -m trackbench``."""

import atexit
import gc
import sys


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
    main()
