"""Start, assumptions and filters of a new config."""

from typing import NamedTuple

from trackbench.field_types import MOST_STEPS
from trackbench.scenarios.recordings.guess_process_noise import usual_process_noise
from trackbench.scenarios.recordings.guess_record import Guess

LOCATING = {"position", "range-azimuth"}
"""Types of sensors by which a filter can start."""
LEAST_OUTLIERS = 0.005
"""share of the rows far from their neighbors from which on a filter with a gate is written"""
_MOST_PARTICLE_STEPS = 20_000  # beyond which a particle filter takes longer than all other filters
_WHY_NO_PARTICLES = "1000 particles take longer over so many steps than all other filters together"


class ModelParts(NamedTuple):
    """Parts of a config that depend on whether a target is tracked or a robot locates itself."""

    start: str
    """value of the key `start`, with a comment; after it any further keys of the scenario"""
    assume: str
    """value of the key `assume`, the motion that the filters assume, with a comment"""
    filters: list[str]
    """a line for each filter"""
    figure_labels: str
    """labels of the filters in the figures"""


def target_parts(guess: Guess, when: str) -> ModelParts:
    """Return the start, model and filters of a target that is tracked.

    ``when`` has words for the time of the first state, for a comment.
    """
    kinds = {sensor.kind for sensor in guess.sensors}
    speed = guess.speed
    start = f"{{kind: one-scan, sigma_velocity: {2 * speed:g}}}  # guess"
    if not kinds & LOCATING:
        start = (
            f"{{kind: given, mean: [X, 0, Y, 0], sigma: [100, {2 * speed:g}, 100, {2 * speed:g}]}}"
        )
        start += f"  # write x and y at {when}, m, and how well they are known"
    # Process noise of the usual speed, or the one that the rows show, if it is not 0. The IMM's motions
    # have a tenth and ten times as much.
    q = usual_process_noise(speed)
    reason = "the velocity wanders by 5 % of the usual speed in a second"
    if guess.process_noise:
        reason = (
            f"squared innovations are about 1 over the recording; for straight motion try {q:g}"
        )
        if guess.process_noise < q:
            reason = f"with {q:g} squared innovations are far below 1 over the recording"
        q = guess.process_noise
    motions = f"[{{kind: cwna, q: {q / 10:g}}}, {{kind: cwna, q: {q * 10:g}}}]"
    chances = "[[0.95, 0.05], [0.05, 0.95]]"
    late_key = key_of_late_measurements(guess)
    assume = f" {{motion: {{kind: cwna, q: {q:g}}}{late_key}}}"
    assume += f"  # guess: {reason}"
    filter_kinds = ["kf"] if kinds == {"position"} else ["ekf", "ukf"]
    gated_filter_lines = lines_of_gated_filter(guess, filter_kinds[0])
    robust_filter_lines = _robust_filter_lines(guess, filter_kinds[0])
    return ModelParts(
        start=start,
        assume=assume,
        filters=[
            *[f"  {kind.upper()}: {{kind: {kind}}}" for kind in filter_kinds],
            *gated_filter_lines,
            *robust_filter_lines,
            f"  IMM: {{kind: imm, motions: {motions}, transition: {chances}}}",
            particle_filter_line(guess),
        ],
        # Figures leave out the UKF, which hardly differs from the EKF, and the particle filter, which
        # may be a comment.
        figure_labels=", ".join(
            [
                filter_kinds[0].upper(),
                *map(label_in_line, gated_filter_lines + robust_filter_lines),
                "IMM",
            ]
        ),
    )


def label_in_line(filter_line: str) -> str:
    """Return the label of the filter in a line of the config: KF of "  KF: {kind: kf}"."""
    return filter_line.partition(":")[0].strip()


def lines_of_gated_filter(guess: Guess, kind: str) -> list[str]:
    """Return the line, in a list, of a filter with a gate, which rejects outliers.

    The list is empty if the recording seems to have none. ``kind`` is the type of the filter.
    """
    if guess.outliers < LEAST_OUTLIERS:
        return []
    percent = float(f"{100.0 * guess.outliers:.1g}")
    reason = f"some {percent:g} % of the rows are far from the line between their neighbors"
    keys = f"kind: {kind}, gate: 0.999"
    # Several sensors get a gate each: those of several files (`guess.files`), and the landmarks of a
    # robot, which alone has inputs.
    if guess.files or (guess.inputs and len(guess.sensors) > 1):
        keys += ", gate_by: sensor"
    return [f"  {kind.upper()} with gate: {{{keys}}}  # guess: {reason}"]


def _robust_filter_lines(guess: Guess, kind: str) -> list[str]:
    """Return the line, in a list, of a filter with a Student t likelihood, which weighs outliers less.

    The list is empty if the recording seems to have none. ``kind`` is the type of the filter.
    """
    if guess.outliers < LEAST_OUTLIERS:
        return []
    robust = "{kind: student-t, df: 4}"
    reason = "weighs such rows less; a gate may also reject the target in a maneuver, and lose it"
    return [f"  {kind.upper()} with Student t: {{kind: {kind}, robust: {robust}}}  # {reason}"]


def key_of_late_measurements(guess: Guess) -> str:
    """Return ", late: refilter" for the mapping `assume` if a column has the times of arrival; else "".

    With this key measurements that arrive late are filtered at their own time.
    """
    if not any("received" in file.naming.columns for file in guess.each_file):
        return ""
    return ", late: refilter"


def particle_filter_kind(guess: Guess) -> str:
    """Return the type of the particle filter: that of a robot is not regularized."""
    return "pf" if guess.inputs else "rpf"


def particle_filter_line(guess: Guess) -> str:
    """Return the line of the particle filter, which is a comment for a recording of very many steps."""
    kind = particle_filter_kind(guess)
    particle_filter = f"{kind.upper()}: {{kind: {kind}, N: 1000}}"
    if _leaves_out_particles(guess):
        return f"  # {particle_filter}  # left out: {_WHY_NO_PARTICLES}"
    return f"  {particle_filter}"


def _leaves_out_particles(guess: Guess) -> bool:
    """Test whether a recording is so long that the particle filter is only a comment in the config.

    A recording that is longer than a scenario may be is cut, and keeps its particle filter.
    """
    runs_to_its_end = guess.steps <= MOST_STEPS
    return runs_to_its_end and guess.steps > _MOST_PARTICLE_STEPS


def left_out_filters(guess: Guess) -> list[str]:
    """Return a line on each filter that is only a comment in the config, with the reason."""
    if not _leaves_out_particles(guess):
        return []
    name = particle_filter_kind(guess).upper()
    return [f"{name} is a comment in the config: {_WHY_NO_PARTICLES} ({guess.steps} steps)"]
