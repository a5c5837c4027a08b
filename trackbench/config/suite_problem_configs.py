"""Configs of a suite's problems: each a scenario of an experiment, with the roster as its filters."""

import copy
from dataclasses import dataclass
from pathlib import Path

from trackbench.config.added_filters import add_filters
from trackbench.config.experiment import Experiment
from trackbench.config.includes import deep_merge, inline_parts
from trackbench.config.overrides import assignment, check_single_value, override, split_path
from trackbench.config.quick_run import QUICK, QUICK_RUNS_OF_PROBLEM, QUICK_TUNING
from trackbench.config.shipped_experiments import located
from trackbench.config.suite_keys import SuiteProblem, SuiteSettings
from trackbench.errors import Mark, Problem, UserError
from trackbench.yaml_source import Assembled, Keys, MarkedMapping, Source, dotted, marked, put, read

_COPIED = ("title", "paper", "seed", "scenario", "hold_out")
"""Keys of a problem's experiment that the suite uses."""


@dataclass(frozen=True)
class AssembledProblem:
    """Experiment of a problem with the whole roster, before the roster is fitted."""

    name: str
    group: str
    settings: SuiteProblem
    config: Assembled
    added: dict[str, Mark]
    """labels of the user's filters"""
    override_paths: dict[str, str]
    """path of the key of a user's filter that an assignment ``PATH=VALUE`` sets, by the assignment"""


