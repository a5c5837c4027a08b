"""Tuning: search keys of filters for the smallest metric on separate training runs."""
