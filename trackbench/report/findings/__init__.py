"""Conclusions in words: ranking of filters, cost, calibration."""
