"""From YAML to a validated experiment: every mistake with its place, all of them at once."""
