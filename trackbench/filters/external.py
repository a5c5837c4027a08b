"""A program in any language as a filter, by a protocol of lines.

Lines are UTF-8 text with fields separated by spaces, and NaN stands for what is missing. The program
answers each line but the last with one line:

- ``trackbench 1 {JSON}``: components, measurement, T, parameters, model. Answer: ``ready``.
- ``init SEED TIME mean(n) cov(n n)``: a run begins. Answer: ``mean(n) cov(n n)``, or ``mean(n)``.
- ``step TIME z(n_z)``: predict to TIME, update with z. Answer: as of ``init``.
- ``end``: the program ends with code 0.

A program keeps the state of one run. A state of the filter is the lines of its run so far, so that it
can be filtered on from any step: a program that is elsewhere begins the run again.
"""

import hashlib
import json
import shutil
import threading
from collections import OrderedDict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np
from annotated_types import Interval
from numpy.random import Generator

from trackbench.core.angles import wrap_angle
from trackbench.core.arrays import Array
from trackbench.core.distributions import Distribution, Gaussian, per_run_moments
from trackbench.core.random_streams import run_seeds
from trackbench.extension_points import field_values
from trackbench.field_types import (
    DataFile,
    InvalidKeyError,
    ProgramWord,
    freeze_mappings,
    require_regular_file,
)
from trackbench.filters.base import Filter, Steps, WrongReturnError
from trackbench.filters.program import PROTOCOL, Program, ProgramError, end_programs
from trackbench.models.base import Model, Scene, measured_angle_rows
from trackbench.models.motions.irregular import step_length
from trackbench.models.motions.kinematic import Linear
from trackbench.models.sensors.base import SensorBase, StackedSensor
from trackbench.registry import register

_ASYMMETRY = 1e-7  # largest difference of two correlations that should be equal
_SHORT = 100  # steps that a program repeats, in place of another program
_POOLS = 4  # filters whose programs stay ready in a thread


class _Line:
    """A line of each run, after those of the steps before."""

    def __init__(self, of_runs: Sequence[str], number: int, time: float, before: "_Line | None"):
        self.of_runs, self.number, self.time, self.before = of_runs, number, time, before

    def __deepcopy__(self, memo: dict[int, Any]) -> "_Line":
        return self  # is never changed

    def of_run(self, run: int) -> list[str]:
        """List the lines of a run, from its first to this one."""
        lines = [self.of_runs[run]]
        line = self.before
        while line is not None:
            lines.append(line.of_runs[run])
            line = line.before
        return lines[::-1]


class ProgramState(NamedTuple):
    """Lines that the programs were sent, and the last estimates: mean (n, M) and cov (n, n, M)."""

    hello: str
    line: _Line | None
    mean: Array
    cov: Array


