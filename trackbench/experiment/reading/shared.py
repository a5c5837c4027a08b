"""Which expressions per_run.csv has each run's share in: those that anything asks for."""

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain

from trackbench.evaluation.shares import series_of
from trackbench.experiment.reading.definition import Experiment
from trackbench.experiment.reading.grammar import COMPOSED, STEPS, at_each_step, plain
from trackbench.experiment.reading.metric_names import asked_by_parts
from trackbench.experiment.reading.published import Claim


@dataclass(frozen=True)
class Shared:
    """Expressions that every filter has shares in; and those of many steps, by label: these are many."""

    everywhere: tuple[str, ...]
    of_steps: Mapping[str, tuple[str, ...]]

    @property
    def series(self) -> list[str]:
        """Names of the series that the shares are made of."""
        one_each = (STEPS.sub(r"@\1", word) for word in chain(*self.of_steps.values()))
        found = (series_of(word) for word in (*self.everywhere, *one_each))
        return list(dict.fromkeys(name for name in found if name is not None))

    def of(self, label: str, steps: Sequence[int]) -> list[str]:
        """Those of a filter, each at one step, of a scenario with these steps."""
        many = self.of_steps.get(label, ())
        found = [word for wide in many for word in at_each_step(wide, steps)]
        return list(dict.fromkeys([*self.everywhere, *found]))


def shared(experiment: Experiment) -> Shared:
    """What tables, figures and published files ask for."""
    parts, published = experiment.parts, experiment.published
    words = [asked.word for asked in asked_by_parts(parts)]
    words += [e for number in published.numbers for e in number.expressions]
    words += [e for claim in published.claims for e in claim.expressions]
    of_steps: dict[str, dict[str, None]] = defaultdict(dict)
    for claim in published.claims:
        for label, wide in _of_steps(claim):
            of_steps[label][wide] = None
    return Shared(
        tuple(sorted({plain(word) for word in words if series_of(plain(word)) is not None})),
        {label: tuple(wide) for label, wide in of_steps.items()},
    )


def _of_steps(claim: Claim) -> Iterable[tuple[str, str]]:
    """Labels and what a claim compares of them at many steps."""
    for expression in claim.expressions:
        composed = COMPOSED.fullmatch(expression)
        if STEPS.search(expression):
            for label in [*claim.labels, *([composed.group(3)] if composed else [])]:
                yield label, plain(expression)
