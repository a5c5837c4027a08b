"""Command `schema`: the JSON Schema of an experiment file, for editors."""

import typer


def schema() -> None:
    """Print the JSON Schema of an experiment file, for editors."""
    import json

    from trackbench.help.json_schema import schema

    typer.echo(json.dumps(schema(), indent=1))
