"""Numerical kernels: arrays in, arrays out, component axes first and batch axes last."""
