"""Targets: where the truth comes from."""