class ProgramRunError(WrongReturnError):
    """A program failed in a run, counted from 0, at a step."""

    def __init__(self, run: int, step: int, what: str) -> None:
        super().__init__("step", f"run {run}, step {step}: {what}")
        self.run, self.step, self.what = run, step, what

    def after(self, runs: int) -> "ProgramRunError":
        """Count the run from the first of the experiment, of which its block begins at ``runs``."""
        return ProgramRunError(runs + self.run, self.step, self.what)


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
    """further files on which the estimates depend, such as the program's source"""

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
            what = f"{self.command[0]} is not a program that can be executed"
            raise InvalidKeyError(what, "command", 0)
        for i, file in enumerate(self.files):
            try:
                require_regular_file(file)
            except OSError as error:
                raise InvalidKeyError(f"{file}: {error.strerror}", "files", i) from None
        # What was read makes the numbers: the program may be built anew before it runs.
        object.__setattr__(self, "_content", self.digests())

    def digests(self) -> tuple[tuple[str, str], ...]:
        """Digest the words of the command and the files as they are now."""
        return tuple((word, _digest(word)) for word in (*self.command, *self.files))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, External) and self._identity == other._identity

    def __hash__(self) -> int:
        return hash(self._identity)

    @property
    def _identity(self) -> tuple[object, ...]:
        return (*field_values(self).values(), self.__dict__["_content"])

    @property
    def contents(self) -> dict[str, str]:
        """Digests of the command's words and the files, as they were when the config was read."""
        return dict(self.__dict__["_content"])

    def cautions(self, scenario: Scene) -> list[str]:
        """Note how far its numbers are reproducible."""
        return ["the numbers of an external program are the same on the same machine only"]

    def init(self, model: Model, prior: Distribution, rng: Generator) -> ProgramState:
        """Begin each run with the moments of its prior."""
        prior, lines = per_run_moments(Gaussian(prior.mean, prior.cov)), []
        for run, seed in enumerate(run_seeds(rng, prior.mean.shape[1])):
            moments = [prior.mean[:, run], prior.cov[..., run].ravel()]
            lines.append(f"init {seed} 0 {_fields(np.concatenate(moments))}")
        nothing = np.full((len(prior.mean), len(lines)), np.nan)
        before = ProgramState(self._hello(model), None, nothing, nothing[None])
        first = _Line(lines, 0, 0.0, None)
        mean, cov = self._answers(before, [first])
        return ProgramState(before.hello, first, mean[:, 0], cov[:, :, 0])

    def step(
        self, model: Model, state: ProgramState, z: Array, k: int, rng: Generator
    ) -> ProgramState:
        """Send the measurements of one step."""
        after: ProgramState = self.all_steps(model, state, z[:, None], k).state(0)
        return after

    def all_steps(self, model: Model, state: ProgramState, z: Array, k: int) -> Steps:
        """Send the measurements of all steps, run after run."""
        assert state.line is not None
        lines = [*_step_lines(model, state.line, z, k)]
        mean, cov = self._answers(state, lines)

        def at(i: int) -> ProgramState:
            return ProgramState(state.hello, lines[i], mean[:, i], cov[:, :, i])

        return Steps(Gaussian(mean, cov), {}, at)

    def estimate(self, state: ProgramState) -> Gaussian:
        """Give the programs' last answers."""
        return Gaussian(state.mean, state.cov)

    def _answers(self, state: ProgramState, lines: Sequence[_Line]) -> tuple[Array, Array]:
        """Collect the estimates of all runs after each line: mean (n, T, M), covariance (n, n, T, M)."""
        runs, n, pool = len(lines[0].of_runs), len(state.mean), _pool(self, state.hello)
        mean = np.empty((n, len(lines), runs))
        cov = np.full((n, n, len(lines), runs), np.nan)
        for run in range(runs):
            try:
                answers, past = pool.of_run(run, state.line).answers(state.line, lines, run)
                numbers = _numbers(answers, n)
                if past:
                    _compare(_numbers(past[-1:], n)[0], state, run)
            except ProgramError as error:
                pool.kill()
                raise ProgramRunError(run, lines[0].number + error.answered, str(error)) from None
            mean[:, :, run] = numbers[:, :n].T
            if numbers.shape[1] > n:
                cov[..., run] = numbers[:, n:].T.reshape(n, n, -1)
        if pool.stamps != _stamps(self):
            raise ProgramRunError(0, lines[0].number, "the program or its files changed meanwhile")
        return mean, cov

    def _hello(self, model: Model) -> str:
        motion, sensor = model
        facts: dict[str, object] = {
            "components": motion.components,
            "measurement": sensor.components,
            "T": getattr(motion, "T", None),
            "parameters": self.parameters,
            "model": None,
        }
        # R of any other sensor may differ from step to step.
        H = getattr(sensor, "H", None) if isinstance(sensor, SensorBase | StackedSensor) else None
        if isinstance(motion, Linear) and H is not None:
            n = len(motion.F)
            R = sensor.measurement(np.zeros((n, 1)), 1).cov.reshape(len(sensor.components), -1)
            matrices = {"F": motion.F, "Q": motion.Q, "H": H(n), "R": R}
            facts["model"] = {name: matrix.tolist() for name, matrix in matrices.items()}
        return f"trackbench {PROTOCOL} {json.dumps(facts)}"


def _digest(word: str) -> str:
    """Digest a file, a program that is found on the PATH, or a word that is neither."""
    path = Path(shutil.which(word) or word)
    try:
        content = path.read_bytes() if path.is_file() else word.encode()
    except OSError as error:
        raise InvalidKeyError(f"{word}: {error.strerror}") from None
    return hashlib.sha256(content).hexdigest()


def _step_lines(model: Model, before: _Line, z: Array, k: int) -> Iterator[_Line]:
    """Yield the lines of steps k, k + 1, ... with their times; z is (n_z, T, M).

    Angles are sent in (-pi, pi], also recorded ones and those that noise carried over the cut.
    """
    z = z.copy()
    for row in measured_angle_rows(model.sensor):
        z[row] = wrap_angle(z[row])
    for i in range(z.shape[1]):
        number, length = before.number + 1, step_length(model, k + i)
        # A product has no rounding error that grows from step to step.
        time = number * length if hasattr(model.motion, "T") else before.time + length
        fields = (_fields(column) for column in z[:, i].T)
        before = _Line([f"step {time:.17g} {row}" for row in fields], number, time, before)
        yield before


def _fields(values: Array) -> str:
    return " ".join(f"{value:.17g}" for value in values.tolist())


