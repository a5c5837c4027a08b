"""Which measures per_run.csv has each run's share in: those that anything asks for."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain

from trackbench.evaluation.measure import Measure
from trackbench.evaluation.shares import series_of
from trackbench.experiment.reading.definition import Experiment
from trackbench.experiment.reading.metric_checks import asked_by_parts


@dataclass(frozen=True)
class Shared:
    """Measures that every filter has shares in; and those of many steps, by label: these are many."""

    everywhere: tuple[Measure, ...]
    of_steps: Mapping[str, tuple[Measure, ...]]

    @property
    def series(self) -> list[str]:
        """Names of the series that the shares are made of."""
        found = map(series_of, (*self.everywhere, *chain(*self.of_steps.values())))
        return list(dict.fromkeys(name for name in found if name is not None))

    def of(self, label: str, steps: Sequence[int]) -> list[Measure]:
        """Those of a filter, each at one step, of a scenario with these steps."""
        found = chain(*(many.at_each(steps) for many in self.of_steps.get(label, ())))
        return list(dict.fromkeys([*self.everywhere, *found]))


def shared(experiment: Experiment) -> Shared:
    """What tables, figures and published files ask for."""
    asked = [asked.measure for asked in asked_by_parts(experiment.parts)]
    asked += experiment.published.expressions
    everywhere = {m.plain for m in asked if not m.is_many and series_of(m.plain) is not None}
    of_steps: dict[str, dict[Measure, None]] = defaultdict(dict)
    for claim in experiment.published.claims:
        for expression in claim.expressions:
            for label in filter(None, [*claim.labels, expression.other]):
                if expression.is_many:
                    of_steps[label][expression.plain] = None
    return Shared(
        tuple(sorted(everywhere, key=str)), {label: tuple(m) for label, m in of_steps.items()}
    )
