"""Expected time of a suite: from recorded times, and by trials of the user's own filters."""

import time
from collections.abc import Mapping, Sequence
from math import isfinite

from trackbench.commands.expected_time import (
    CACHED,
    cpu_s_of_filter,
    expected_time,
    trials_per_run,
)
from trackbench.commands.prepare_jobs import Job
from trackbench.commands.run_options import Options, most_workers
from trackbench.config.filters_that_fit import shown_label
from trackbench.config.shipped_suites import SuiteTime
from trackbench.config.suite_problem_configs import FittedProblem
from trackbench.durations import expected_time_in_words
from trackbench.report.findings.phrases import joined

_TRIALS_S = 10.0
"""Seconds after which the user's own filters are not tried on further problems."""
_REPORT_S = 1.3
"""CPU seconds that simulation, errors, tables and figures of a problem take beside the filters."""


class ExpectedTimesOfSuite:
    """Expected times of the problems of a suite, and of all of them together.

    Problems of a shipped suite have ``recorded`` times, by name, of the filters that are shipped. To
    these the times of the user's filters with the labels ``added`` are added, by a trial of their first
    steps. ``is_quick`` is true with `--quick`.
    """

    def __init__(
        self,
        recorded: Mapping[str, Sequence[SuiteTime]],
        added: Sequence[str],
        options: Options,
        is_quick: bool,
    ) -> None:
        """Begin with no problem; ``recorded`` has one or two times of each problem, by its name.

        The first time is that of a suite with `--quick`, the last that of a whole suite. ``added`` are
        the labels of the user's own filters (`--filter`), which have no recorded times.
        """
        self._recorded = recorded
        self._added = added
        self._options = options
        self._is_quick = is_quick
        self._workers = most_workers(options)
        self._own = _OwnTimes(added, options)  # estimates by trials
        self._seconds = 0.0
        """time of the problems so far on all workers, with tables and figures"""

    def of_problem(self, problem: FittedProblem, job: Job) -> str:
        """Write how long a problem will take, in words, and add its time to that of all problems.

        ``job`` is the problem's experiment with its plan. A problem without a recorded time is not
        added.
        """
        times = self._recorded.get(problem.name)
        # Without recorded times all filters are timed by a trial. With them, only the user's own are.
        time_text = expected_time(job, self._options, tries=times is None)
        if times is None or time_text == CACHED:
            return time_text
        runs = job.experiment.settings.runs
        # Without --quick the filters of the suite are tuned with as many trials, whatever the runs.
        is_tuned_in_full = bool(problem.tuned) and not self._is_quick
        seconds = _recorded_seconds(times, runs, is_tuned_in_full) / self._workers
        seconds += self._own.seconds(problem, job) / self._workers
        self._seconds += seconds + _REPORT_S / self._workers
        return f"about {expected_time_in_words(seconds)} of filtering"

    def of_all_problems(self) -> str:
        """Write how long all problems will take, and on which of the user's filters this is not sure.

        These are the filters without a time on some problem, which the sum leaves out. Otherwise they
        are all of the user's filters, whose times are from trials. The text is empty if no problem has a
        recorded time and blocks to compute.
        """
        if not self._seconds:
            return ""
        time_text = expected_time_in_words(self._seconds)
        line = f"in all about {time_text} on {self._workers} workers, with tables and figures"
        if self._own.unknown:
            line += f", and without {joined(self._own.unknown)}"
        elif self._added:
            line += f"; {joined(self._added)} by a trial of the first steps"
        return line


class _OwnTimes:
    """CPU times of the user's own filters on the problems of a suite, from trials."""

    def __init__(self, labels: Sequence[str], options: Options) -> None:
        """Begin with no trial of the filters ``labels``; the time for trials runs from now on."""
        self._labels = labels
        self._options = options
        self._started = time.monotonic()
        self._tried: dict[str, tuple[float, float]] = dict.fromkeys(labels, (0.0, 0.0))
        """CPU seconds and size of the work, of each filter on the problems that it was tried on"""
        self.unknown: list[str] = []
        """filters that have no time on some problem"""

    def seconds(self, problem: FittedProblem, job: Job) -> float:
        """Return the CPU seconds of all of the user's filters on a problem, as far as they are known.

        Each filter is timed over its first steps. Once `_TRIALS_S` seconds are over, its pace on earlier
        problems is used instead: seconds per run and step. The trials of tuning count, too. Labels of
        filters without a time are added to ``unknown``.
        """
        total = 0.0
        for label in self._labels:
            if label in problem.left_out:
                continue
            tries = time.monotonic() - self._started < _TRIALS_S
            # The size is the number of runs times steps.
            seconds, size = cpu_s_of_filter(job, label, self._options, tries)
            known_seconds, known_size = self._tried[label]
            if isfinite(seconds):
                self._tried[label] = (known_seconds + seconds, known_size + size)
            elif not tries and known_size:
                seconds = known_seconds * size / known_size
            else:
                self.unknown = [*dict.fromkeys([*self.unknown, label])]
                continue
            # The results have a tuned filter beside the original one, under a label of its own. Both are
            # run after the trials, whose work is a multiple of that of these runs.
            is_tuned = shown_label(problem, label) != label
            if is_tuned:
                seconds *= 2.0 + trials_per_run(job)
            total += seconds
        return total


def _recorded_seconds(times: Sequence[SuiteTime], runs: int, is_tuned_in_full: bool) -> float:
    """Return the CPU seconds of a problem for so many runs, on a line through two recorded times.

    There are one or two ``times``, that of `--quick` and that of all runs of the suite. The line does
    not go through zero: a step of a few runs takes hardly less time than one of many. With
    ``is_tuned_in_full`` fewer runs save nothing, as tuning has the same number of trials.
    """
    last = times[-1]
    # One time, or more runs than recorded: in proportion to the runs.
    if len(times) == 1 or runs > last.runs:
        return last.cpu_s * runs / last.runs
    if is_tuned_in_full:
        return last.cpu_s
    first = times[0]
    slope = (last.cpu_s - first.cpu_s) / (last.runs - first.runs)
    return max(first.cpu_s + slope * (runs - first.runs), 0.0)