@dataclass(frozen=True, kw_only=True)
class Assembler:
    """Put the experiments of a suite's problems together."""

    suite: Source
    home: Path
    """folder of the suite's file"""
    settings: SuiteSettings
    filter_files: tuple[Path, ...]
    filter_overrides: tuple[str, ...]
    """assignments of keys of the user's own filters"""
    quick: bool
    runs: int | None
    """number of runs that the user asks for"""

    def assemble(self, group_name: str, name: str) -> AssembledProblem:
        """Put a problem's experiment together: its scenario, and the roster in place of its filters."""
        keys = ("groups", group_name, "problems", name)
        group = self.settings.groups[group_name]
        problem = group.problems[name]
        # Step 1: the experiment, with the problem's changes.
        file = self._experiment_file(problem, name, (*keys, "use"))
        experiment = read(file)
        _include_parts(experiment, file.parent)
        for path_text, value in problem.set.items():
            mark = self.suite.mark((*keys, "set", path_text))
            override(experiment, split_path(experiment, path_text), value, mark)
        # Step 2: a config with its scenario, the roster, and the user's own filters with their keys.
        mark = self.suite.mark(keys)
        data = self._scenario_and_runs(experiment, file, problem, name, keys)
        self._put_roster(data, experiment, file, group_name, name, keys)
        self._put_tuning(data, group_name, name)
        source = Source(data, mark)
        added = add_filters(source, self.filter_files)
        texts_by_keys: dict[Keys, str] = {}
        for text in self.filter_overrides:
            filter_keys, value, mark_of_option = assignment(source, text)
            # Also adds the text to `texts_by_keys`.
            check_single_value(texts_by_keys, filter_keys, text, mark_of_option)
            label = filter_keys[1]  # of filters.LABEL.KEY
            if label not in added:
                message = (
                    f"no filter of --filter is called {label!r}; the rosters are "
                    "`groups.GROUP.filters`"
                )
                raise UserError(Problem(mark_of_option, dotted(filter_keys), message))
            override(source, filter_keys, value, mark_of_option)
        # The user's own files may run as plugins or programs, even without --allow-plugins.
        config = Assembled(source=source, allowed=self.filter_files)
        return AssembledProblem(
            name=name,
            group=group_name,
            settings=problem,
            config=config,
            added=added,
            override_paths={text: dotted(path) for path, text in texts_by_keys.items()},
        )

    def _experiment_file(self, problem: SuiteProblem, name: str, keys: Keys) -> Path:
        """Find the experiment file of a problem: beside the suite, or shipped."""
        word = problem.use or name
        if word.endswith((".yaml", ".yml")):
            return self.home / word
        try:
            return located(Path(word), lambda line: None)  # nothing is printed
        except UserError as error:
            message = "; ".join(
                p.message if isinstance(p, Problem) else str(p) for p in error.problems
            )
            mark = self.suite.mark(keys)
            raise UserError(Problem(mark, dotted(keys), f"{word!r} {message}")) from None

    def _put_runs(
        self, data: MarkedMapping, experiment: Source, problem: SuiteProblem, mark: Mark
    ) -> None:
        """Set the number of runs of a problem's config.

        It is that of ``--runs`` or ``--quick``, else the problem's own, else that of the suite. A
        recording takes all its runs unless the problem or an option sets fewer; a number marked as
        that of ``--quick`` is cut to the recorded runs.
        """
        if self.quick:
            put(data, "runs", self.runs or QUICK_RUNS_OF_PROBLEM, Mark(QUICK))
        elif self.runs is not None and _is_recording(experiment):
            put(data, "runs", self.runs, Mark(QUICK))
        elif self.runs is not None:
            put(data, "runs", self.runs, mark)
        elif problem.runs:
            put(data, "runs", problem.runs, mark)
        elif not _is_recording(experiment):
            put(data, "runs", self.settings.runs, mark)

    def _scenario_and_runs(
        self, experiment: Source, file: Path, problem: SuiteProblem, name: str, keys: Keys
    ) -> MarkedMapping:
        """Return a config with the keys that a suite takes from an experiment, and the suite's own.

        The suite's own are the problem's ``name``, title and score, and the seed and number of runs.
        ``file`` is the experiment's; ``keys`` lead to the problem in the suite.
        """
        mark = self.suite.mark(keys)
        data = MarkedMapping()
        put(data, "name", name, mark)
        for key in _COPIED:
            if key in experiment.data:
                put(data, key, experiment.data[key], experiment.mark((key,)))
        if problem.title:
            put(data, "title", problem.title, mark)
        if self.settings.seed is not None:
            put(data, "seed", self.settings.seed, self.suite.mark(("seed",)))
        self._put_runs(data, experiment, problem, mark)
        # Blocks as wide as the runs need: a suite has few runs, and no more are added later.
        put(data, "block", "fit", mark)
        put(data, "per_step", [], mark)  # no series over time is stored
        if problem.score is not None:
            # Filters are ranked by the first error of the first table.
            columns = {"Error": problem.score}
            if _has_truth(experiment):
                columns["ANEES"] = "anees"
            table = {"errors": {"kind": "metrics", "title": "Error", "columns": columns}}
            put(data, "tables", marked(table, self.suite.mark((*keys, "score"))), mark)
        for key in ("plugins", "files"):
            paths = experiment.data.get(key)
            if isinstance(paths, list):
                absolute = [str((file.parent / str(path)).absolute()) for path in paths]
                put(data, key, marked(absolute, mark), experiment.mark((key,)))
        self._put_plugins(data)
        return data

    def _put_plugins(self, data: MarkedMapping) -> None:
        """Add the suite's plugins to those of a problem's experiment, which may have the same files."""
        if not self.settings.plugins:
            return
        plugins = data.get("plugins")
        if not isinstance(plugins, list):
            plugins = marked([], self.suite.mark(("plugins",)))
            put(data, "plugins", plugins, self.suite.mark(("plugins",)))
        known_files = {Path(path).resolve() for path in plugins}
        for i, path in enumerate(self.settings.plugins):
            file = self.home / path
            if file.resolve() in known_files:
                continue
            plugins.append(None)
            mark = self.suite.mark(("plugins", i))
            put(plugins, len(plugins) - 1, str(file.absolute()), mark)

    def _put_roster(
        self,
        data: MarkedMapping,
        experiment: Source,
        file: Path,
        group_name: str,
        name: str,
        keys: Keys,
    ) -> None:
        """Put the roster, the problem's own filters and its reference into the config ``data``.

        ``experiment`` is the config of the problem's ``file``, which has the reference. ``keys`` lead to
        the problem in the suite.
        """
        # Step 1: the roster with the problem's own filters, whose files are included.
        group = self.suite.data["groups"][group_name]
        changes = group["problems"][name].get("filters") or {}
        # A filter of the problem that has another kind replaces that of the roster whole (`by_kind`).
        filters = deep_merge(copy.deepcopy(group["filters"]), copy.deepcopy(changes), by_kind=True)
        # Paths of files in `filters` are replaced in place by the mappings in the files.
        part = Source(MarkedMapping({"filters": filters}), self.suite.start)
        _include_parts(part, self.home)
        mark = self.suite.mark(keys)
        put(data, "filters", filters, mark)
        smoothed = self.settings.groups[group_name].smoothed
        if smoothed:
            put(data, "smoothed", [*smoothed], mark)
        # Step 2: the reference, a filter of the experiment or its bound.
        reference = self.settings.groups[group_name].problems[name].reference
        if reference is None:
            return
        mark = self.suite.mark((*keys, "reference"))
        if reference == experiment.data.get("bound"):
            put(data, "bound", reference, mark)
            return
        known = experiment.data.get("filters") or {}
        if reference not in known:
            labels = ", ".join(map(str, known))
            message = f"{reference!r} is neither a filter of {file.name} ({labels}) nor its bound"
            raise UserError(Problem(mark, dotted(keys), message))
        if reference in filters:
            message = f"{reference!r} is already a filter of the roster"
            raise UserError(Problem(mark, dotted(keys), message))
        entry = copy.deepcopy(known[reference])
        put(filters, reference, entry, experiment.mark(("filters", reference)))
        put(data, "reference", reference, mark)

    def _put_tuning(self, data: MarkedMapping, group_name: str, name: str) -> None:
        """Put the keys that are tuned, and the number of trials, into the config ``data``.

        They are at their places in the suite, where mistakes in them are reported.
        """
        group_keys = ("groups", group_name)
        # The keys of the group, and those of the problem, which replace them by the filter's label.
        tune = MarkedMapping()
        for owner in (group_keys, (*group_keys, "problems", name)):
            for label, entry in (self.suite.value_at(owner).get("tune") or {}).items():
                keys = (*owner, "tune", label)
                mark_of_key = self.suite.key_mark(keys)
                put(tune, label, copy.deepcopy(entry), self.suite.mark(keys), mark_of_key)
        if not tune:
            return
        written_tuning = self.suite.value_at(group_keys).get("tuning")
        tuning = copy.deepcopy(written_tuning) or MarkedMapping()
        if self.quick:
            for key, value in QUICK_TUNING.items():
                put(tuning, key, value, Mark(QUICK))
        put(data, "tune", tune, self.suite.mark((*group_keys, "tune")))
        put(data, "tuning", tuning, self.suite.mark((*group_keys, "tuning")))


