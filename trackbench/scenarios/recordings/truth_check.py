"""Check whether truth and measurements of a recording agree, or one is mirrored or turned."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array, Index
from trackbench.errors import joined
from trackbench.models.base import Sensor
from trackbench.models.sensors.landmark import Landmark
from trackbench.models.sensors.stacked import Sensors, rows_of, sensor_name, sensors_of
from trackbench.models.sensors.steps_at_once import is_equal_at_every_step
from trackbench.scenarios.recordings.quantity_keys import PLACE, plain_name

_BEYOND = 10.0
"""standard deviations of a measurement's error from the truth"""
_MOST_BEYOND = 0.8
"""share of the measurements that may be that far from the truth, as outliers are"""
_MOST_REMAINING = 0.2
"""of the median distance that remains if a mirror image or a turn explains it"""
_AZIMUTHS = ("azimuth", "bearing")
_FEWEST = 10
_MOST_STEPS = 200
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
_FACTORS = {
    "mm and m, or m and km,": 1e-3,
    "cm and m": 1e-2,
    "feet and m": 0.3048,
    "nautical miles and m": 1852.0,
}
"""Usual mistakes of units of lengths, with the factor between the units."""
_DEGREES = ("deg and rad", np.pi / 180.0)
_HEADINGS = ("heading", "theta", "yaw", "psi", "course")
_LEAST_TO_EXPLAIN = 3.0
"""median distance, in standard deviations, from which on other units and places are tried"""
_FITS = 2.0
"""median distance of measurements that fit a place; that of a right sensor is about 1"""
_MOST_REMAINING_AT_PLACE = 0.4
"""of the median distance that remains at most if another place explains it"""
_UNEXPLAINED = ": check "
"""beginning of the end of a note on measurements that agree with the truth in no known way"""
_MOVED = "; they agree if the truth is moved by "
"""beginning of the end of a note on a truth that counts from another origin"""
_LONGEST_DELAY = 2.0
_LONGEST_DELAY_STEPS = 10
"""Longest delay that is tried, in s, and in usual steps if they are longer."""
_DELAYS = 20
"""Number of delays that are tried on either side, and between the best one's neighbors."""
_FEWEST_OF_DELAY = 30
"""Measurements from which on a delay is looked for."""
_EXPLAINED_BY_DELAY = 0.6
"""Share of the median distances that remains at most if a delay explains them."""
_MOST_RUNS = 5
_FEW_STEPS = 50
"""Most runs, and most steps of a sensor that takes one step at a time, in the search of a delay."""
_NO_STEPS: Index = np.empty(0, dtype=np.intp)
_ITERATIONS = 30
_HUBER = 2.0
"""standard deviations from which on a measurement counts less in the fit of a place"""
_STEEPEST = 1e5
"""largest change of a normalized error, in standard deviations per meter, that is no jump"""


