"""trackbench: Monte Carlo experiments with target-tracking filters, from YAML to tables."""

__version__ = "0.1.0"
