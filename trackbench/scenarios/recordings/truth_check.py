"""Check whether truth and measurements of a recording agree, or one is mirrored or turned."""

from collections.abc import Mapping, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array, Index
from trackbench.errors import joined
from trackbench.models.base import LocatingSensor, Sensor
from trackbench.models.sensors.landmark import Landmark
from trackbench.models.sensors.stacked import Sensors, rows_of, sensor_name, sensors_of
from trackbench.models.sensors.steps_at_once import is_equal_at_every_step
from trackbench.scenarios.recordings.quantity_keys import PLACE, plain_name
from trackbench.scenarios.recordings.truth_check_delays import (
    MOST_STEPS_OF_DELAY,
    StepClock,
    delay_notes,
)
from trackbench.scenarios.recordings.truth_check_distances import (
    AZIMUTHS,
    FITS,
    HEADINGS,
    MOST_REMAINING,
    MOST_REMAINING_AT_PLACE,
    MOST_STEPS,
    Sample,
    largest_distances,
    median_distance,
    normalized_distances,
)
from trackbench.scenarios.recordings.truth_check_units_and_places import (
    other_height,
    other_place,
    other_unit,
)

_BEYOND = 10.0
"""standard deviations of a measurement's error from the truth"""
_MOST_BEYOND = 0.8
"""share of the measurements that may be that far from the truth, as outliers are"""
_FEWEST = 10
_CHANGED_AXES = {
    "mirrored at the diagonal x = y": ((0, 1), (1, 0)),
    "mirrored at the x axis": ((1, 0), (0, -1)),
    "mirrored at the y axis": ((-1, 0), (0, 1)),
    "mirrored at the diagonal x = -y": ((0, -1), (-1, 0)),
    "turned by 90 deg": ((0, -1), (1, 0)),
    "turned by 180 deg": ((-1, 0), (0, -1)),
    "turned by 270 deg": ((0, 1), (-1, 0)),
}
"""Changes of the truth's x and y: the symmetries of a square."""
_NORTH_CLOCKWISE = "from north clockwise"
_X_TO_Y = "from x to y"
_HEADING_CLOCKWISE = "from the heading clockwise"
_HEADING_TO_LEFT = "from the heading to the left"
"""Names of those ways to count an angle which the key `clockwise` can say."""
_DIRECTIONS_OF_AZIMUTHS = {
    (-1, 1): _NORTH_CLOCKWISE,
    (-1, 0): "from x clockwise",
    (1, 1): "from north to west",
    (1, 2): "from west to south",
    (-1, 2): "from west clockwise",
    (1, 3): "from south to east",
    (-1, 3): "from south clockwise",
    (1, 0): _X_TO_Y,
}
"""Ways to count an azimuth: the sign of the angle in the file, and the quarter turns to be added."""
_DIRECTIONS_OF_BEARINGS = {
    (-1, 0): _HEADING_CLOCKWISE,
    (1, 1): "from the left side",
    (-1, 1): "from the left side clockwise",
    (1, 3): "from the right side",
    (-1, 3): "from the right side clockwise",
    (1, 2): "from the back",
    (-1, 2): "from the back clockwise",
    (1, 0): _HEADING_TO_LEFT,
}
"""Ways to count a landmark's bearing, as those of an azimuth."""
_LEAST_TO_EXPLAIN = 3.0
"""median distance, in standard deviations, from which on other units and places are tried"""
_UNEXPLAINED = ": check "
"""beginning of the end of a note on measurements that agree with the truth in no known way"""
_CLEARLY_NEARER = 0.95
"""ratio of the median distances that remain after two changes, below which the first one is better

The standard error of a median distance of 5000 measurements is 1 %.
"""
_MOVED = " moved by "
"""words in the end of a note on a truth that counts from another origin"""


