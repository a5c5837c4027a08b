"""A program in any language as a filter, by a protocol of lines.

Lines are UTF-8 text with fields separated by spaces, and NaN stands for what is missing. The program
answers each line but the last with one line:

- ``trackbench 1 {JSON}``: components, measurement, T, parameters, model, input if the motion has
  known inputs, and first_step, motion, sensors and start as in the config. Answer: ``ready``.
- ``init SEED TIME mean(n) cov(n n)``: a run begins. Answer: ``mean(n) cov(n n)``, or ``mean(n)``.
- ``step TIME z(n_z)``: predict to TIME, update with z. Answer: as of ``init``. Inputs follow z.
- ``end``: the program ends with code 0.

A program keeps the state of one run. A state of the filter is the lines of its run so far, so that it
can be filtered on from any step: a program that is elsewhere begins the run again.
"""

import shutil
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Annotated, ClassVar, NamedTuple

import numpy as np
from annotated_types import Interval
from numpy.random import SFC64, Generator

from trackbench.component_parts import field_values
from trackbench.core.arrays import Array
from trackbench.core.distributions import Distribution, Gaussian
from trackbench.field_types import (
    DataFile,
    InvalidKeyError,
    ProgramWord,
    VariableName,
    freeze_mappings,
)
from trackbench.filters.base import WHOLE_FILTER, Filter, Steps, WrongReturnError
from trackbench.filters.external_answers import check_repeated, equals_estimate, read_numbers
from trackbench.filters.external_files import (
    digest_below,
    digest_of_variable,
    digest_of_word,
    stamps,
    unwatched_cautions,
)
from trackbench.filters.external_lines import Line, first_line, init_line, step_lines
from trackbench.filters.external_process import (
    NoFirstAnswerError,
    Program,
    ProgramError,
    end_programs,
    pool_of,
)
from trackbench.filters.float32_digits import Digits, digits_of, float32_advice
from trackbench.models.base import Model, Scene
from trackbench.models.component_names import few_names
from trackbench.registry import register

_PROBED_STEPS = 30  # whose answers show the digits of a program


class ProgramState(NamedTuple):
    """Lines that the programs were sent, and the last estimates: mean (n, M) and cov (n, n, M)."""

    hello: str
    """first line, with the problem"""
    line: Line | None
    """last line of each run; None before `init`"""
    mean: Array
    cov: Array


class ProgramRunError(WrongReturnError):
    """A program failed in a run at a step; `External` counts the runs from 0."""

    def __init__(self, run: int, step: int, failure: str) -> None:
        """Store the run, the number of steps since its `init`, and what the program did wrong."""
        super().__init__("step", f"run {run}, step {step}: {failure}")
        self.run = run
        self.step = step
        self.failure = failure

    def with_run(self, run: int) -> "ProgramRunError":
        """Return the error with another number of its run, that in the experiment."""
        return ProgramRunError(run, self.step, self.failure)


