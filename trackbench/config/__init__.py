"""YAML files as a validated experiment."""
