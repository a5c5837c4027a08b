"""Tuning: the keys of filters that make a metric small on training runs of their own."""
