"""Sensors, one file each or a few alike."""
