"""Command `new`: writes starting files, and configs of recorded data."""

import shlex
from pathlib import Path
from typing import Annotated

import typer

from trackbench.cli.options import one_of


def new(
    noun: Annotated[
        str,
        typer.Argument(
            metavar="what", help="filter, sensor, motion, start, scenario or experiment"
        ),
    ],
    name: Annotated[
        str | None, typer.Argument(help="its name, such as my-sensor; of data by default theirs")
    ] = None,
    data: Annotated[
        list[Path] | None,
        typer.Option(
            "--from", metavar="FILE", help="an experiment's table of data; one for each sensor"
        ),
    ] = None,
    truth: Annotated[
        Path | None,
        typer.Option("--truth", metavar="FILE", help="a table of the true path, beside --from"),
    ] = None,
    odometry: Annotated[
        Path | None,
        typer.Option(
            "--input", metavar="FILE", help="a table of a robot's odometry, beside --from"
        ),
    ] = None,
    landmarks: Annotated[
        Path | None,
        typer.Option(
            "--landmarks", metavar="FILE", help="a table of where landmarks are, beside --from"
        ),
    ] = None,
    per_run: Annotated[
        bool, typer.Option("--per-run", help="a filter that is written for one run, without arrays")
    ] = False,
    nonlinear: Annotated[
        bool,
        typer.Option(
            "--nonlinear",
            help="a motion of any state, by its equations in Python; with --per-run a filter that takes "
            "any model as functions",
        ),
    ] = False,
    language: Annotated[
        str,
        typer.Option(help="a filter as a program: c, c++, rust, julia, octave, javascript, python"),
    ] = "",
    sets: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="how --from reads: columns.time=Zeit"),
    ] = None,
) -> None:
    """Write a commented starting file that runs as it is, and its test.

    With --from, an experiment is on recorded data, whose columns, units and errors are guessed.
    With --language, a filter is a program that reads and writes lines, and a config runs it.
    """
    from trackbench.errors import UserError, first_names
    from trackbench.new_experiment_from_tables import WrittenConfig, write_config_for
    from trackbench.scenarios.recordings.unused_columns import (
        MOST_COLUMNS,
        line_on_unused_columns,
    )
    from trackbench.starting_files import LANGUAGES, NOUNS, write_new

    # Step 1: check the options.
    one_of("new", noun, NOUNS)
    if language:
        one_of("--language", language, tuple(LANGUAGES))
    chosen_options = []
    takes_any_model = noun == "filter" and per_run and nonlinear
    if per_run:
        chosen_options.append("--per-run")
    if nonlinear and not takes_any_model:
        chosen_options.append("--nonlinear")
    if language:
        chosen_options.append("--language")
    if data:
        chosen_options.append("--from")
    if len(chosen_options) > 1:
        raise UserError(f"new {noun} {name}: {' and '.join(chosen_options)} exclude each other")
    if data and noun != "experiment":
        raise typer.BadParameter(f"a {noun} is not made from data", param_hint="--from")
    tables = {"--truth": truth, "--input": odometry, "--landmarks": landmarks}
    for option, table in tables.items():
        if table is not None and not data:
            raise typer.BadParameter(
                _needs_measurements(name, option, str(table)), param_hint=option
            )
    if sets and not data:
        raise typer.BadParameter(_needs_measurements(name, "--set", sets[0]), param_hint="--set")
    # Step 2: write the files.
    if data:
        first, *further = data
        written = write_config_for(
            first,
            name,
            Path(),
            sets or (),
            truth=truth,
            further=further,
            odometry=odometry,
            landmarks=landmarks,
        )
    elif name is None:
        raise typer.BadParameter("is required without --from", param_hint="NAME")
    else:
        form = language
        if takes_any_model:
            form = "per_run_nonlinear"
        elif per_run:
            form = "per_run"
        elif nonlinear:
            form = "nonlinear"
        written = WrittenConfig(paths=write_new(noun, name, Path(), form))
    # Step 3: print what was written, and what to do next. Only a config on data has columns and units.
    for path in written.paths:
        typer.echo(f"wrote {path}")
    if written.unused:
        typer.echo(line_on_unused_columns(written.unused, written.quantities, written.prefix))
    if written.unused_of_truth:
        names = first_names(written.unused_of_truth, MOST_COLUMNS)
        typer.echo(f"columns of the truth not used: {names}")
    for line in [*written.units, *written.left_out]:
        typer.echo(line)
    for note in written.notes:
        typer.echo(f"note: {note}", err=True)
    config = next(path for path in written.paths if path.suffix == ".yaml")
    if language:
        build_command = LANGUAGES[language].build
        if build_command:
            typer.echo(f"build it: {build_command.replace('@MODULE@', config.stem)}")
    # Sensors whose place the user must write.
    if written.unknown:
        typer.echo(f"write into it where these are: {', '.join(written.unknown)}")
    run_command = f"trackbench run {config}"
    if noun != "experiment":
        run_command += " --allow-plugins"
    typer.echo(f"run it: {run_command}")


def _needs_measurements(name: str | None, option: str, value: str) -> str:
    """Return the message on an ``option`` with a ``value`` that is given without --from.

    ``name`` is that of the experiment, if it has one.
    """
    named = f"{shlex.quote(name)} " if name else ""
    way = f"trackbench new experiment {named}--from FILE {option} {shlex.quote(value)}"
    return f"needs --from, the table of measurements: {way}"
