"""Filters of variable dimension: `adaptive-kf` of the paper, and `vdf` of 1982."""
