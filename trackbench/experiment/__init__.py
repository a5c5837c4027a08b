"""Floor 4: from a YAML file to validated experiments, their plan, their execution and their files."""
