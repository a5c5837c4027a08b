"""Commands shared by the command line and Python."""