class StepClock(NamedTuple):
    """Numbers and times (K,) of the steps of a recording, s, or steps if it is ``counts_steps``."""

    steps: Index
    times: Array
    counts_steps: bool = False


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
) -> list[str]:
    """Return a text on each sensor whose measurements (n_z, K, M) contradict the truth (n_x, K, M).

    A sensor contradicts it if a change makes both agree that hardly do without it, or if nearly all its
    measurements are far from what the truth predicts. The change, which the text names, is a reflection,
    a turn, another direction of angles, another unit, a delay or another place of a landmark; the text
    says what to check if there is none. ``sensor`` has all sensors of the scenario.
    ``components`` are those of the truth, and ``angles`` those that are angles. ``clock`` has the K
    steps. ``names`` are those of the sensors in the recording, if it has any. If the sensors are
    ``in_one_file``, they have one clock, and so one delay. ``clockwise`` says of each sensor whether its
    angles are read as clockwise ones; default: none.
    """
    steps = clock.steps
    axes = _axes_of(components)
    if axes is None:
        return []
    # The first pair of rows is that of the position, without which a step has no truth.
    row_of_x, _ = axes[0]
    has_truth = np.isfinite(truth[row_of_x])
    contradicting: list[_Contradiction] = []
    samples: list[_Sample] = []
    sensors = sensors_of(sensor)
    for number, (each, rows) in enumerate(zip(sensors, rows_of(sensor), strict=True)):
        # Step 1: a sample of the steps with a truth at which this sensor measured.
        z = measurements[rows]
        known = np.flatnonzero((has_truth & np.isfinite(z).any(axis=0)).any(axis=-1))
        if len(known) < _FEWEST:
            continue
        chosen = known[np.linspace(0, len(known) - 1, min(len(known), _MOST_STEPS)).astype(int)]
        # Step 2: the distances, in standard deviations, of its measurements from those that the truth
        # predicts.
        sample = _Sample(
            sensor=each,
            truth=truth[:, chosen],
            z=z[:, chosen],
            steps=steps[chosen],
            is_clockwise=bool(clockwise and clockwise[number]),
        )
        sizes = _largest_distances(_distances(sample))
        if len(sizes) < _FEWEST:
            continue
        name = sensor_name(number, names) if len(sensors) > 1 else "the sensor"
        samples.append(sample._replace(name=name, indices=chosen))
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
            remedy = _other_place(sample, each, size)
        has_other_place = bool(remedy) and not is_explained
        if not remedy and size > _LEAST_TO_EXPLAIN:
            remedy = _other_height(sample, components, size)
        if not remedy and size > _LEAST_TO_EXPLAIN:
            remedy = _other_unit(sample, axes, components, size)
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
    # Step 4: find delays. One explains all sensors for which no other change is found.
    delay_texts = _delay_notes(samples, truth, clock, components, angles, in_one_file)
    if delay_texts:
        # On a straight way a delay looks like a constant distance.
        contradicting = [
            case for case in contradicting if not case.remedy.startswith((_UNEXPLAINED, _MOVED))
        ]
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
        message = f"nearly every measurement of {words} disagrees with the truth"
        if not is_beyond:
            message = f"the truth and the measurements of {words} disagree"
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


class _Sample(NamedTuple):
    """Measurements of one sensor at some steps, and the truth there."""

    sensor: Sensor
    truth: Array
    """true states (n_x, K, M)"""
    z: Array
    """measurements (n_z, K, M)"""
    steps: Index
    """numbers of the K steps"""
    name: str = ""
    """name of the sensor in a note"""
    indices: Index = _NO_STEPS
    """indices of the K steps among all steps of the recording"""
    is_clockwise: bool = False
    """whether the angles are read as clockwise ones"""


