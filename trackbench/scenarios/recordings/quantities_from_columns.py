"""Quantities from the columns of a table: which columns determine each one, and its values in SI."""

import re
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from functools import cached_property
from itertools import chain
from math import pi

import numpy as np

from trackbench.core.angles import wrap_angle
from trackbench.core.arrays import Array, Index, Mask
from trackbench.core.elementary import cos_sin
from trackbench.core.latitude_longitude import Geodetic
from trackbench.errors import Answer
from trackbench.field_types import DataError, Place
from trackbench.scenarios.recordings.east_north_up_axes import (
    Frame,
    filled_positions,
    positions_in_frames,
    velocities_in_frames,
)
from trackbench.scenarios.recordings.hemispheres import (
    HEMISPHERES,
    HemisphereColumn,
    apply_hemisphere,
    hemisphere_columns,
)
from trackbench.scenarios.recordings.impossible_values import impossible
from trackbench.scenarios.recordings.label_column_names import names_object
from trackbench.scenarios.recordings.missing_cells import blank_codes
from trackbench.scenarios.recordings.naming_of_columns import (
    PLANE_AXES,
    VELOCITY_AXES,
    Naming,
    NamingKeys,
    explain_missing_column,
)
from trackbench.scenarios.recordings.outliers_and_no_fix import (
    notes_on_outliers,
    rows_with_fix,
)
from trackbench.scenarios.recordings.parse_tables import (
    MISSING_LABEL,
    Content,
    Table,
    first_rows,
    header,
    read_table,
)
from trackbench.scenarios.recordings.quantity_keys import (
    COURSE,
    GEODETIC,
    QUATERNION,
    STAMP_PARTS,
    plain_name,
)
from trackbench.scenarios.recordings.quaternions import Quaternions, empty_non_rotations
from trackbench.scenarios.recordings.weeks_or_nanoseconds import seconds_of_parts

_ROUNDING = 1e-6
"""rad by which a written angle may exceed a whole turn"""
_SAMPLE = 1000  # rows that show which columns hold words


