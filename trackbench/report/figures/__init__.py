"""Kinds of figures, one file each: a dataclass of options with ``draw(results)``."""
