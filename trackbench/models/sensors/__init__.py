"""Sensors, one file for each family."""
