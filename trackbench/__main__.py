"""``python -m trackbench``."""

from trackbench.cli import main

main()
