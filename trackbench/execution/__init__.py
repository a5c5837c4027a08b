"""Execution: split an experiment into blocks of runs, key them, and compute them in processes."""