def contradictions(
    sensor: Sensors,
    components: Sequence[str],
    truth: Array,
    measurements: Array,
    clock: StepClock,
    names: Sequence[str] = (),
    angles: Sequence[str] = (),
    in_one_file: bool = True,
    clockwise: Sequence[bool] = (),
    scales: Sequence[Mapping[str, float]] = (),
    is_geodetic: bool = False,
    reference: str = "the truth",
    position_error: float = 0.0,
) -> list[str]:
    """Return a text on each sensor whose measurements (n_z, K, M) contradict the truth (n_x, K, M).

    A sensor contradicts it if a change makes both agree that hardly do without it, or if nearly all its
    measurements are far from what the truth predicts. The change, which the text names, is a reflection,
    a turn, another direction of angles, another unit, a delay or another place of a landmark; the text
    says what to check if there is none. ``sensor`` has all sensors of the scenario.
    ``components`` are those of the truth, and ``angles`` those that are angles. ``clock`` has the K
    steps. ``names`` are those of the sensors in the recording, if it has any. If the sensors are
    ``in_one_file``, they have one clock, and so one delay. ``clockwise`` says of each sensor whether its
    angles are read as clockwise ones; default: none. ``scales`` has the units of each sensor's
    quantities, in SI, and ``is_geodetic`` is True if the truth has latitudes. ``reference`` are words
    for the truth, whose position has a standard deviation of ``position_error``, m, on each axis.
    """
    steps = clock.steps
    axes = _axes_of(components)
    if axes is None:
        return []
    # The first pair of rows is that of the position, without which a step has no truth.
    row_of_x, _ = axes[0]
    has_truth = np.isfinite(truth[row_of_x])
    contradicting: list[_Contradiction] = []
    samples: list[Sample] = []
    sensors = sensors_of(sensor)
    for number, (each, rows) in enumerate(zip(sensors, rows_of(sensor), strict=True)):
        # Step 1: a sample of the steps with a truth at which this sensor measured.
        z = measurements[rows]
        known = np.flatnonzero((has_truth & np.isfinite(z).any(axis=0)).any(axis=-1))
        if len(known) < _FEWEST:
            continue
        chosen = known[np.linspace(0, len(known) - 1, min(len(known), MOST_STEPS)).astype(int)]
        # Step 2: the distances, in standard deviations, of its measurements from those that the truth
        # predicts.
        sample = Sample(
            sensor=each,
            truth=truth[:, chosen],
            z=z[:, chosen],
            steps=steps[chosen],
            is_clockwise=bool(clockwise and clockwise[number]),
            reference=reference,
            scales=scales[number] if scales else {},
            is_geodetic=is_geodetic,
            position_rows=axes[0],
            position_error=position_error,
        )
        sizes = largest_distances(normalized_distances(sample))
        if len(sizes) < _FEWEST:
            continue
        name = sensor_name(number, names) if len(sensors) > 1 else "the sensor"
        # A delay is estimated from more steps, of which some may have a truth only after the delay.
        measured = np.flatnonzero(np.isfinite(z).any(axis=(0, 2)))
        most = min(len(measured), MOST_STEPS_OF_DELAY)
        chosen = measured[np.linspace(0, len(measured) - 1, most).astype(int)]
        samples.append(
            sample._replace(
                truth=truth[:, chosen],
                z=z[:, chosen],
                steps=steps[chosen],
                name=name,
                indices=chosen,
            )
        )
        size = float(np.median(sizes))  # standard deviations
        is_beyond = bool((sizes > _BEYOND).mean() > _MOST_BEYOND)
        # Step 3: find the change by which both agree. Changes that explain fewer mistakes come first:
        # a heading and a place, which only landmarks have, before units and axes. The last search
        # returns what to check if nearly all measurements are far away and nothing explains it.
        remedy = ""
        if isinstance(each, Landmark) and size > _LEAST_TO_EXPLAIN:
            remedy = _other_heading(sample, components, size)
        is_explained = bool(remedy)
        if isinstance(each, Landmark) and not remedy and size > _LEAST_TO_EXPLAIN:
            remedy = other_place(sample, each, size)
        has_other_place = bool(remedy) and not is_explained
        if not remedy and size > _LEAST_TO_EXPLAIN:
            remedy = other_height(sample, components, size)
        if not remedy and size > _LEAST_TO_EXPLAIN:
            remedy = other_unit(sample, axes, components, size)
        if not remedy and size > _LEAST_TO_EXPLAIN:
            remedy = _other_axes_or_directions(sample, axes, components, size, is_beyond)
        if not remedy:
            continue  # near enough to the truth, or not explained and not far away
        contradicting.append(
            _Contradiction(
                name=name,
                size=size,
                is_beyond=is_beyond,
                has_other_place=has_other_place,
                remedy=remedy,
            )
        )
    # Step 4: find delays. One explains all sensors for which no other change is found. On a straight way
    # a delay looks like a constant distance, and the note has both unless one fits clearly better.
    delay_texts = []
    for note in delay_notes(samples, truth, clock, components, angles, in_one_file):
        of_others = [case for case in contradicting if case.name not in note.names]
        of_note = [each for each in samples if each.name in note.names]
        # Several sensors may be moved by different distances.
        move = _find_move(of_note[0], axes) if len(of_note) == 1 else None
        if move is not None and move.remaining < _CLEARLY_NEARER * note.remaining:
            moved = _Contradiction(
                name=of_note[0].name,
                size=median_distance(normalized_distances(of_note[0])),
                is_beyond=False,
                has_other_place=False,
                remedy=f"; they agree if {move.words}",
            )
            contradicting = [*of_others, moved]
            continue
        doubt = ": check the clocks of both"
        if move is not None and _CLEARLY_NEARER * move.remaining < note.remaining:
            doubt = f", or {move.words}"
        delay_texts.append(f"{note.text}{doubt}")
        # The delay takes the place of a move of these sensors, and the text above names both.
        contradicting = [case for case in contradicting if case in of_others or not case.names_move]
    if delay_texts:
        contradicting = [case for case in contradicting if not case.is_unexplained]
    # Step 5: write one text for all sensors with the same remedy.
    groups: dict[tuple[bool, str], list[_Contradiction]] = {}
    for case in contradicting:
        groups.setdefault((case.is_beyond, case.remedy), []).append(case)
    texts = []
    for (is_beyond, remedy), group in groups.items():
        words = joined([case.name for case in group])
        medians = sorted(case.size for case in group)
        median = f"median: {medians[0]:.0f}"
        if len(group) > 1:
            median = f"medians: {medians[0]:.0f} to {medians[-1]:.0f}"
        message = f"nearly every measurement of {words} disagrees with {reference}"
        if not is_beyond:
            message = f"{reference} and the measurements of {words} disagree"
        texts.append(f"{message} ({median} standard deviations){remedy}")
    is_every_landmark = len(texts) == len(sensors) > 1
    if is_every_landmark and all(case.has_other_place for case in contradicting):
        texts.append("no landmark is where the truth says: or check the truth's origin and clock")
    return texts + delay_texts


