"""Published numbers and claims against results."""
