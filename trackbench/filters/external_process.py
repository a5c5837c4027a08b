"""Programs that speak a protocol of lines: start them, exchange lines, and leave none behind.

Answers are read while lines are still being written, so that a program that works through many steps
waits for nothing. A program has a process group of its own and is killed with all of it; a guard, a
shell that waits for this process to end, does so even if this process is killed.
"""

import os
import selectors
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import OrderedDict
from collections.abc import Iterable, Sequence
from contextlib import suppress
from multiprocessing.util import Finalize
from typing import IO, Protocol, cast

from trackbench.crash_signals import fault_of_signal, signal_name
from trackbench.filters.external_files import stamps
from trackbench.filters.external_lines import PROTOCOL, Line

_MOST_REPEATED = 100  # steps that a program repeats, in place of another program
_POOLS = 4  # filters whose programs stay ready in a thread
_CHUNK = 1 << 16  # bytes that are written or read at once
_LONGEST = 1 << 20  # bytes of an answer
_KEPT_ERRORS = 1 << 16  # bytes, the last ones that a program writes on stderr
_LONGEST_REASON = 500  # characters of a reason that a program gives
_END_S = 2.0
"""Seconds that programs may take to end after the line ``end``."""
NO_FIRST_ANSWER = "the program does not answer the first line"
"""Beginning of the message on a program that does not speak the protocol."""
_ANSWERS = "`ready`, or `error TEXT` if it does not fit the problem"
_PAGE = "docs/any-language.md"
_GUARD = ("sh", "-c", 'read line; kill -9 "-$1"', "guard")
"""Command that waits for the end of its input, and kills a process group."""


class ProgramError(Exception):
    """A program broke the protocol, after it gave ``answered`` of the answers that it owes.

    ``last_words`` is the last line that it wrote on stderr, as a text after the message.
    """

    def __init__(self, message: str, answered: int = 0, last_words: str = "") -> None:
        super().__init__(f"{message}{last_words}")
        self.answered = answered
        self.last_words = last_words


class LateAnswerError(ProgramError):
    """A program gave no answer within its time."""


class NoFirstAnswerError(ProgramError):
    """A program gave no answer to its first line within its time: it does not speak the protocol."""


class RefusalError(ProgramError):
    """A program answered ``error`` to its first line, and perhaps a reason."""

    def __init__(self, reason: str) -> None:
        super().__init__(f"the program refuses this problem: {reason}")


