"""Scores of filters over the problems of a suite: one record a cell, figures, page."""
