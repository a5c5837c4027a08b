"""Inputs, start, assumed motion and filters of a new config of a robot that locates itself."""

from collections.abc import Iterator, Mapping
from dataclasses import replace

from trackbench.scenarios.recordings.guess_record import Guess
from trackbench.scenarios.recordings.new_config_filters import (
    ModelParts,
    key_of_late_measurements,
    label_in_line,
    lines_of_gated_filter,
    particle_filter_line,
)
from trackbench.scenarios.recordings.new_config_first_state import (
    POSE,
    FirstState,
    pose_in_words,
    unknown_words,
)
from trackbench.scenarios.recordings.new_config_further_tables import FurtherTables
from trackbench.scenarios.recordings.yaml_values import naming_in_braces, quoted


def robot_parts(guess: Guess, when: str, first_state: FirstState | None) -> ModelParts:
    """Return the start, model and filters of a robot that locates itself by landmarks.

    It starts at the truth's pose if ``first_state`` has one. ``when`` has words for the time of the
    first state, for a comment. The start comes with the scenario's key `score`, as only a robot's
    heading is scored apart from its position.
    """
    mean = pose_in_words(first_state)
    start = f"{{kind: given, mean: [{', '.join(mean)}], sigma: [0.1, 0.1, 0.1]}}"
    missing = unknown_words(mean)
    if len(missing) == len(POSE):
        start += f"  # write the pose at {when}, m and rad, and how well it is known"
        if first_state is not None and first_state.later > 0.0:
            start += f"; the truth begins {first_state.later:.3g} s later"
    elif first_state is not None:
        pose = f"the truth's pose at {when}"
        if first_state.later > 0.0:
            pose = f"the truth's pose {first_state.later:.3g} s after {when}"
            if first_state.is_moved:
                pose += ", moved back by the odometry"
        start += f"  # {pose}, m and rad; sigma: guess"
        if missing:
            start += f"; write the {' and '.join(missing)}, which the truth lacks"
    start += "\n  score: {errors: {position: [px, py], heading: [heading]}}  # with a `truth`"
    gated_filter_lines = lines_of_gated_filter(guess, "ekf")
    return ModelParts(
        start=start,
        assume=_robot_assumption(guess.inputs, key_of_late_measurements(guess)),
        filters=[
            "  EKF: {kind: ekf}",
            "  UKF: {kind: ukf}",
            *gated_filter_lines,
            particle_filter_line(guess),
            "  Odometry: {kind: prior-mean}  # without the landmarks",
        ],
        figure_labels=", ".join(["EKF", *map(label_in_line, gated_filter_lines), "Odometry"]),
    )


def _robot_assumption(sigmas: Mapping[str, float], late: str) -> str:
    """Return the value of the key `assume` for a robot: its motion by the odometry, as YAML.

    ``sigmas`` are the standard deviations of the speed v and the turn rate w. ``late`` is the text that
    `key_of_late_measurements` returns: a comma and a key, or empty.
    """
    deviations = ", ".join(f"s{name}: {sigma:g}" for name, sigma in sigmas.items())
    late_line = ""
    if late:
        late_line = f"\n    {late.removeprefix(', ')}"
    return (
        f"""
    motion:  # a step along the heading, by the speed v and the turn rate w since the step before
      kind: map
      components: [px, py, heading]
      input: [v, w]
      parameters: {{{deviations}}}  # guess: errors of v and w, from the line between their neighbors
      where: {{c: cos(heading + w*T/2), s: sin(heading + w*T/2)}}
      next: {{px: px + v*T*c, py: py + v*T*s, heading: heading + w*T}}
      Q: [[(sv*T*c)**2, (sv*T)**2*c*s, 0], [(sv*T)**2*c*s, (sv*T*s)**2, 0], [0, 0, (sw*T)**2]]
    """.rstrip()
        + late_line
    )


def input_lines(guess: Guess, tables: FurtherTables) -> Iterator[str]:
    """Yield the lines of the target's keys of a robot's inputs.

    The inputs are in the table of odometry, or in that of the measurements if there is no other.
    ``tables.keys`` are further keys on the inputs that the user set, such as input_gap and input_holds.
    """
    odometry = tables.odometry
    columns = guess.naming.columns
    if odometry is not None:
        yield f"input_file: {tables.odometry_path}"
        columns = odometry.naming.columns
    inputs = ", ".join(f"{name}: {quoted(columns[name])}" for name in guess.inputs)
    yield f"input: {{{inputs}}}  # guess, from their names: speed and turn rate, anticlockwise"
    if odometry is not None:
        others = {name: column for name, column in columns.items() if name not in guess.inputs}
        naming = replace(odometry.naming, columns=others)
        yield f"input_naming: {naming_in_braces(naming)}  # guess, from the names of its columns"
    if "input_holds" not in tables.keys:
        yield "# a row's v and w hold since the row before; of commands write `input_holds: after`"
    for key, value in tables.keys.items():
        yield f"{key}: {value}"
