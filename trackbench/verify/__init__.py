"""Recompute results and compare them with what is stored."""
