"""Join the guesses at several files, one for each sensor, for one config."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from trackbench.errors import first_names
from trackbench.field_types import DataError, Place
from trackbench.scenarios.recordings.common_clock import ONE_RUN
from trackbench.scenarios.recordings.guess_process_noise import joined_process_noise
from trackbench.scenarios.recordings.guess_record import Guess
from trackbench.scenarios.recordings.guess_usual_speed import joined_speed
from trackbench.scenarios.recordings.quantities import COURSE
from trackbench.scenarios.recordings.recording_keys import Naming

_VELOCITIES = ("vx", "vy", *COURSE)
_MOST_NAMES = 8


def joined_guess(paths: Sequence[str], guesses: Sequence[Guess]) -> Guess:
    """Return the guess at a recording whose files, one for each sensor, are at ``paths``.

    ``guesses`` are those at the single files. Raises DataError for a file of several sensors, the log of
    a robot, and files with different runs.
    """
    files = [_of_one_sensor(path, guess) for path, guess in zip(paths, guesses, strict=True)]
    # Files of one run each may give it different names.
    if all(len(file.runs) == 1 for file in files):
        files = [_without_name_of_run(file) for file in files]
    _check_runs(paths, files)
    rows: Counter[str] = Counter()
    for file in files:
        rows.update(dict(file.runs))
    first = files[0]
    # Each file's own guess has its columns; those of the clock show whether times or steps are counted.
    clock: dict[str, str] = {}
    for key in ("time", "step"):
        if key in first.naming.columns:
            clock[key] = first.naming.columns[key]
    speed = joined_speed([file.speed for file in files])
    # There may be a step at each row of any file, so that their numbers are added. The fastest sensor
    # gives the interval, and the file with most outliers decides on gates.
    return Guess(
        naming=Naming(columns=clock, origin=first.naming.origin),
        reasons={},
        runs=rows.most_common(),
        sensors=[file.sensors[0] for file in files],
        speed=speed,
        process_noise=joined_process_noise([file.process_noise for file in files], speed),
        names=first.names,
        steps=sum(file.steps for file in files),
        interval=min(file.interval for file in files),
        origin=next((file.origin for file in files if file.origin), ()),
        is_dated=first.is_dated,
        outliers=max(file.outliers for file in files),
        files=tuple(files),
    )


def _of_one_sensor(path: str, guess: Guess) -> Guess:
    """Return the guess at one of several files, whose sensor gets the name of the file.

    Velocities beside positions would be measured by a second sensor, and are left out. Raises DataError
    for the log of a robot and for a file of several sensors.
    """
    name = Path(path).stem
    if guess.inputs:
        message = "is the log of a robot, which is alone in a config that is written"
        remedy = "write the config for it, and add the further files to its `measurements`"
        raise DataError(Place(path, 1, 1, f"{message}: {remedy} (docs/your-robot.md)"))
    if len(guess.sensors) > 1:
        names = first_names([sensor.name for sensor in guess.sensors], _MOST_NAMES)
        message = f"has {len(guess.sensors)} sensors ({names}), and each of several files is of one"
        raise DataError(Place(path, 1, 1, f"{message}: write a file for each sensor"))
    columns = {key: c for key, c in guess.naming.columns.items() if key not in _VELOCITIES}
    columns.pop("sensor", None)
    sensor = guess.sensors[0]._replace(name=name)
    reasons = {key: reason for key, reason in guess.reasons.items() if key != "velocity"}
    naming = replace(guess.naming, columns=columns)
    return replace(guess, naming=naming, reasons=reasons, sensors=[sensor])


def _without_name_of_run(guess: Guess) -> Guess:
    """Return the guess at a file of one run, without the name of the run.

    The files may give their only run different names, and it is the same run.
    """
    columns = dict(guess.naming.columns)
    # An empty name says that all rows are one run. Without the key a column that is called run, or one
    # such as MMSI, would be taken for the names of runs. It is put last.
    if columns.pop("run", None) is not None:
        columns["run"] = ""
    rows = sum(number for _, number in guess.runs)
    return replace(guess, naming=replace(guess.naming, columns=columns), runs=[(ONE_RUN, rows)])


def _check_runs(paths: Sequence[str], files: Sequence[Guess]) -> None:
    """Raise DataError if no run is in all ``files``, the guesses at the files at ``paths``."""
    names = [{name for name, _ in file.runs} for file in files]
    if set.intersection(*names):
        return
    message = []
    for path, file in zip(paths, files, strict=True):
        runs = first_names([name for name, _ in file.runs], _MOST_NAMES)
        message.append(f"{Path(path).name} has {runs}")
    remedy = "no run is in all files: name each run alike in all of them"
    raise DataError(Place(paths[0], 1, 1, f"{'; '.join(message)}; {remedy}"))