class Columns:
    """Sources of one table's quantities: their own columns, or others that determine them."""

    def __init__(
        self,
        path: str,
        naming: Naming,
        wanted: Sequence[str],
        least: int = 1,
        in_space: bool = False,
        keys: NamingKeys | None = None,
    ) -> None:
        """Find the columns of a file for the ``wanted`` quantities; `read` reads them.

        Raises DataError if fewer than ``least`` of them exist. Heights are used only for a target
        ``in_space``, since x and y in the plane do not depend on them. ``keys`` are those of the config
        that have the names of columns, for messages; by default those of a file of measurements.
        """
        self.path = path
        self.naming = naming
        self._keys = keys or NamingKeys()
        self.names = header(path, naming.format)
        self.in_space = in_space
        self.contents: dict[str, Content] = {}
        """what the cells are, by the name of each column that is read"""
        self.unavailable: Counter[str] = Counter()
        """number of cells with a code for "not available", by quantity and code, as speed 102.3"""
        self.far: list[str] = []
        """notes on numbers far outside the others of their column"""
        self.notices: list[str] = []
        """other notes to the user"""
        self._used: dict[str, str] = {}
        """quantity, or key such as ``time``, by the name of each column that is read"""
        self._hemispheres: dict[str, HemisphereColumn] = {}
        """columns of hemispheres, by latitude and longitude"""
        # Velocities beside latitude and longitude are those to the east and north of each row's own
        # position, and must be rotated to the axes of the origin. Those beside a radar's ranges or
        # angles are not: they are along the axes of the radar.
        has_planar_columns = any(self.column(name) is not None for name in ("x", "y"))
        is_on_earth = all(self.column(name) is not None for name in GEODETIC[:2])
        radar_quantities = {"range", "azimuth", "elevation", "range_rate"}
        is_radar = any(plain_name(name) in radar_quantities for name in wanted)
        self._rotates = is_on_earth and not has_planar_columns and not is_radar
        # Sources of each quantity: quantities with a column, itself or others that determine it.
        self._sources_of = {name: self._find_sources(name) for name in wanted}
        missing = [name for name, sources in self._sources_of.items() if not sources]
        if len(wanted) - len(missing) < least:
            name = missing[0]
            # Beside latitude and longitude a height comes from a column `altitude`.
            if plain_name(name) == "z" and is_on_earth:
                name = "altitude"
            raise self.missing_column(name, self._keys.quantities)
        for source in chain.from_iterable(self._sources_of.values()):
            self.take(source, "number")
        # Latitude and longitude may be there (`is_on_earth`) without a wanted quantity that needs them.
        if self.is_geodetic:
            self._take_hemispheres()

    @property
    def own_key(self) -> str:
        """Key of a naming of this file alone, as `truth_naming`; empty for a file of measurements."""
        return self._keys.own

    def column(self, name: str) -> str | None:
        """Return the column of the quantity ``name`` in this file; None without one."""
        return self.naming.column_of(name, self.names)

    def take(self, name: str, content: Content) -> str | None:
        """Select the column of a quantity, or of a key such as ``run``, to be read; return the column.

        ``name`` is the quantity or key. The cells are read as ``content``, such as numbers. Return None
        if there is no such column. Raises DataError if another quantity has the same column.
        """
        column = self.column(name)
        if column is not None:
            quantity = plain_name(name)
            other = self._used.setdefault(column, quantity)
            if other != quantity:
                message = (
                    f"column {column} is both {other} and {quantity}; a quantity has a column of"
                )
                raise self.mistake(f"{message} its own (see `columns`)")
            self.contents[column] = content
        return column

    def take_stamp_parts(self) -> list[str]:
        """Select the columns that the config names as further parts of the time; return their keys."""
        taken = []
        for name in STAMP_PARTS:
            if name in self.naming.columns and self.take(name, "number") is not None:
                taken.append(name)
        return taken

    def stamp_parts(self, table: Table, parts: Sequence[str]) -> Array | float:
        """Return the seconds (R,) that further columns, by their keys ``parts``, add to the time."""
        columns = {name: str(self.column(name)) for name in parts}
        return seconds_of_parts(self.path, table, columns, self.naming.units)

    def _with_remedy_for_label(self, place: Place) -> Place:
        """Return the place with advice if its mistake is that the name of a run or sensor is missing."""
        for column, key in self._used.items():
            is_label = self.contents.get(column) == "label"
            if is_label and place.message.startswith(f"{column}: {MISSING_LABEL}"):
                remedy = f'write it in each row, or say `columns: {{{key}: ""}}` to mix all rows'
                answer = Answer(f"columns.{key}", '""')
                return place._replace(message=f"{place.message}: {remedy}", answer=answer)
        return place

    def take_unnamed_runs(self) -> str | None:
        """Select and return a column that names objects, such as MMSI; None without one.

        Return None also if the config has the key ``run`` in `columns`: it names the column of the runs,
        or says by an empty name that all rows are one run, whichever object they are of.
        """
        if "run" in self.naming.columns:
            return None
        for name in self.names:
            if names_object(name) and name not in self._used:
                self._used[name] = "run"
                self.contents[name] = "label"
                return name
        return None

    def missing_clock(self) -> DataError:
        """Return the error for a table without a time and a step."""
        named = next((name for name in ("time", "step") if self.naming.columns.get(name)), None)
        return self.missing_column(named or "time or step", self._keys.clock)

    def missing_column(self, name: str, key: str) -> DataError:
        """Return the error for the quantity ``name`` without a column.

        ``key`` is the key of the config that names the columns. If it is ``columns``, which the file of
        measurements has, too, a further file may need a key of its own (`NamingKeys.own`).
        """
        return self.mistake(explain_missing_column(self.names, self.naming, self._keys, name, key))

    def mistake(self, message: str, answer: Answer | None = None) -> DataError:
        """Return the error for a mistake of the table as a whole; it names the file and no line.

        ``answer`` is the key that the message proposes.
        """
        return DataError(Place(self.path, 1, 1, message, answer))

    def read(self) -> Table:
        """Read the table, codes of "not available" as NaN. Raises DataError for impossible values."""
        try:
            table = read_table(
                self.path, self.contents, self.naming.time_format, self.naming.format
            )
        except DataError as error:
            raise DataError(*map(self._with_remedy_for_label, error.places)) from None
        # Found first, as the key `missing` may empty cells of 0.
        has_fix = self._rows_with_fix(table)
        # The codes of AIS for a speed and a course are possible values in other tables.
        first_words = {re.split("[^a-z]", name.lower())[0] for name in self.names}
        of_ais = not first_words.isdisjoint(("mmsi", "sog", "cog"))
        mistakes = []
        for column, quantity in self._used.items():
            if self.contents[column] != "number":
                continue
            values = table.columns[column]
            scale = self.naming.scale(quantity)
            # Blank the codes of "not available" first: most are impossible values.
            for code in self.naming.missing_numbers(quantity):
                self.unavailable[f"{quantity} {code:g}"] += int((values == code).sum())
                values[values == code] = np.nan
            self.unavailable += blank_codes(quantity, values, of_ais, scale)
            if quantity == "speed" and not self._uses_course:
                continue  # a speed without a course may be one along the heading, negative backward
            first_impossible = impossible(quantity, values, scale)
            if first_impossible is not None:
                line = int(table.lines[first_impossible.row])
                mistakes.append(Place(self.path, line, 1, f"{column}: {first_impossible.message}"))
        if mistakes:
            raise DataError(*mistakes)
        if any(sources == QUATERNION for sources in self._sources_of.values()):
            self._check_quaternions(table)
        for quantity in self._hemispheres:
            coordinate = self.column(quantity)
            assert coordinate is not None
            hemispheres = self._hemispheres[quantity]
            apply_hemisphere(self.path, table, quantity, coordinate, hemispheres)
        # Rows without a fix, at 0 N 0 E, are left out.
        if has_fix.all():
            return table
        return table.at(np.flatnonzero(has_fix))

    def _quaternions(self, table: Table) -> Quaternions:
        """Return the quaternions of the rows."""
        x, y, z, w = (self._values_in_si(table, name) for name in QUATERNION)
        return Quaternions(x=x, y=y, z=z, w=w)

    def _check_quaternions(self, table: Table) -> None:
        """Empty the cells of rows whose quaternion is no rotation, and add the notes on quaternions."""
        names = [str(self.column(name)) for name in QUATERNION]
        self.notices += empty_non_rotations(self.path, table, names, self._quaternions(table))

    def _rows_with_fix(self, table: Table) -> Mask:
        """Return a mask (R,) of the rows that are not at 0 N 0 E; add a note on the others."""
        if not self.is_geodetic:
            return np.ones(len(table.lines), dtype=np.bool_)
        latitude = self.column("latitude")
        longitude = self.column("longitude")
        assert latitude is not None
        assert longitude is not None
        scale = self.naming.scale("latitude")
        has_fix, note = rows_with_fix(table, latitude, longitude, scale)
        if note:
            self.notices.append(f"{self.path}: {note}")
        return has_fix

    def note_outliers(self, table: Table) -> None:
        """Add a note on each number of these rows that is far outside the others of its column."""
        quantities = {
            column: quantity
            for column, quantity in self._used.items()
            if self.contents[column] == "number"
        }
        self.far += notes_on_outliers(self.path, table, quantities, self.naming)

    @property
    def _uses_course(self) -> bool:
        """True if velocities are computed from speed and course."""
        return any("course" in sources for sources in self._sources_of.values() if len(sources) > 1)

    @property
    def is_geodetic(self) -> bool:
        """True if positions or velocities depend on latitude and longitude."""
        return any("latitude" in sources for sources in self._sources_of.values())

    @property
    def has_velocities_alone(self) -> bool:
        """True if the table has velocities along x and y, and no positions."""
        available = {plain_name(name) for name, sources in self._sources_of.items() if sources}
        has_planar_columns = any(self.column(name) is not None for name in ("x", "y"))
        return bool(available & {"vx", "vy"}) and not has_planar_columns

    def first_with_column(self, names: Collection[str]) -> str:
        """Return one of the quantities ``names`` that has a column of its own; empty without one.

        Of several it is the first one in the order of the wanted quantities. x and y from latitude and
        longitude, as an example, have no columns of their own.
        """
        for name, sources in self._sources_of.items():
            # A quantity is its own only source if it has a column. A velocity that is rotated to the
            # origin's axes also has the position as a source.
            if name in names and sources == (name,):
                return name
        return ""

    def geodetic_positions(self, table: Table, height: float) -> Geodetic:
        """Return latitude and longitude, rad, and height, m, (R,) each; all NaN where one is missing.

        ``height`` is that of all rows unless heights are read from a column, for a target in space.
        """
        latitude = self._values_in_si(table, "latitude")
        longitude = self._values_in_si(table, "longitude")
        heights = np.full_like(latitude, height)
        if self._has_heights:
            heights = self._values_in_si(table, "altitude")
        known = np.isfinite(latitude) & np.isfinite(longitude) & np.isfinite(heights)
        return Geodetic(
            latitude=np.where(known, latitude, np.nan),
            longitude=np.where(known, longitude, np.nan),
            height=np.where(known, heights, np.nan),
        )

    @property
    def _has_heights(self) -> bool:
        return "altitude" in chain.from_iterable(self._sources_of.values())

    def rows_without_height(self, table: Table) -> int:
        """Count the rows with latitude and longitude whose altitude is missing."""
        if not self._has_heights:
            return 0
        has_latitude = np.isfinite(self._values_in_si(table, "latitude"))
        has_longitude = np.isfinite(self._values_in_si(table, "longitude"))
        has_altitude = np.isfinite(self._values_in_si(table, "altitude"))
        return int((has_latitude & has_longitude & ~has_altitude).sum())

    def quantities(
        self, table: Table, positions: Geodetic | None, frames: Sequence[Frame], runs: Index
    ) -> dict[str, Array]:
        """Return the wanted quantities (R,) by name, in SI; NaN where there is no value.

        ``positions`` are those of the rows, None if no quantity depends on latitude and longitude.
        ``frames`` cover all rows with a position, and ``runs`` (R,) are the numbers of the rows' runs.
        """
        plane: Mapping[str, Array] = {}
        if positions is not None and frames:
            # Step 1: east, north and up of the origin, from latitude, longitude and altitude.
            plane = dict(zip(PLANE_AXES, positions_in_frames(positions, frames), strict=True))
        velocities: Mapping[str, Array] = {}
        if self._rotates and positions is not None and frames:
            velocities = self._rotated_velocities(table, positions, frames, runs)
        quantities = {}
        # Step 2: each quantity from its column, from speed and course, or from Step 1. Its sources are
        # the quantities whose columns are read for it; there are none if the file lacks the quantity.
        # Sources of x are (x,) or (latitude, longitude), those of vx are (vx,) or (speed, course). If
        # velocities are rotated, the sources of vx go on with vy, and with latitude and longitude.
        for name, sources in self._sources_of.items():
            if sources and name in velocities:
                quantities[name] = velocities[name]
            elif sources[:1] == (name,):
                quantities[name] = self._values_in_si(table, name)
            elif sources[:2] == COURSE:
                quantities[name] = self._velocity_of_course(table, name)
            elif sources == QUATERNION:
                heading = self._quaternions(table).heading
                quantities[name] = self._anticlockwise(heading, name)
            elif sources and plane:
                quantities[name] = plane[plain_name(name)]
            else:
                quantities[name] = np.full(len(table.lines), np.nan)
        return quantities

    def _rotated_velocities(
        self, table: Table, positions: Geodetic, frames: Sequence[Frame], runs: Index
    ) -> dict[str, Array]:
        """Return velocities (R,) by name along east, north and up of the origin.

        In the table they are along east, north and up of each row's own position, one of ``positions``.
        Each of the ``frames`` has an origin and its rows. ``runs`` (R,) are the numbers of the rows'
        runs.
        """
        # A row without a position gets that of another row of its run.
        known_positions = filled_positions(positions, runs)
        rotated_velocities: dict[str, Array] = {}
        sensors = {
            name.rpartition(".")[0]
            for name in self._sources_of
            if plain_name(name) in VELOCITY_AXES
        }
        for sensor in sorted(sensors):
            # Step 1: take the components that the table has. A missing velocity upwards is zero.
            components: dict[str, Array] = {}
            for plain in VELOCITY_AXES:
                name = f"{sensor}.{plain}" if sensor else plain
                if self.column(name) is not None:
                    components[name] = self._values_in_si(table, name)
                elif plain != "vz" and all(map(self.column, COURSE)):
                    components[name] = self._velocity_of_course(table, plain)
            names = list(components)
            if [plain_name(name) for name in names[:2]] != ["vx", "vy"]:
                continue  # only a whole velocity can be rotated
            vectors = np.zeros((3, len(table.lines)))
            vectors[: len(names)] = list(components.values())
            # Step 2: rotate the velocities of each origin's rows into its axes.
            rotated = velocities_in_frames(vectors, known_positions, frames)
            for name, velocity in zip(names, rotated, strict=False):
                rotated_velocities[name] = velocity
        return rotated_velocities

    def _find_sources(self, name: str) -> tuple[str, ...]:
        """Return the quantities whose columns determine the quantity ``name``; empty without them.

        These are the quantity itself, geodetic coordinates, speed and course, or a quaternion.
        Velocities along east and north of the row's own position are rotated to the origin's axes
        (`_rotates`), so that they also depend on the position.
        """
        plain = plain_name(name)
        if self.column(name) is not None:
            # The rotation takes all components and the position.
            if self._rotates and plain in VELOCITY_AXES:
                return (name, *self._other_components(name), "latitude", "longitude")
            return (name,)
        if name == "heading" and all(map(self.column, QUATERNION)):
            return QUATERNION
        # x and y need latitude and longitude; z, which is wanted in space only, the altitude, too.
        needed = GEODETIC if plain == "z" else GEODETIC[:2]
        if plain in PLANE_AXES and all(map(self.column, needed)):
            # In space x and y depend on the height, too, as the tangent plane touches the ground at one
            # point only.
            if self.in_space and self.column("altitude"):
                return GEODETIC
            return GEODETIC[:2]
        if plain in ("vx", "vy") and all(map(self.column, COURSE)):
            if self._rotates:
                return (*COURSE, "latitude", "longitude")
            return COURSE
        return ()

    def _other_components(self, name: str) -> tuple[str, ...]:
        """Return the other components of the velocity ``name`` that the table has, for its rotation."""
        sensor, dot, plain = name.rpartition(".")
        others = (f"{sensor}{dot}{other}" for other in VELOCITY_AXES if other != plain)
        return tuple(other for other in others if self.column(other) is not None)

    def _values_in_si(self, table: Table, name: str) -> Array:
        """Return the values (R,) of the quantity ``name`` in SI, with angles that count anticlockwise.

        An azimuth then counts from x to y, and a bearing from the heading to the left, even if it is
        clockwise in the file.
        """
        column = self.column(name)
        assert column is not None
        scale = self.naming.scale(name)
        values = table.columns[column]
        if scale != 1.0:
            values = values * scale
        return self._anticlockwise(values, name)

    def _anticlockwise(self, values: Array, name: str) -> Array:
        """Return the values (R,) in SI of the quantity ``name``, from x to y if they are clockwise."""
        if not self.naming.is_clockwise(name):
            return values
        # From clockwise from north to anticlockwise from east (x): a = pi / 2 - c. A bearing is zero
        # ahead in both directions. Angles beyond a turn stay as they are, and are reported later.
        zero = 0.0 if plain_name(name) == "bearing" else 0.5 * pi
        turned = wrap_angle(zero - values)
        return np.where(np.abs(values) > 2.0 * pi + _ROUNDING, values, turned)

    def _velocity_of_course(self, table: Table, name: str) -> Array:
        """Return the velocity (R,), m/s, along x for the quantity vx, and along y otherwise.

        It comes from a speed and a course clockwise from north.
        """
        speed = self._values_in_si(table, "speed")
        course = self._values_in_si(table, "course")
        c, s = cos_sin(np.where(np.isnan(course), 0.0, course))
        # vx = v sin(course), vy = v cos(course)
        velocity = speed * (s if plain_name(name) == "vx" else c)
        return np.where(np.isnan(course), np.nan, velocity)

    def _take_hemispheres(self) -> None:
        """Select the columns of hemispheres, named by the config or recognized by their first cells."""
        for quantity, (key, *_) in HEMISPHERES.items():
            column = self.take(key, "word")
            if column is not None:
                self._hemispheres[quantity] = HemisphereColumn(column, is_named=True)
        if len(self._hemispheres) == len(HEMISPHERES):
            return
        # The config names a column, or says by an empty name that there is none.
        answered = {
            quantity
            for quantity, (key, *_) in HEMISPHERES.items()
            if quantity in self._hemispheres or key in self.naming.columns
        }
        unread = {
            name: cells for name, cells in self.first_cells.items() if name not in self.contents
        }
        for quantity, name in hemisphere_columns(unread, answered).items():
            self.contents[name] = "word"
            self._hemispheres[quantity] = HemisphereColumn(name, is_named=False)

    @cached_property
    def first_cells(self) -> dict[str, tuple[str, ...]]:
        """First cells of each column."""
        rows = first_rows(self.path, self.naming.format, _SAMPLE)
        columns = zip(*rows, strict=True)
        return dict(zip(self.names, columns, strict=False))

    def take_words(self, column: str) -> bool:
        """Select a further column to be read as words; return False if it is read already.

        Return False also if two columns have this name, as `read_table` refuses to read them.
        """
        if column in self.contents or self.names.count(column) > 1:
            return False
        self.contents[column] = "word"
        return True
