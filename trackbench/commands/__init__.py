"""Steps that command line and Python share: prepare, run, work on stored results."""