class Program:
    """A running program that answers each line with one line."""

    def __init__(self, command: Sequence[str], hello: str, timeout: float) -> None:
        """Start the program, and wait until it answers the line ``hello`` with ``ready``.

        An answer may take ``timeout`` seconds. Raises NoFirstAnswerError if there is none in this time,
        RefusalError if the program refuses the problem, and ProgramError for another answer.
        """
        self._timeout = timeout
        self._start_s = 0.0  # CPU seconds that the program spent until it was ready
        self._last_s = 0.0  # last reading of the program's clock, which ends with the program
        self._error_lines: list[str] = []
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115 (closed with the program)
        try:
            self._process = subprocess.Popen(
                [*command],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._errors,
                bufsize=0,
                start_new_session=True,
            )
        except OSError as error:
            self._errors.close()
            raise ProgramError(f"{command[0]} cannot be started: {error.strerror}") from None
        # The guard kills the program's process group when its input ends, as at the end of this process.
        self._guard = subprocess.Popen(
            [*_GUARD, str(self._process.pid)], stdin=subprocess.PIPE, start_new_session=True
        )
        self._stdin = cast(IO[bytes], self._process.stdin)
        self._stdout = cast(IO[bytes], self._process.stdout)
        os.set_blocking(self._stdin.fileno(), False)
        os.set_blocking(self._stdout.fileno(), False)
        _running.add(self)
        try:
            first_answer = self.exchange([hello])[0]
        except LateAnswerError as error:
            message = (
                f"{NO_FIRST_ANSWER}, `trackbench {PROTOCOL} {{JSON}}`, within {timeout:g} s; "
                f"print {_ANSWERS}, and flush the output ({_PAGE}); a program that starts slowly "
                "needs a larger `timeout`"
            )
            raise NoFirstAnswerError(f"{message}{error.last_words}") from None
        # A line may end as on Windows, or in spaces.
        word, _, text = first_answer.strip().partition(" ")
        if word == "error":
            self.kill()
            raise RefusalError(shown_reason(text))
        if word != "ready" or text:
            answer = _shorten(f"{word} {text}")
            message = f"answers {answer} at its start, not `ready`; print {_ANSWERS} ({_PAGE})"
            raise self._broken(message, 0)
        self._start_s = self._clock()

    def exchange(self, lines: Sequence[str]) -> list[str]:
        """Send lines and return the answers, one for each line.

        Parameters
        ----------
        lines : sequence of str
            Lines without line breaks.

        Returns
        -------
        list of str
            Answers in the order of the lines.

        Raises
        ------
        LateAnswerError
            If the program gives no answer within its time.
        ProgramError
            If the program ends, or answers a line by none, by several or by one that does not end.
        """
        # Nothing is owed before the lines are sent.
        with suppress(BlockingIOError):
            surplus = os.read(self._stdout.fileno(), _CHUNK)
            if surplus:
                text = surplus.decode(errors="replace")
                raise self._broken(f"answers more than one line: {_shorten(text)}", 0)
        # Write what the program takes, and read what it answers, until every line has its answer.
        waiting = memoryview("".join(f"{line}\n" for line in lines).encode())
        received = list[bytes]()
        answered = 0
        unfinished = 0
        deadline = time.monotonic() + self._timeout
        with selectors.DefaultSelector() as selector:
            selector.register(self._stdout, selectors.EVENT_READ)
            selector.register(self._stdin, selectors.EVENT_WRITE)
            while answered < len(lines):
                ready = selector.select(max(0.0, deadline - time.monotonic()))
                if not ready:
                    self.kill()
                    message = f"the program gave no answer within {self._timeout:g} s"
                    raise LateAnswerError(message, answered, self._last_words())
                for key, _ in ready:
                    if key.fileobj is self._stdin:
                        written = self._write(waiting, received)
                        waiting = waiting[written:]
                        if not waiting:
                            selector.unregister(self._stdin)
                        continue
                    data = os.read(self._stdout.fileno(), _CHUNK)
                    if not data:
                        raise self._ended(received)
                    received.append(data)
                    answered += data.count(b"\n")
                    unfinished += len(data)
                    if b"\n" in data:
                        deadline = time.monotonic() + self._timeout
                        unfinished = 0
                    if unfinished > _LONGEST:
                        raise self._broken("answers a line that does not end", answered)
        # The rest is what stands after the newline of the last answer.
        whole = b"".join(received).decode(errors="replace")
        *answers, rest = whole.split("\n", len(lines))
        for i, answer in enumerate(answers):
            if not answer.strip():
                raise self._broken("answers an empty line", i)
        if rest:
            first = _shorten(answers[-1])
            failure = f"answers more than one line: {first} and then {_shorten(rest)}"
            raise self._broken(failure, len(lines) - 1)
        return answers

    def _write(self, waiting: memoryview, received: Sequence[bytes]) -> int:
        """Write as much of ``waiting`` as the program takes now; return the number of bytes.

        ``received`` is what it has answered so far, for the error if the program has ended.
        """
        try:
            return os.write(self._stdin.fileno(), waiting[:_CHUNK])
        except BlockingIOError:
            return 0
        except BrokenPipeError:
            raise self._ended(received) from None

    def _ended(self, received: Sequence[bytes]) -> ProgramError:
        """Return the error of a program that has ended: its own, if its last answer is ``error TEXT``.

        ``received`` is what it has answered so far.
        """
        pieces = [*received]
        with suppress(BlockingIOError):
            while rest := os.read(self._stdout.fileno(), _CHUNK):
                pieces.append(rest)
        *answers, rest_of_line = b"".join(pieces).decode(errors="replace").split("\n")
        last_answer = rest_of_line or (answers[-1] if answers else "")
        word, _, text = last_answer.strip().partition(" ")
        if word != "error":
            return self._broken(self._describe_end(), len(answers))
        # The step of the error has no answer, whether its line was finished or not.
        answered = len(answers) if rest_of_line else len(answers) - 1
        return self._broken(f"reports an error: {shown_reason(text)}", answered)

    def _describe_end(self) -> str:
        """Return how the program ended, or that it closed its output if it still runs."""
        with suppress(subprocess.TimeoutExpired):
            code = self._process.wait(_END_S)
            if code < 0:
                text = f"was ended by the signal {signal_name(-code)}"
                if fault_of_signal(-code):
                    return f"{text}, {fault_of_signal(-code)}"
                if -code == signal.SIGKILL:  # as the kernel sends it when memory runs out
                    return f"{text}; was memory short?"
                return text
            return f"ended with code {code}"
        return "closed its output"

    def _broken(self, failure: str, answered: int) -> ProgramError:
        """Kill the program; return the error, with the last line of the program's errors."""
        self.kill()
        return ProgramError(f"the program {failure}", answered, self._last_words())

    def _last_words(self) -> str:
        """Return the last line of the program's errors, as a text after a message; empty without one."""
        if not self._error_lines:
            return ""
        return f"; its last line on stderr: {_shorten(self._error_lines[-1])}"

    def _clock(self) -> float:
        """Return the CPU seconds of the program, those read last if it has ended; 0 outside of Linux."""
        with suppress(OSError):
            # The kernel's clock of another process: clock_getcpuclockid(3).
            # The number of a process that was waited for may belong to another one.
            if sys.platform == "linux" and self._process.returncode is None:
                self._last_s = time.clock_gettime((~self._process.pid << 3) | 2)
        return self._last_s

    @property
    def cpu_s(self) -> float:
        """CPU seconds that the program has spent since it was ready."""
        return max(0.0, self._clock() - self._start_s)

    @property
    def is_running(self) -> bool:
        """True until the program is ended or killed from here."""
        return self in _running

    def ask_to_end(self) -> None:
        """Send ``end``, and close the program's input."""
        self._clock()  # its CPU seconds are stored, as they cannot be read after its end
        with suppress(OSError, ValueError):  # it may have ended, or been killed
            os.write(self._stdin.fileno(), b"end\n")
            self._stdin.close()

    def wait(self, seconds: float) -> None:
        """Wait until the program has ended, but no longer than ``seconds``."""
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(max(0.0, seconds))

    def kill(self) -> None:
        """Kill the program with all that it started, and keep the last lines that it wrote on stderr."""
        if not self.is_running:
            return  # its CPU seconds count once
        _running.discard(self)
        _ended_s.append(self.cpu_s)  # for `programs_cpu_s`
        # The guard is the shell that would kill the program's process group if this process ended.
        self._guard.kill()
        self._guard.communicate()
        with suppress(OSError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        self._stdin.close()
        self._stdout.close()
        if not self._errors.closed:
            size = self._errors.seek(0, os.SEEK_END)
            self._errors.seek(max(0, size - _KEPT_ERRORS))
            text = self._errors.read(_KEPT_ERRORS).decode(errors="replace")
            self._error_lines = [line for line in text.splitlines() if line.strip()]
            self._errors.close()


class ProgramCopy:
    """A running program, and the line and run that it was sent last."""

    def __init__(self, program: Program) -> None:
        self.program = program
        self.last_sent: tuple[Line | None, int] = (None, -1)  # nothing but the first line

    def exchange(
        self, before: Line | None, lines: Sequence[Line], run: int
    ) -> tuple[list[str], list[str]]:
        """Send new lines of a run to the program, and the earlier ones first if it needs them.

        If the program was last sent another line, or a line of another run, its state is that of other
        measurements. The run then begins anew: all its lines up to ``before`` are sent first. The first
        of them, ``init``, resets the program.

        Parameters
        ----------
        before : Line or None
            Line that the new ones follow; None if the first of these is ``init``.
        lines : sequence of Line
            New lines, one or more.
        run : int
            Index of the run in its block.

        Returns
        -------
        answers : list of str
            Answers to the new lines.
        repeated : list of str
            Answers to the lines that were sent again; empty if there are none.

        Raises
        ------
        ProgramError
            If the program fails. Its `answered` counts from the first new line, and is negative at a
            line that was sent again.
        """
        earlier: list[str] = []
        if before is not None and self.last_sent != (before, run):
            earlier = before.lines_from_start(run)
        new = [line.text_by_run[run] for line in lines]
        try:
            answers = self.program.exchange(earlier + new)
        except ProgramError as error:
            # Count from the first new line; negative at a line that was sent again.
            error.answered -= len(earlier)
            raise
        self.last_sent = (lines[-1], run)
        return answers[len(earlier) :], answers[: len(earlier)]

    def begin_again(self, init: Line, run: int) -> list[str]:
        """Send the line ``init`` of a run, and return the answer."""
        answers = self.program.exchange([init.text_by_run[run]])
        self.last_sent = (init, run)
        return answers


_running: set[Program] = set()
_ended_s: list[float] = []


def programs_cpu_s() -> float:
    """Return the CPU seconds of this process's programs, from when each was ready."""
    return sum(_ended_s) + sum(program.cpu_s for program in [*_running])


def end_programs(programs: Iterable[Program]) -> None:
    """Ask the programs to end, and kill those that still run after `_END_S` seconds.

    Parameters
    ----------
    programs : iterable of Program
        Programs, of which some may have ended.
    """
    programs = [*programs]
    for program in programs:
        program.ask_to_end()
    deadline = time.monotonic() + _END_S
    for program in programs:
        program.wait(deadline - time.monotonic())
        program.kill()


def end_all() -> None:
    """End all programs of this process."""
    end_programs(_running)


Finalize(None, end_all, exitpriority=0)  # at the end of this process, a worker's included


def shown_reason(text: str) -> str:
    """Return the reason after the word ``error`` of an answer, in one line."""
    return _cut(text, _LONGEST_REASON) if text.strip() else "without a reason"


def _shorten(text: str) -> str:
    """Return the text cut to 80 characters, in quotes."""
    return repr(_cut(text, 80))


def _cut(text: str, most: int) -> str:
    """Return the text in one line, cut to at most ``most`` characters."""
    text = " ".join(text.split())
    return text if len(text) <= most else f"{text[: most - 3]}..."


class ProgramFilter(Protocol):
    """Keys of a filter by which its programs are started."""

    @property
    def command(self) -> tuple[str, ...]:
        """The program and its arguments."""

    @property
    def timeout(self) -> float:
        """Seconds that an answer may take."""

    @property
    def files(self) -> tuple[str, ...]:
        """Further files and folders of the program."""

    @property
    def copies(self) -> int:
        """Programs that may run side by side."""

    def digests(self) -> tuple[tuple[str, str], ...]:
        """Return each word of the command, file and variable with the digest of what it is now."""

    @property
    def stored_digests(self) -> tuple[tuple[str, str], ...]:
        """Words with their digests, as they were when the config was read."""


class ProgramPool:
    """Programs of one filter, started when they are needed."""

    def __init__(self, tracker: ProgramFilter, hello: str) -> None:
        """Start with no program; ``hello`` is the first line that each one will be sent."""
        self._tracker = tracker
        self._hello = hello
        self._copies: dict[int, ProgramCopy] = {}
        self.stamps = stamps(tracker.command, tracker.files)

    def program_of_run(self, run: int, before: Line | None) -> ProgramCopy:
        """Return the program that goes on with a run.

        It is the program that was sent the run's last line last. If there is none, another program
        begins the run anew. Runs of which few steps are done share one program, as beginning them anew
        is fast.

        Parameters
        ----------
        run : int
            Index of the run in its block.
        before : Line or None
            Last line of the run so far; None before ``init``.

        Returns
        -------
        ProgramCopy
            Program that is ready for the next lines.

        Raises
        ------
        ProgramError
            If a word of the command, a file or a variable has changed since the config was read. Also if
            a new program does not start, or refuses the problem.
        """
        # All programs of this process may have been ended meanwhile.
        self._copies = {i: copy for i, copy in self._copies.items() if copy.program.is_running}
        for copy in self._copies.values():
            if copy.last_sent == (before, run):
                return copy
        tracker = self._tracker
        is_near_start = before is None or before.number < _MOST_REPEATED
        slot = 0 if is_near_start else run % tracker.copies
        if slot not in self._copies:
            # In pairs, as one word may stand in the command and among the files, with two digests.
            for (word, digest), stored in zip(
                tracker.digests(), tracker.stored_digests, strict=True
            ):
                if (word, digest) != stored:
                    raise ProgramError(f"{word} is not as it was when the run began")
            program = Program(tracker.command, self._hello, tracker.timeout)
            self._copies[slot] = ProgramCopy(program)
        return self._copies[slot]

    def kill(self) -> None:
        """Kill all programs, after one of them gave a wrong answer or none."""
        for copy in self._copies.values():
            copy.program.kill()
        self._copies = {}

    def end(self) -> None:
        """End all programs."""
        end_programs(copy.program for copy in self._copies.values())


_pools: OrderedDict[tuple[int, ProgramFilter, str], ProgramPool] = OrderedDict()


def pool_of(tracker: ProgramFilter, hello: str) -> ProgramPool:
    """Return the programs of a filter in this thread, which stay ready for its next block.

    If a thread has more than `_POOLS` sets of programs, those that were used longest ago are ended.

    Parameters
    ----------
    tracker : ProgramFilter
        Filter with the keys of its programs.
    hello : str
        First line that the programs are sent, with the problem in it: a filter on two problems has two
        sets of programs.

    Returns
    -------
    ProgramPool
        Programs of the filter. The set is a new one if the program or its files have changed.
    """
    key = (threading.get_ident(), tracker, hello)
    if key in _pools and _pools[key].stamps != stamps(tracker.command, tracker.files):
        _pools.pop(key).end()  # the program may have been built again
    if key not in _pools:
        keys_of_thread = [other for other in _pools if other[0] == key[0]]
        if len(keys_of_thread) >= _POOLS:
            _pools.pop(keys_of_thread[0]).end()
        _pools[key] = ProgramPool(tracker, hello)
    _pools.move_to_end(key)
    return _pools[key]
