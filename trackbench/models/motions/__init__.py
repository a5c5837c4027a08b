"""Motions of targets and of filter models, one file for each family."""
