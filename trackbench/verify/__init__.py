"""Recompute results and compare them with the stored ones."""