@register("filters", "external")
@dataclass(frozen=True, kw_only=True, eq=False)
class External(Filter[ProgramState]):
    """A program in any language, which reads measurements and writes estimates in lines of text.

    docs/any-language.md has the protocol; ``trackbench new filter NAME --language c`` writes a program.
    """

    command: tuple[ProgramWord, ...]
    """the program and its arguments; words that are files are found from the config's folder"""

    parameters: dict[str, bool | int | float | str | tuple[float, ...]] = field(
        default_factory=dict
    )
    """numbers and words that the program is given at its start"""

    timeout: Annotated[float, Interval(gt=0, le=1e6)] = 10.0
    """seconds that an answer may take"""

    files: tuple[DataFile, ...] = ()
    """further files and folders on which the estimates depend, such as the program's source"""

    environment: tuple[VariableName, ...] = ()
    """environment variables that the program reads; cached blocks depend on their values"""

    copies: Annotated[int, Interval(ge=1, le=1000)] = 8
    """programs that a worker may run side by side, each for one run at a time"""

    loops_over_runs: ClassVar[bool] = True
    runs_program: ClassVar[bool] = True
    contract_exemptions: ClassVar[dict[str, str]] = {"purity": "a program keeps its state itself"}

    def __post_init__(self) -> None:
        freeze_mappings(self)
        if not (self.command and self.command[0]):
            raise InvalidKeyError("name a program, as [./my_filter]", "command")
        if shutil.which(self.command[0]) is None:
            message = f"{self.command[0]} is not a program that can be executed"
            raise InvalidKeyError(message, "command", 0)
        # Store the digests of the files now, since the files may change before the program runs. They
        # belong to `_identity`: with other files it is another filter.
        object.__setattr__(self, "_content", self.digests())

    def digests(self) -> tuple[tuple[str, str], ...]:
        """Return each word of the command, file and variable with the digest of what it is now."""
        files = [(file, digest_below(file, i)) for i, file in enumerate(self.files)]
        words = [(word, digest_of_word(word)) for word in self.command]
        variables = [(name, digest_of_variable(name)) for name in self.environment]
        return (*words, *files, *variables)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, External) and self._identity == other._identity

    def __hash__(self) -> int:
        return hash(self._identity)

    @property
    def _identity(self) -> tuple[object, ...]:
        return (*field_values(self).values(), self.__dict__["_content"])

    @property
    def stored_digests(self) -> tuple[tuple[str, str], ...]:
        """Words with their digests, in the order of `digests`, as they were when the config was read."""
        stored: tuple[tuple[str, str], ...] = self.__dict__["_content"]
        return stored

    @property
    def contents(self) -> dict[str, str]:
        """Digests by word, as they were when the config was read; of a file if a word is both."""
        return dict(self.stored_digests)

    def digits(self, model: Model, prior: Distribution, z: Array, k: int) -> Digits:
        """Run the program on measurements, and test the digits of its answers.

        The digits of a program that fails count as enough. There is advice if they are those of float32
        and too few for the coordinates.

        Parameters
        ----------
        model : Model
            Motion and sensor that the filter assumes.
        prior : Distribution
            Prior of the first state: mean (n_x, M).
        z : array (n_z, T, M)
            Measurements, of which the first 30 steps are used.
        k : int
            Number of the first step.

        Returns
        -------
        Digits
            Digits of the answers.
        """
        try:
            state = self.init(model, prior, Generator(SFC64(1)))  # any seed
            steps = self.all_steps(model, state, z[:, :_PROBED_STEPS], k)
        except WrongReturnError:
            return Digits()
        mean = steps.estimate.mean
        cov = steps.estimate.cov
        digits = digits_of(mean, cov)
        if not digits.is_float32:
            return digits
        advice = float32_advice(mean, cov, model.motion.components, digits.printed)
        return digits._replace(advice=advice)

    def conflicts(self, scenario: Scene) -> dict[str, str]:
        """Start the program with the scenario's model; return the reason unless it answers `ready`.

        A program that does not answer at all is not started again for another scenario.
        """
        if self in _SILENT:
            return {WHOLE_FILTER: _SILENT[self]}
        motion, sensor = scenario.model
        state = few_names(motion.components)
        measurement = few_names(sensor.components)
        where = f"(state: {state}; measurement: {measurement})"
        try:
            why = _why_not_ready(self, first_line(scenario.model, self.parameters))
        except NoFirstAnswerError as error:
            _SILENT[self] = f"{error} {where}"
            return {WHOLE_FILTER: _SILENT[self]}
        if not why:
            return {}
        return {WHOLE_FILTER: f"{why} {where}"}

    @property
    def is_silent(self) -> bool:
        """True if the program gave no answer to a first line: it does not speak the protocol."""
        return self in _SILENT

    def cautions(self, scenario: Scene) -> list[str]:
        """Note how far its numbers are reproducible, and what of its files is not watched."""
        notes = ["the numbers of an external program are the same on the same machine only"]
        return notes + unwatched_cautions(self.command, self.files)

    def init(self, model: Model, prior: Distribution, rng: Generator) -> ProgramState:
        """Begin each run with the moments of its prior."""
        first = init_line(prior, rng)
        # Before the first line there are no estimates; only the number of components is read.
        nothing = np.full((len(prior.mean), len(first.text_by_run)), np.nan)
        hello = first_line(model, self.parameters)
        before = ProgramState(hello=hello, line=None, mean=nothing, cov=nothing[None])
        mean, cov = self._answers(before, [first])
        return ProgramState(hello=before.hello, line=first, mean=mean[:, 0], cov=cov[:, :, 0])

    def step(
        self, model: Model, state: ProgramState, z: Array, k: int, rng: Generator
    ) -> ProgramState:
        """Send the measurements of one step to the programs, and read their estimates."""
        after: ProgramState = self.all_steps(model, state, z[:, None], k).state(0)
        return after

    def all_steps(self, model: Model, state: ProgramState, z: Array, k: int) -> Steps:
        """Send the measurements z (n_z, T, M) of all steps, and read the estimates.

        A program gets all lines of one run, then those of the next.
        """
        assert state.line is not None
        # A `Line` for each of the T steps, with a text for each of the M runs.
        lines = list(step_lines(model, state.line, z, k))
        mean, cov = self._answers(state, lines)
        if state.line.before is None:
            self._check_last_run(state, lines[-1])

        def state_after(i: int) -> ProgramState:
            return ProgramState(hello=state.hello, line=lines[i], mean=mean[:, i], cov=cov[:, :, i])

        return Steps(estimate=Gaussian(mean, cov), diagnostics={}, state=state_after)

    def estimate(self, state: ProgramState) -> Gaussian:
        """Return the programs' last answers."""
        return Gaussian(state.mean, state.cov)

    def _answers(self, state: ProgramState, lines: Sequence[Line]) -> tuple[Array, Array]:
        """Send the lines to the programs; return all means (n, T, M) and covariances (n, n, T, M).

        Each of the T lines has a text for every run. ``state`` is that before them: its `line` is the
        last one that was sent in all runs, and None before `init`. A program whose last line was another
        one begins the run again with all lines up to it. A covariance is NaN if a program answers only
        means.
        """
        runs = len(lines[0].text_by_run)
        n = len(state.mean)
        pool = pool_of(self, state.hello)
        mean = np.empty((n, len(lines), runs))
        cov = np.full((n, n, len(lines), runs), np.nan)
        for run in range(runs):
            try:
                program = pool.program_of_run(run, state.line)
                answers, repeated = program.exchange(state.line, lines, run)
                numbers = read_numbers(answers, n)
                if repeated:  # the program began the run again, up to the state
                    again = read_numbers(repeated[-1:], n)[0]
                    check_repeated(again, state.mean[:, run], state.cov[:, :, run])
            except ProgramError as error:
                pool.kill()
                raise ProgramRunError(run, lines[0].number + error.answered, str(error)) from None
            mean[:, :, run] = numbers[:, :n].T
            if numbers.shape[1] > n:
                cov[..., run] = numbers[:, n:].T.reshape(n, n, -1)
        if pool.stamps != stamps(self.command, self.files):
            # All runs of the block are in doubt: the error names the first one.
            raise ProgramRunError(0, lines[0].number, "the program or its files changed meanwhile")
        return mean, cov

    def _check_last_run(self, state: ProgramState, last: Line) -> None:
        """Begin the last run again, to find a program that answers one line by several.

        Its answers are those to earlier lines. The next exchange would find this, and after the last
        run there is none. ``state`` is that after ``init``, and ``last`` was sent last.
        """
        assert state.line is not None
        pool = pool_of(self, state.hello)
        run = state.mean.shape[1] - 1
        n = len(state.mean)
        try:
            program = pool.program_of_run(run, last)
            again = read_numbers(program.begin_again(state.line, run), n)[0]
            if not equals_estimate(again, state.mean[:, run], state.cov[:, :, run]):
                message = "the answer to the last line is another one than at first"
                hint = "does the program answer each line by one line, and does `init` set all"
                raise ProgramError(
                    f"{message} if its run begins again: {hint} of the state, and SEED all noise?"
                )
        except ProgramError as error:
            pool.kill()
            raise ProgramRunError(run, last.number, str(error)) from None


_SILENT: dict[External, str] = {}
"""Programs that gave no answer to a first line, with the message: each one costs its `timeout`."""


@lru_cache(maxsize=1024)
def _why_not_ready(tracker: External, hello: str) -> str:
    """Start a program with its first line; return why it does not run on the problem, or an empty text.

    Raises NoFirstAnswerError if there is no answer in time.
    """
    try:
        program = Program(tracker.command, hello, tracker.timeout)
    except NoFirstAnswerError:
        raise  # `conflicts` keeps it in `_SILENT`, for all problems
    except ProgramError as error:
        return str(error)
    end_programs([program])
    return ""