def _numbers(answers: Sequence[str], n: int) -> Array:
    """Read the numbers of the answers (T, n) or (T, n + n^2); raises ProgramError at a wrong answer."""
    size = len(answers[0].split())
    for i, answer in enumerate(answers):
        fields = answer.split()
        if len(fields) != size or size not in (n, n + n * n):
            sizes = f"{n} of a mean, or {n + n * n} of a mean and a covariance"
            raise ProgramError(f"the program answers {len(fields)} numbers, not {sizes}", i)
    try:
        numbers = np.array(" ".join(answers).split(), dtype=np.float64).reshape(-1, size)
    except ValueError:
        i, word = next(_words(answers))
        raise ProgramError(f"the program answers {word[:60]!r}, which is no number", i) from None
    if size > n:
        P = numbers[:, n:].reshape(-1, n, n)
        sd = np.sqrt(np.abs(np.diagonal(P, axis1=1, axis2=2)))
        limit = _ASYMMETRY * sd[:, :, None] * sd[:, None]
        asymmetric = (np.abs(P - P.swapaxes(1, 2)) > limit).any(axis=(1, 2))
        if asymmetric.any():
            what = "the program answers a covariance that is not symmetric"
            raise ProgramError(what, int(asymmetric.argmax()))
    return numbers


def _compare(again: Array, state: ProgramState, run: int) -> None:
    """Raise ProgramError unless a run that began again has the estimate of before."""
    n = len(state.mean)
    cov = np.full((n, n), np.nan) if len(again) == n else again[n:].reshape(n, n)
    known = (state.mean[:, run], state.cov[:, :, run])
    for a, b in zip(known, (again[:n], cov), strict=True):
        if not np.array_equal(a, b, equal_nan=True):
            what = "a run that begins again has other estimates: "
            raise ProgramError(f"{what}does `init` set all of the state, and SEED all noise?", -1)


def _stamps(tracker: External) -> list[tuple[int, ...]]:
    """Note times and sizes of the files of a program, to notice a change while it runs."""
    paths = (Path(shutil.which(word) or word) for word in (*tracker.command, *tracker.files))
    stats = [path.stat() for path in paths if path.is_file()]
    return [(stat.st_ino, stat.st_size, stat.st_mtime_ns) for stat in stats]


def _words(answers: Sequence[str]) -> Iterator[tuple[int, str]]:
    """Yield the fields that are no numbers, each with the index of its answer."""
    for i, answer in enumerate(answers):
        for word in answer.split():
            try:
                np.array([word], dtype=np.float64)
            except ValueError:
                yield i, word


class _Copy:
    """A running program, and the line and run that it was sent last."""

    def __init__(self, program: Program) -> None:
        self.program = program
        self.at: tuple[_Line | None, int] = (None, -1)

    def answers(
        self, before: _Line | None, lines: Sequence[_Line], run: int
    ) -> tuple[list[str], list[str]]:
        """Send a run's lines, which follow the line ``before``, and return the answers.

        Those to earlier lines of the run, if it began again, come second.
        """
        past: list[str] = []
        if before is not None and self.at != (before, run):
            past = before.of_run(run)
        try:
            answers = self.program.exchange(past + [line.of_runs[run] for line in lines])
        except ProgramError as error:
            error.answered -= len(past)
            raise
        self.at = (lines[-1], run)
        return answers[len(past) :], answers[: len(past)]


class _Pool:
    """Programs of one filter, started when they are needed."""

    def __init__(self, tracker: External, hello: str) -> None:
        self._tracker, self._hello = tracker, hello
        self._copies: dict[int, _Copy] = {}
        self.stamps = _stamps(tracker)

    def of_run(self, run: int, before: _Line | None) -> _Copy:
        """Choose the program that goes on with a run: one that is there, or begins the run again."""
        for copy in self._copies.values():
            if copy.at == (before, run):
                return copy
        tracker, is_short = self._tracker, before is None or before.number < _SHORT
        number = 0 if is_short else run % tracker.copies
        if number not in self._copies:
            for word, digest in tracker.digests():
                if digest != tracker.contents[word]:
                    raise ProgramError(f"{word} is not as it was when the run began")
            program = Program(tracker.command, self._hello, tracker.timeout)
            self._copies[number] = _Copy(program)
        return self._copies[number]

    def kill(self) -> None:
        """Kill all programs, after one of them gave a wrong answer or none."""
        for copy in self._copies.values():
            copy.program.kill()
        self._copies = {}

    def end(self) -> None:
        """End all programs."""
        end_programs(copy.program for copy in self._copies.values())


_pools: OrderedDict[tuple[int, External, str], _Pool] = OrderedDict()


def _pool(tracker: External, hello: str) -> _Pool:
    """Look up the programs of a filter in this thread; end those that were used longest ago."""
    key = threading.get_ident(), tracker, hello
    if key in _pools and _pools[key].stamps != _stamps(tracker):
        _pools.pop(key).end()  # the program may have been built again
    if key not in _pools:
        mine = [other for other in _pools if other[0] == key[0]]
        if len(mine) >= _POOLS:
            _pools.pop(mine[0]).end()
        _pools[key] = _Pool(tracker, hello)
    _pools.move_to_end(key)
    return _pools[key]