def _delay_notes(
    samples: Sequence[_Sample],
    truth: Array,
    clock: StepClock,
    components: Sequence[str],
    angles: Sequence[str],
    in_one_file: bool,
) -> list[str]:
    """Return texts on the sensors whose measurements agree much better with an earlier or a later truth.

    ``samples`` are those of the sensors, ``truth`` (n_x, K, M) is that of all K steps of ``clock``.
    ``components`` are those of the truth, and ``angles`` those that are angles. If the sensors are
    ``in_one_file``, they have one clock, and so are tried together.
    """
    if not samples or len(clock.times) < 2:
        return []
    runs = np.flatnonzero(np.isfinite(truth).any(axis=(0, 1)))[:_MOST_RUNS]
    truth = truth[..., runs]
    samples = [_thinned(sample, runs) for sample in samples]
    groups = [samples]
    if not in_one_file:
        groups = [[sample] for sample in samples]
    interval = float(np.median(np.diff(clock.times)))
    span = _LONGEST_DELAY_STEPS * interval
    if not clock.counts_steps:
        span = max(span, _LONGEST_DELAY)
    angle_rows = [row for row, name in enumerate(components) if name in angles]
    texts = []
    for group in groups:

        def misfit(delay: float, group: list[_Sample] = group) -> float:
            """Return the mean log of the components' median distances, if measurements have this delay.

            It is in s, or steps. The misfit is infinite if too few measurements have a truth.
            """
            by_component: dict[str, list[Array]] = {}
            for sample in group:
                earlier = _truth_before(truth, clock.times, sample.indices, delay, angle_rows)
                distances = _distances(sample._replace(truth=earlier))
                for name, row in zip(sample.sensor.components, distances, strict=True):
                    by_component.setdefault(name, []).append(row[np.isfinite(row)])
            medians = []
            for rows in by_component.values():
                known = np.concatenate(rows)
                if len(known) < _FEWEST_OF_DELAY:
                    return np.inf
                medians.append(max(float(np.median(known)), 1e-12))  # above 0, for the log
            return float(np.log(medians).mean())

        misfit_without_delay = misfit(0.0)
        if not np.isfinite(misfit_without_delay):
            continue
        # Search a coarse grid of delays, and then a fine one between the neighbors of the best.
        delays = np.linspace(-span, span, 2 * _DELAYS + 1)
        best = int(np.argmin([misfit(delay) for delay in delays.tolist()]))
        if best in (0, len(delays) - 1):
            continue  # the best delay may lie beyond the grid
        nearer = np.linspace(delays[best - 1], delays[best + 1], _DELAYS)
        misfits = [misfit(delay) for delay in nearer.tolist()]
        delay = float(nearer[int(np.argmin(misfits))])
        if min(misfits) > misfit_without_delay + np.log(_EXPLAINED_BY_DELAY):
            continue
        whose = joined([sample.name for sample in group])
        direction = "behind" if delay > 0.0 else "ahead of"
        unit = " steps" if clock.counts_steps else " s"
        texts.append(
            f"the measurements of {whose} seem to be some {abs(delay):.2g}{unit} {direction} the "
            "truth: check the clocks of both"
        )
    return texts


def _thinned(sample: _Sample, runs: Index) -> _Sample:
    """Return a sample with the numbered ``runs`` alone, and with at most `_MOST_STEPS` steps.

    A sensor that differs from step to step predicts one step at a time: `_FEW_STEPS` are kept then. Of
    the kept steps the sample has the numbers, ``steps``, and the ``indices`` among all of the recording.
    """
    most = _MOST_STEPS if is_equal_at_every_step(sample.sensor) else _FEW_STEPS
    kept = np.linspace(0, len(sample.steps) - 1, min(len(sample.steps), most)).astype(int)
    return sample._replace(
        truth=sample.truth[:, kept][..., runs],
        z=sample.z[:, kept][..., runs],
        steps=sample.steps[kept],
        indices=sample.indices[kept],
    )


def _truth_before(
    truth: Array, times: Array, chosen: Index, delay: float, angle_rows: Sequence[int]
) -> Array:
    """Interpolate the truth (n_x, K, M) at the times of the ``chosen`` steps less the ``delay``.

    The result (n_x, number of chosen steps, M) is NaN outside the known truth. ``times`` (K,) are those
    of the truth, in the unit of the delay. ``angle_rows`` are the components that are angles.
    """
    wanted = times[chosen] - delay
    earlier = np.full((len(truth), len(chosen), truth.shape[2]), np.nan)
    for m in range(truth.shape[2]):
        for row, values in enumerate(truth[:, :, m]):
            known = np.isfinite(values)
            if known.sum() < 2:
                continue
            known_values = values[known]
            if row in angle_rows:
                known_values = np.unwrap(known_values)
            earlier[row, :, m] = np.interp(
                wanted, times[known], known_values, left=np.nan, right=np.nan
            )
    return earlier


