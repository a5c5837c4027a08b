"""Pages about a folder of experiments: index.html with a card each, and README.md with all verdicts."""