def _target_of(experiment: Source) -> dict[str, object]:
    """Return the target of an experiment; empty if it is mistaken, which is reported later."""
    scenario = experiment.data.get("scenario")
    target = scenario.get("target") if isinstance(scenario, dict) else None
    return target if isinstance(target, dict) else {}


def _is_recording(experiment: Source) -> bool:
    """Test whether an experiment has recorded measurements, and so its own number of runs."""
    return _target_of(experiment).get("kind") == "measured"


def _has_truth(experiment: Source) -> bool:
    """Test whether an experiment has a truth, which recorded measurements may lack."""
    return not _is_recording(experiment) or bool(_target_of(experiment).get("truth"))


def _include_parts(source: Source, folder: Path) -> None:
    """Include the files that a config names; raises UserError for those that cannot be read."""
    unread = inline_parts(source, folder)
    problems = [problem for mistakes in unread.values() for problem in mistakes]
    if problems:
        raise UserError(*problems)


@dataclass(frozen=True)
class FittedProblem:
    """A problem with the filters that it can be run with."""

    name: str
    group: str
    settings: SuiteProblem
    config: Assembled
    experiment: Experiment
    left_out: dict[str, str]
    """filters that the scenario does not fit, or that refuse it, with the reasons"""
    tuned: tuple[str, ...]
    """filters of the roster that are shown by their tuned copies"""
    idle: tuple[str, ...] = ()
    """keys of the user's own filters, as `filters.LABEL.KEY`, that have no effect on this problem"""
