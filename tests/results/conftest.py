"""Fixtures of the small experiment."""

from tests.small_experiment import folder, hostile, made

__all__ = ["folder", "hostile", "made"]
