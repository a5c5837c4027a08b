"""Option `--dry-run`: the line on each experiment that would run."""

from trackbench.commands.prepare_jobs import Job
from trackbench.models.component_names import few_names
from trackbench.models.sensor_places import sensor_places


def dry_run_line(job: Job, time: str) -> str:
    """Return what a dry run prints of a job: its size, state and measurement, and the expected time.

    A filter with components of its own may run on the problem only if it has these names. Places of
    sensors are printed unless all are the origin. ``time`` is the expected time in words.
    """
    model = job.experiment.points[0].scenario.model
    motion, sensor = model
    names = f"state {few_names(motion.components)}, measurement {few_names(sensor.components)}"
    places = sensor_places(model)
    is_elsewhere = any(any(place) for place in places)
    if is_elsewhere:
        texts = []
        for place in places:
            numbers = ", ".join(f"{number:g}" for number in place)
            texts.append(f"[{numbers}]")
        noun = "sensor" if len(places) == 1 else "sensors"
        names += f", {noun} at {few_names(texts)}"
    return f"{job.line} ({names}); {time}"