class _Contradiction(NamedTuple):
    """A sensor that contradicts the truth."""

    name: str
    size: float
    """median distance of its measurements from what the truth predicts, in standard deviations"""
    is_beyond: bool
    """whether nearly all measurements are far away"""
    has_other_place: bool
    """whether the measurements fit another place of the sensor, a landmark"""
    remedy: str
    """end of the note: with what both agree, or what to check"""

    @property
    def names_move(self) -> bool:
        """True if the remedy is a truth that counts from another origin."""
        return _MOVED in self.remedy

    @property
    def is_unexplained(self) -> bool:
        """True if the remedy is what to check, as no known change explains the distances."""
        return self.remedy.startswith(_UNEXPLAINED)


def _other_axes_or_directions(
    sample: Sample,
    axes: tuple[tuple[int, int], ...],
    components: Sequence[str],
    size: float,
    is_beyond: bool,
) -> str:
    """Return the end of a note, with the other direction of angles or axes by which both agree.

    If they agree in none, it says what to check, or is empty unless nearly all measurements are far away
    (``is_beyond``). ``axes`` are pairs of rows of the truth: those of x and y, and those of vx and vy if
    it has them. ``components`` are its components, and ``size`` is the median distance of measurements
    from what the truth predicts, without any change, in standard deviations.
    """
    measured = sample.sensor.components
    angles = [row for row, name in enumerate(measured) if name in AZIMUTHS]
    headings = [row for row, name in enumerate(components) if name in HEADINGS]
    # Step 1: change the measured angles of the sample, or the axes of its truth, by each known mistake.
    changed: dict[str, Sample] = {}
    if angles:
        # The first one is the identity.
        for sign, quarters in [*product((1, -1), range(4))][1:]:
            recounted = sample.z.copy()
            recounted[angles] = sign * sample.z[angles] + 0.5 * np.pi * quarters
            name = _direction_in_file(sample, sign, quarters)
            changed[name] = sample._replace(z=recounted)
    directions = [*changed]
    for change, matrix in _CHANGED_AXES.items():
        truth = _transform(sample.truth, axes, matrix)
        changed[change] = sample._replace(truth=truth)
        if headings:
            truth = truth.copy()
            truth[headings] = _changed_direction(sample.truth[headings], matrix)
            changed[f"{change}, with its heading"] = sample._replace(truth=truth)
    # Step 2: take the change after which measurements are nearest to the truth. A direction comes before
    # the axes by which the same angles are explained.
    remaining = {
        change: median_distance(normalized_distances(each)) for change, each in changed.items()
    }
    # Measurements near the truth, as those of a path near the diagonal, must fit it after the change.
    most = MOST_REMAINING * size
    if not is_beyond:
        most = min(most, FITS)
    change = min(directions or remaining, key=lambda name: remaining[name])
    if remaining[change] > most:
        change = min(remaining, key=lambda name: remaining[name])
    if remaining[change] > most:
        moved = _other_origin(sample, axes, size)
        if moved or not is_beyond:
            return moved
        place = ""
        if getattr(sample.sensor, "at", None) is not None:
            place = "its place `at`, "
        return f"{_UNEXPLAINED}{place}the origin, the units, the clock and the sensor's sigma"
    if change in directions:
        angle = measured[angles[0]]
        hint = ": convert its angles"
        if change == _NORTH_CLOCKWISE:
            hint = f": say `clockwise: [{angle}]`"
        elif change == _HEADING_CLOCKWISE:
            hint = f": say `clockwise: [{angle}]` in the target"
        elif change in (_X_TO_Y, _HEADING_TO_LEFT):
            hint = f": leave `clockwise: [{angle}]` out"
        return f"; they agree if its {angle} counts {change}{hint}"
    hint = "are x and y exchanged, or an axis reversed?"
    return f"; they agree if {_is_reference(sample)} {change}: {hint}"


