"""Texts about kinds, keys and metrics for `list`, `describe` and the site."""
