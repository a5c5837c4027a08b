"""Command line: options in, messages out, no logic."""
