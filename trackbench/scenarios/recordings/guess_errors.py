"""Errors and speeds that a recording shows, for a first try of filters."""

from collections.abc import Callable, Sequence

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.conversions import SEMI_MAJOR_AXIS
from trackbench.field_types import decimals
from trackbench.scenarios.recordings.column_mapping import UNITS, Naming
from trackbench.scenarios.recordings.csv_tables import number, parsed
from trackbench.scenarios.recordings.rows import Rows

SENSORS = {
    "position": ("x", "y"),
    "range-azimuth": ("range", "azimuth"),
    "range": ("range",),
    "bearing": ("azimuth",),
}
"""Types of sensors that a table may hold, the most telling first, and what they measure."""
_ONE_SIGMA = 0.683  # of a normal law's values are within its standard deviation
_SAME_WAY = 0.8  # cosine between directions that agree
_NEAR = 0.07  # of a ratio of speeds


def velocities_agree(
    rows: Rows, columns: dict[str, str], units: dict[str, str], why: dict[str, str]
) -> bool:
    """Compare measured velocities with the positions, and add the unit that they need to agree."""
    lag = max(1, len(rows.time) // 20)
    passed = rows.time[lag:] - rows.time[:-lag]
    gone = (rows.values[:2, lag:] - rows.values[:2, :-lag]) / np.where(passed > 0, passed, np.nan)
    shown = 0.5 * (rows.values[2:, lag:] + rows.values[2:, :-lag])
    sizes = np.hypot(*gone), np.hypot(*shown)
    moving = (sizes[0] > 0.0) & (sizes[1] > 0.0)
    if not moving.any():
        return False
    alike = (gone * shown).sum(axis=0)[moving] / (sizes[0] * sizes[1])[moving]
    if np.median(alike) < _SAME_WAY:
        return False
    names = [name for name in ("speed", "vx", "vy") if name in columns]
    if any(name in units for name in names):
        return True
    if columns.get("speed", "").lower() in ("sog", "speedoverground"):
        units["speed"], why["speed"] = "kn", "guess: speed over ground mostly is in knots"
        return True
    ratio = float(np.median(sizes[1][moving]) / np.median(sizes[0][moving]))
    away = {unit: abs(ratio * UNITS[unit] - 1.0) for unit in ("m/s", "kn", "km/h", "mph", "ft/s")}
    unit = min(away, key=lambda name: away[name])
    units |= dict.fromkeys(names, unit)
    why |= dict.fromkeys(names, "guess: agrees with the positions")
    return away[unit] < _NEAR


def levels_of(rows: Rows, kind: str, in_degrees: bool) -> tuple[tuple[float, ...], float]:
    """Estimate deviations of the quantities and the usual speed, of whole rows in order."""
    time, values = rows.time, [*rows.values]
    if "azimuth" in SENSORS[kind]:
        values[-1] = np.unwrap(values[-1] * UNITS["deg"] if in_degrees else values[-1])
    sigmas = tuple(_scatter(time, value) for value in values)
    if kind == "range-azimuth":
        r, a = values
        values = [r * np.cos(a), r * np.sin(a)]
    return sigmas, 0.0 if kind == "bearing" else _speed(time, *values)


def not_finer(
    sigmas: Sequence[float],
    quantities: Sequence[str],
    naming: Naming,
    cells: Callable[[str], list[str]],
) -> tuple[float, ...]:
    """Raise deviations of errors to the step of the last digit in the ``cells`` of a column."""
    out = []
    for name, sigma in zip(quantities, sigmas, strict=False):  # those of velocities come after
        latlon = {"x": "longitude", "y": "latitude"} if name not in naming.columns else {}
        source = latlon.get(name, name)
        texts = [cell.replace(",", ".") for cell in cells(naming.columns[source])]
        finite = np.flatnonzero(np.isfinite(parsed(number, texts)[0]))
        digits = max((decimals(texts[i]) for i in finite), default=0)
        step = 10.0**-digits * naming.scale(source) * (SEMI_MAJOR_AXIS if latlon else 1.0)
        out.append(max(sigma, float(f"{step:.1g}")))
    return tuple(out)


def _scatter(time: Array, value: Array) -> float:
    """Estimate the errors' deviation, from distances to the line between neighbors."""
    wide = time[2:] - time[:-2]
    if len(value) < 3 or not (wide > 0.0).any():
        return 1.0
    share = (time[1:-1] - time[:-2]) / np.where(wide > 0.0, wide, np.nan)
    # e = z_1 - (1 - s) z_0 - s z_2 has the variance sigma^2 (1 + s^2 + (1 - s)^2).
    off = value[1:-1] - (1.0 - share) * value[:-2] - share * value[2:]
    size = np.abs(off) / np.sqrt(1.0 + np.square(share) + np.square(1.0 - share))
    # 68.3 % of the scaled |e| are below sigma.
    sigma = float(np.nanquantile(size, _ONE_SIGMA))
    # A straight line leaves rounding errors alone.
    return float(f"{sigma:.1g}") if sigma > 1e-12 * np.abs(value).max() else 1.0


def _speed(time: Array, *place: Array) -> float:
    """Estimate the usual speed, m/s, over a tenth of the recording, where errors matter less."""
    lag = max(1, len(time) // 10)
    if len(time) <= lag:
        return 1.0
    gone = np.sqrt(np.sum([np.square(axis[lag:] - axis[:-lag]) for axis in place], axis=0))
    passed = time[lag:] - time[:-lag]
    return float(np.median(gone[passed > 0] / passed[passed > 0]))