def _other_axes_or_directions(
    sample: _Sample,
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
    angles = [row for row, name in enumerate(measured) if name in _AZIMUTHS]
    headings = [row for row, name in enumerate(components) if name in _HEADINGS]
    # Step 1: change the measured angles of the sample, or the axes of its truth, by each known mistake.
    changed: dict[str, _Sample] = {}
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
    remaining = {change: _median_distance(_distances(each)) for change, each in changed.items()}
    # Measurements near the truth, as those of a path near the diagonal, must fit it after the change.
    most = _MOST_REMAINING * size
    if not is_beyond:
        most = min(most, _FITS)
    change = min(directions or remaining, key=lambda name: remaining[name])
    if remaining[change] > most:
        change = min(remaining, key=lambda name: remaining[name])
    if remaining[change] > most:
        moved = _other_origin(sample, axes, most)
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
    return f"; they agree if the truth is {change}: {hint}"


def _other_origin(sample: _Sample, axes: tuple[tuple[int, int], ...], most: float) -> str:
    """Return the end of a note, with the distance by which the truth is moved; empty if none serves.

    After it the median distance of a sensor of positions must be at most ``most``, in standard
    deviations, and so small that it fits the truth (`_FITS`). ``axes`` are pairs of rows of the truth:
    those of x and y, and those of vx and vy if it has them, which another origin does not change.
    """
    if tuple(map(plain_name, sample.sensor.components)) != PLACE:
        return ""
    position = np.array(axes[0])
    offset = np.nanmedian((sample.z - sample.truth[position]).reshape(2, -1), axis=1)
    truth = sample.truth.copy()
    truth[position] += offset[:, None, None]
    if _median_distance(_distances(sample._replace(truth=truth))) > min(most, _FITS):
        return ""
    x, y = (f"{value:.0f}" for value in offset)
    return f"{_MOVED}[{x}, {y}] m: do both count from one origin?"


def _direction_in_file(sample: _Sample, sign: int, quarters: int) -> str:
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


def _other_heading(sample: _Sample, components: Sequence[str], size: float) -> str:
    """Return the end of a note, with the other direction of headings by which landmarks agree.

    Bearings may count from the axis x or from north, and not from the heading, or the heading of the
    truth may count clockwise from north, as a compass does. The text is empty if none explains the
    median distance ``size`` of measurements from what the truth predicts, in standard deviations.
    ``components`` are those of the truth.
    """
    rows = [row for row, name in enumerate(components) if name in _HEADINGS]
    angles = [row for row, name in enumerate(sample.sensor.components) if name in _AZIMUTHS]
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
    remaining = {text: _median_distance(_distances(each)) for text, each in changes.items()}
    best = min(remaining, key=lambda text: remaining[text])
    # The distance that remains must be one of noise, and a small share of that before the change.
    if remaining[best] > min(_FITS, _MOST_REMAINING * size):
        return ""
    return f"; they agree {best}"


def _other_height(sample: _Sample, components: Sequence[str], size: float) -> str:
    """Return the end of a note, with the change of measured heights by which both agree.

    Heights may be higher by a constant, as those above the ellipsoid are than those above the sea, or in
    another unit. They then differ by a constant, too, as z counts from the height of the origin. The
    text is empty if no change explains the median distance ``size`` of measurements from what the truth
    predicts, in standard deviations. ``components`` are those of the truth.
    """
    rows = [row for row, name in enumerate(sample.sensor.components) if plain_name(name) == "z"]
    heights = [row for row, name in enumerate(components) if plain_name(name) == "z"]
    if len(rows) != 1 or len(heights) != 1 or len(sample.sensor.components) < 2:
        return ""
    texts: dict[float, str] = {1.0: ""}
    for units, factor in _FACTORS.items():
        for ratio in (factor, 1.0 / factor):
            texts[ratio] = f"if its z is multiplied by {two_digits(ratio)}: are {units} mixed up?"
    for ratio, text in texts.items():
        z = sample.z.copy()
        z[rows] *= ratio
        # The same sensor's median height above the truth.
        offset = float(np.nanmedian(z[rows] - sample.truth[heights]))
        z[rows] -= offset
        # The distance that remains must be one of noise, and a small share of that before the change.
        if _median_distance(_distances(sample._replace(z=z))) > min(_FITS, _MOST_REMAINING * size):
            continue
        if ratio == 1.0:
            direction = "lower" if offset > 0.0 else "higher"
            reason = "do both count from the ellipsoid, or from the sea?"
            return f"; they agree if its z is {direction} by {abs(offset):.3g} m: {reason}"
        return f"; they agree {text} See `units`"
    return ""


def _other_unit(
    sample: _Sample, axes: tuple[tuple[int, int], ...], components: Sequence[str], size: float
) -> str:
    """Return the end of a note that names the factor of a wrong unit, if measurements then fit.

    It is empty if no usual factor explains the distances. ``axes`` are pairs of rows of the truth: those
    of x and y, and those of vx and vy if it has them. ``components`` are its components, and ``size`` is
    the median distance of measurements from what the truth predicts, without any change, in standard
    deviations.
    """
    # Step 1: multiply the measured lengths or angles, or those of the truth, by each usual factor.
    measured = sample.sensor.components
    angles = [row for row, name in enumerate(measured) if name in (*_AZIMUTHS, "elevation")]
    lengths = [row for row in range(len(measured)) if row not in angles]
    # Rates of ranges may have a unit of their own.
    without_rates = [row for row in lengths if measured[row] != "range_rate"]
    headings = [row for row, name in enumerate(components) if name in _HEADINGS]
    in_space = [row for row, name in enumerate(components) if plain_name(name) in ("z", "vz")]
    planar = [row for pair in axes for row in pair]
    changes: list[tuple[str, str, _Sample]] = []
    for units, factor in (*_FACTORS.items(), _DEGREES):
        is_angle = units == _DEGREES[0]
        for ratio in (factor, 1.0 / factor):
            groups = [angles] if is_angle else [lengths, without_rates]
            for rows in filter(None, groups):
                z = sample.z.copy()
                z[rows] *= ratio
                quantities = " and ".join(measured[row] for row in rows)
                verb = "is" if len(rows) == 1 else "are"
                text = f"if its {quantities} {verb} multiplied by {two_digits(ratio)}"
                changes.append((text, units, sample._replace(z=z)))
            groups = [headings] if is_angle else [[*planar, *in_space]]
            for rows in filter(None, groups):
                truth = sample.truth.copy()
                truth[rows] *= ratio
                quantities = " and ".join(components[row] for row in rows)
                verb = "is" if len(rows) == 1 else "are"
                text = f"if {quantities} of the truth {verb} multiplied by {two_digits(ratio)}"
                changes.append((text, units, sample._replace(truth=truth)))
    # Step 2: take the factor after which measurements are nearest to the truth.
    remaining = [_median_distance(_distances(changed)) for _, _, changed in changes]
    best = int(np.argmin(remaining))
    # The distance that remains must be one of noise, and a small share of that before the change.
    if remaining[best] > min(_FITS, _MOST_REMAINING * size):
        return ""
    text, units, _ = changes[best]
    return f"; they agree {text}: are {units} mixed up? See `units`"


def _other_place(sample: _Sample, landmark: Landmark, size: float) -> str:
    """Return the end of a note that names the place of a landmark which its measurements fit.

    It is empty if they fit no place. ``size`` is the median distance of measurements from what the truth
    and the landmark's own place predict, in standard deviations.
    """
    # Step 1: a place in another unit. The distance that remains must be one of noise, and a small share
    # of that with the landmark's own place.
    place = np.array(landmark.at)
    most = min(_FITS, _MOST_REMAINING_AT_PLACE * size)
    for units, factor in _FACTORS.items():
        for ratio in (factor, 1.0 / factor):
            remaining = _median_distance(_distances(_at_place(sample, landmark, ratio * place)))
            if remaining <= most:
                words = f"they agree if its place `at` is multiplied by {two_digits(ratio)}"
                return f"; {words}: are {units} mixed up?"
    best = place
    least = size
    # Step 2: any place, by Gauss-Newton from several places, as ranges alone may fit on either side of a
    # straight path: from the landmark's own, the middle of the path, and the landmark mirrored there.
    positions = sample.truth[[landmark.state.index(name) for name in ("px", "py")]]
    middle = np.nanmedian(positions.reshape(2, -1), axis=1)
    for begin in (place, middle, 2.0 * middle - place):
        fitted = _fitted_place(sample, landmark, begin)
        remaining = _median_distance(_distances(_at_place(sample, landmark, fitted)))
        if remaining < least:
            best = fitted
            least = remaining
    if least > most:
        return ""
    x, y = (f"{value:.2f}" for value in best)
    return f"; they agree if it is at [{x}, {y}]: check `at`"


def two_digits(ratio: float) -> str:
    """Write a factor with two digits and without an exponent: 0.001, 57, 1000."""
    return f"{float(f'{ratio:.2g}'):g}"


def _at_place(sample: _Sample, landmark: Landmark, place: Array) -> _Sample:
    """Return the sample with its landmark at another ``place`` (2,), m."""
    x, y = place.tolist()
    return sample._replace(sensor=replace(landmark, at=(x, y)))


def _fitted_place(sample: _Sample, landmark: Landmark, place: Array) -> Array:
    """Fit the place (2,) of a landmark, m, to its measurements by Gauss-Newton with Huber's weights.

    The iteration begins at ``place``. If a step is not finite, the place before it is returned.
    """
    h = 1e-4  # m, of the difference quotients
    for _ in range(_ITERATIONS):
        error = _errors(_at_place(sample, landmark, place))  # in standard deviations
        columns = []
        for step in ((h, 0.0), (0.0, h)):
            moved = _errors(_at_place(sample, landmark, place + step))
            columns.append((moved - error) / h)
        known = np.isfinite(error)
        J = np.stack([column[known] for column in columns], axis=-1)
        r = error[known]
        weight = np.minimum(1.0, _HUBER / np.maximum(np.abs(r), 1e-12))
        # Where a bearing jumps by 2 pi, the quotient is no derivative.
        weight = np.where((np.abs(J) < _STEEPEST).all(axis=-1), weight, 0.0)
        # The small diagonal keeps A regular where no measurement shows a direction.
        A = J.T @ (weight[:, None] * J) + 1e-9 * np.eye(2)
        change = np.linalg.solve(A, -J.T @ (weight * r))
        if not np.isfinite(change).all():
            return place
        place = place + change
        if np.abs(change).max() < 1e-4:  # m
            break
    return place


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


def _errors(sample: _Sample) -> Array:
    """Compute ``(z - h(x)) / sigma`` (n_z, N) of all N steps and runs of a sample; NaN where unknown."""
    truth = sample.truth
    z = sample.z
    if is_equal_at_every_step(sample.sensor):
        # All steps and runs are one batch of one step, for which the first one stands below.
        truth = truth.reshape(len(truth), 1, -1)
        z = z.reshape(len(z), 1, -1)
    errors = []
    with np.errstate(all="ignore"):
        for i, step in enumerate(sample.steps[: truth.shape[1]].tolist()):
            predicted = sample.sensor.measurement(truth[:, i], step)
            error = sample.sensor.innovation(z[:, i], predicted.mean)
            variance = np.einsum("ii...->i...", predicted.cov)
            if variance.ndim == 1:  # one for all runs
                variance = variance[:, None]
            errors.append(error / np.sqrt(variance))
    return np.concatenate(errors, axis=-1)


def _distances(sample: _Sample) -> Array:
    """Compute ``|z - h(x)| / sigma`` (n_z, N) of all N steps and runs of a sample; NaN where unknown."""
    return np.abs(_errors(sample))


def _largest_distances(distances: Array) -> Array:
    """Return the largest distance of each measurement, of the distances (n, N) of its n components.

    Measurements without a known distance are left out.
    """
    largest = np.nanmax(np.where(np.isfinite(distances), distances, -1.0), axis=0)
    return np.asarray(largest[largest >= 0.0])


def _median_distance(distances: Array) -> float:
    """Return the median of the largest distance of each measurement; infinite if none is known.

    ``distances`` (n, N) are those of the components.
    """
    sizes = _largest_distances(distances)
    if not len(sizes):
        return np.inf
    return float(np.median(sizes))