def _other_origin(sample: Sample, axes: tuple[tuple[int, int], ...], size: float) -> str:
    """Return the end of a note, with the distance by which the truth is moved; empty if none serves.

    After it the median distance must be clearly smaller than ``size``, that without any change in
    standard deviations, and fit the truth (`FITS`). ``axes`` are pairs of rows of the truth: those of x
    and y, and those of vx and vy if it has them, which another origin does not change.
    """
    move = _find_move(sample, axes)
    if move is None or move.remaining > min(FITS, MOST_REMAINING_AT_PLACE * size):
        return ""
    return f"; they agree if {move.words}"


class _Move(NamedTuple):
    """Distance by which the truth is moved, if it counts from another origin than the measurements."""

    words: str
    """the distance, and what to check"""
    remaining: float
    """median distance of the measurements from the moved truth, in standard deviations"""


def _find_move(sample: Sample, axes: tuple[tuple[int, int], ...]) -> _Move | None:
    """Move the truth by the median distance of the measured positions from it.

    None for a sensor that does not locate the target by each measurement. ``axes`` are pairs of rows of
    the truth, of which the first is the position.
    """
    position = np.array(axes[0])
    sensor = sample.sensor
    if tuple(map(plain_name, sensor.components)) == PLACE:
        measured = sample.z
    elif isinstance(sensor, LocatingSensor) and sensor.axes == len(position):
        measured = located_positions(sensor, sample.z, sample.steps)
    else:
        return None
    differences = (measured - sample.truth[position]).reshape(2, -1)
    if not np.isfinite(differences).all(axis=0).any():
        return None
    offset = np.nanmedian(differences, axis=1)
    truth = sample.truth.copy()
    truth[position] += offset[:, None, None]
    x, y = (f"{value:.0f}" for value in offset)
    doubt = "do both count from one origin?"
    if getattr(sensor, "at", None) is not None:
        doubt = "do both count from one origin, and is the sensor's place `at` right?"
    return _Move(
        words=f"{_is_reference(sample)}{_MOVED}[{x}, {y}] m: {doubt}",
        remaining=median_distance(normalized_distances(sample._replace(truth=truth))),
    )


def located_positions(sensor: Sensor, z: Array, steps: Index) -> Array:
    """Return the positions (axes, K, M) that measurements z (n_z, K, M) at ``steps`` (K,) give, m.

    ``sensor`` locates the target by each measurement.
    """
    assert isinstance(sensor, LocatingSensor)
    positions = np.full((sensor.axes, *z.shape[1:]), np.nan)
    with np.errstate(all="ignore"):
        if is_equal_at_every_step(sensor):
            # All steps and runs are one batch of one step.
            located = sensor.located(z.reshape(len(z), -1), int(steps[0]))
            return located.mean.reshape(positions.shape)
        for i, step in enumerate(steps.tolist()):
            positions[:, i] = sensor.located(z[:, i], step).mean
    return positions


