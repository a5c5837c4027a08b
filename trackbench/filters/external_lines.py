"""Lines that an external program is sent: the problem, ``init`` with a seed, ``step`` with z."""

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.random import Generator, SeedSequence

from trackbench.core.angles import wrap_angle
from trackbench.core.arrays import Array
from trackbench.core.distributions import Distribution, Gaussian, per_run_moments
from trackbench.models.angle_components import measured_angle_rows
from trackbench.models.base import Model
from trackbench.models.inputs import inputs_of
from trackbench.models.model_for_programs import describe_model
from trackbench.models.motions.linear import Linear
from trackbench.models.motions.sampling_interval import step_length
from trackbench.models.sensors.base import SensorBase
from trackbench.models.sensors.stacked import StackedSensor

PROTOCOL = 1
"""Version of the protocol, on the first line."""


class Line:
    """A line of each run, after those of the steps before.

    ``before`` is the line of the step before; None for the first one, ``init``.
    """

    def __init__(self, text_by_run: Sequence[str], number: int, time: float, before: "Line | None"):
        """Store the lines of the M runs, the number of steps since `init`, and the time since it, s."""
        self.text_by_run = text_by_run
        self.number = number
        self.time = time
        self.before = before

    def __deepcopy__(self, memo: dict[int, Any]) -> "Line":
        return self  # is never changed

    def lines_from_start(self, run: int) -> list[str]:
        """List the lines of a run, from its first, ``init``, to this one.

        Parameters
        ----------
        run : int
            Index of the run in its block.

        Returns
        -------
        list of str
            Lines in the order in which the program is sent them.
        """
        lines = [self.text_by_run[run]]
        line = self.before
        while line is not None:
            lines.append(line.text_by_run[run])
            line = line.before
        return lines[::-1]


def first_line(model: Model, parameters: Mapping[str, object]) -> str:
    """Return the first line that a program is sent: ``trackbench 1 {JSON}`` with the problem.

    Parameters
    ----------
    model : Model
        Motion and sensor that the filter assumes.
    parameters : mapping
        Numbers and words that the program is given, by name.

    Returns
    -------
    str
        Line without a line break. Its ``model`` has the matrices F, Q, H and R of a linear model with a
        constant sensor, else null.
    """
    motion, sensor = model
    problem: dict[str, object] = {
        "components": motion.components,
        "measurement": sensor.components,
        "T": getattr(motion, "T", None),  # None: no T, as for unequal intervals
        "parameters": parameters,
        "model": None,
    }
    inputs = inputs_of(motion)
    if inputs is not None:
        problem["input"] = inputs.names
    # These sensors have the same H and R at every step. Faults may scale the R of any other one.
    H = None
    if isinstance(sensor, SensorBase | StackedSensor):
        H = getattr(sensor, "H", None)
    if isinstance(motion, Linear) and H is not None:
        n = len(motion.F)
        R = sensor.measurement(np.zeros((n, 1)), 1).cov.reshape(len(sensor.components), -1)
        matrices = {"F": motion.F, "Q": motion.Q, "H": H(n), "R": R}
        problem["model"] = {name: matrix.tolist() for name, matrix in matrices.items()}
    # Without spaces: programs that find `"q": ` of their parameters by text do not find it here.
    described = json.dumps(describe_model(model), separators=(",", ":"))
    # Both JSON objects become one: `{a` and `b}` from `{a}` and `{b}`.
    text = f"{json.dumps(problem).removesuffix('}')}, {described.removeprefix('{')}"
    return f"trackbench {PROTOCOL} {text}"


def init_line(prior: Distribution, rng: Generator) -> Line:
    """Return the line ``init SEED TIME mean cov`` of each run, at time 0, with the prior's moments.

    Parameters
    ----------
    prior : Distribution
        Prior of the first state: mean (n_x, M), covariance (n_x, n_x[, M]).
    rng : numpy.random.Generator
        Random numbers of the block of runs, from whose seed those of the runs are derived. None is
        drawn.

    Returns
    -------
    Line
        Line of each of the M runs, without a line before it.
    """
    moments = per_run_moments(Gaussian(prior.mean, prior.cov))
    lines = []
    for run, seed in enumerate(run_seeds(rng, moments.mean.shape[1])):
        mean_and_cov = [moments.mean[:, run], moments.cov[..., run].ravel()]
        lines.append(f"init {seed} 0 {fields(np.concatenate(mean_and_cov))}")
    return Line(lines, number=0, time=0.0, before=None)


def step_lines(model: Model, before: Line, z: Array, k: int) -> Iterator[Line]:
    """Yield the lines of steps k, k + 1, ... with their times.

    Angles are sent in (-pi, pi], also recorded ones and those that noise carried over the cut. The known
    inputs of a step follow its measurement.

    Parameters
    ----------
    model : Model
        Motion and sensor that the filter assumes.
    before : Line
        Line of step k - 1, to which the line of step k refers. A program can so be sent a run again from
        its beginning.
    z : array (n_z, T, M)
        Measurements of the steps, angles in rad; NaN where a component is missing.
    k : int
        Number of the first step.

    Yields
    ------
    Line
        Text of all M runs at one step, its time in s since the line ``init``.
    """
    inputs = inputs_of(model.motion)
    z = z.copy()
    for row in measured_angle_rows(model.sensor):
        z[row] = wrap_angle(z[row])
    for i in range(z.shape[1]):
        number = before.number + 1
        length = step_length(model, k + i)
        time = before.time + length
        if hasattr(model.motion, "T"):
            # All steps are of one length: a product has no rounding error that grows from step to step.
            time = number * length
        lines = [f"step {time:.17g} {fields(z_of_run)}" for z_of_run in z[:, i].T]
        if inputs is not None:
            inputs_of_step = fields(np.array(inputs.at(k + i)))
            lines = [f"{line} {inputs_of_step}" for line in lines]
        before = Line(text_by_run=lines, number=number, time=time, before=before)
        yield before


def fields(values: Array) -> str:
    """Write numbers with all their digits, separated by spaces."""
    return " ".join(f"{value:.17g}" for value in values.tolist())


def run_seeds(block: Generator, runs: int) -> list[int]:
    """Derive a number of 32 bits for each run of a block, to seed generators outside of Python.

    Parameters
    ----------
    block : numpy.random.Generator
        Random numbers of the block of runs, whose seed is used. None is drawn.
    runs : int
        Number of runs M.

    Returns
    -------
    list of int
        Seed of each run.
    """
    seed = block.bit_generator.seed_seq
    assert isinstance(seed, SeedSequence)
    numbers = []
    for run in range(runs):
        sequence = SeedSequence(seed.entropy, spawn_key=(*seed.spawn_key, run))
        numbers.append(int(sequence.generate_state(1)[0]))
    return numbers
