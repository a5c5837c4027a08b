"""Steps that the command line and the Python functions share: prepare, run, work on stored
results.
"""