def _is_reference(sample: Sample) -> str:
    """Return the subject and verb of a change of the truth, which may be positions of a sensor."""
    verb = "is" if sample.reference == "the truth" else "are"
    return f"{sample.reference} {verb}"


def _direction_in_file(sample: Sample, sign: int, quarters: int) -> str:
    """Return the name of the way in which the angles in the file count.

    The right angle is the one that was read times ``sign``, plus ``quarters`` of a turn.
    """
    is_landmark = isinstance(sample.sensor, Landmark)
    names = _DIRECTIONS_OF_BEARINGS if is_landmark else _DIRECTIONS_OF_AZIMUTHS
    # Half a turn reverses an azimuth in either way to count it.
    if (sign, quarters) == (1, 2) and not is_landmark:
        return "from the opposite direction"
    # An azimuth that is read as a clockwise one is pi / 2 - c, and a bearing is -c.
    if sample.is_clockwise:
        quarters += 0 if is_landmark else sign
        sign = -sign
    return names[sign, quarters % 4]


def _other_heading(sample: Sample, components: Sequence[str], size: float) -> str:
    """Return the end of a note, with the other direction of headings by which landmarks agree.

    Bearings may count from the axis x or from north, and not from the heading, or the heading of the
    truth may count clockwise from north, as a compass does. The text is empty if none explains the
    median distance ``size`` of measurements from what the truth predicts, in standard deviations.
    ``components`` are those of the truth.
    """
    rows = [row for row, name in enumerate(components) if name in HEADINGS]
    angles = [row for row, name in enumerate(sample.sensor.components) if name in AZIMUTHS]
    if len(rows) != 1 or not angles:
        return ""
    heading = components[rows[0]]
    angle = sample.sensor.components[angles[0]]
    compass = sample.truth.copy()
    compass[rows] = 0.5 * np.pi - sample.truth[rows]
    without_heading = sample.truth.copy()
    without_heading[rows] = 0.0
    from_north = sample.z.copy()
    from_north[angles] = 0.5 * np.pi - sample.z[angles]
    subtract = "subtract the heading from it"
    clockwise = f"say `truth_naming: {{clockwise: [{heading}]}}`"
    changes = {
        f"if {heading} of the truth counts from north clockwise: {clockwise}": sample._replace(
            truth=compass
        ),
        f"if its {angle} counts from the axis x, and not from the heading: {subtract}": (
            sample._replace(truth=without_heading)
        ),
        f"if its {angle} counts from north, and not from the heading: {subtract}": (
            sample._replace(truth=without_heading, z=from_north)
        ),
    }
    remaining = {
        text: median_distance(normalized_distances(each)) for text, each in changes.items()
    }
    best = min(remaining, key=lambda text: remaining[text])
    # The distance that remains must be one of noise, and a small share of that before the change.
    if remaining[best] > min(FITS, MOST_REMAINING * size):
        return ""
    return f"; they agree {best}"


def _axes_of(components: Sequence[str]) -> tuple[tuple[int, int], ...] | None:
    """Return pairs of rows of a state: those of x and y, and then those of vx and vy.

    None if ``components``, those of the state, have no position.
    """
    if not {"px", "x"} & {*components}:
        return None
    axes = []
    for x, y in (("px", "py"), ("x", "y"), ("vx", "vy")):
        if x in components and y in components:
            axes.append((components.index(x), components.index(y)))
    return tuple(axes) or None


def _transform(
    truth: Array, axes: tuple[tuple[int, int], ...], matrix: tuple[tuple[int, int], ...]
) -> Array:
    """Return the truth (n_x, K, M) with each pair of rows in ``axes`` multiplied by a matrix (2, 2)."""
    (a, b), (c, d) = matrix
    changed = truth.copy()
    for i, j in axes:
        changed[i] = a * truth[i] + b * truth[j]
        changed[j] = c * truth[i] + d * truth[j]
    return changed


def _changed_direction(angles: Array, matrix: tuple[tuple[int, int], ...]) -> Array:
    """Return directions, rad from x to y, after a change of the axes by a matrix (2, 2)."""
    (a, b), (c, d) = matrix
    x = np.cos(angles)
    y = np.sin(angles)
    return np.asarray(np.arctan2(c * x + d * y, a * x + b * y))
