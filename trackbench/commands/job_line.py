"""First line of a run: its name, filters, runs, steps, blocks and workers."""

from trackbench.config.experiment import Experiment
from trackbench.errors import counted
from trackbench.execution.plan import Plan
from trackbench.report.findings.phrases import named


def announced(experiment: Experiment, plan: Plan, workers: int, kept: int = 0) -> str:
    """Return the line that announces the run; ``kept`` is the number of blocks stored before."""
    settings = experiment.settings
    tuned = ""
    if experiment.tuned:
        tuning = settings.tuning
        labels = ", ".join(map(named, experiment.tuned))
        trials = counted(tuning.evaluations, "trial")
        tuned = f"tunes {labels} by {trials} on {counted(tuning.runs, 'run')}, "
    counts = []
    if len(experiment.points) > 1:
        counts.append(counted(len(experiment.points), "point"))
    counts.append(counted(len(experiment.points[0].filters), "filter"))
    runs = counted(settings.runs, "run")
    counts.append(f"up to {runs}" if settings.until else runs)
    # Without the step of the initial state.
    steps = max(len(point.scenario.steps) - 1 for point in experiment.points)
    counts.append(counted(steps, "step"))
    blocks = counted(len(plan.unique), "block")
    if kept:
        blocks += f" ({kept} kept)"
    size = " x ".join(counts)
    return f"{settings.name}: {tuned}{size}, {blocks} on {counted(workers, 'worker')}"
