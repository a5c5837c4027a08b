"""Keys of a config on recorded data: files, columns, units, zones, inputs and truth."""

from dataclasses import dataclass, field
from typing import Literal

from trackbench.errors import counted, form_for
from trackbench.field_types import DataFile, InvalidKeyError, Positive, freeze_mappings
from trackbench.models.component_names import position_velocity_names
from trackbench.scenarios.recordings.naming_of_columns import Naming


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordingKeys(Naming):
    """Keys of a config on recorded data, which name its files and how they are read."""

    measurements: DataFile | tuple[DataFile, ...]
    """CSV or Parquet, or a list, a file for each sensor; a pattern (data/*.csv) has a file per run"""
    measurement_naming: tuple[Naming, ...] = ()
    """columns and units of each file in the list `measurements`, in its order; a key or a column that
    one of them does not name is that of the target"""
    truth: DataFile | None = None
    """CSV or Parquet of the state, at times of its own: px, py (or x, y), and perhaps velocities"""
    truth_gap: Positive | None = None
    """longest time between two rows of the truth, s (or steps), within which it is interpolated on a
    straight line; default: it counts at its own times only"""
    truth_naming: Naming | None = None
    """columns and units of the truth; default: as of the measurements, but for their `format`"""
    runs: tuple[str | int, ...] = ()
    """names of the runs that are taken, in this order; default: all"""
    sensors: tuple[str | int, ...] = ()
    """names in the column `sensor`, in the order of the scenario's sensors; default: 1, 2, ..."""
    input: dict[str, str] = field(default_factory=dict)
    """columns of known inputs, by the names that motions use: {v: odometry_speed, w: yaw_rate}; their
    units are among `units`"""
    input_file: DataFile | None = None
    """CSV or Parquet of the inputs, at times of its own; default: the file of the measurements"""
    input_naming: Naming | None = None
    """columns of the times and runs of `input_file`, and units of its times and of the inputs; default:
    as of the measurements, but for their `format`"""
    input_holds: Literal["before", "after"] = "before"
    """when the values of a row hold: before its time, back to the row before, as wheels measure them, or
    after it, until the next row, as commands do"""
    input_gap: Positive | None = None
    """longest time between two rows over which inputs hold, s (or steps); default: 1.5 usual ones"""
    resample: Positive | None = None
    """seconds between steps, for filters that need equal ones: a measurement counts at the nearest"""
    axes: Literal[0, 1, 2, 3] = 2
    """axes of the space it moves in; 0: its state is one number, x"""
    state: tuple[str, ...] = ()
    """names of the components of another state, in order, which are also columns of the truth"""
    angles: tuple[str, ...] = ()
    """components that are angles, equal after whole turns: {angles: [heading]}; default: those of the
    motion that filters assume, and those that a sensor measures alone as an angle"""

    def __post_init__(self) -> None:
        super().__post_init__()
        freeze_mappings(self)
        if not self.input:
            for key in ("input_file", "input_gap", "input_naming"):
                if getattr(self, key) is not None:
                    raise InvalidKeyError("there is no `input`", key)
        if self.input_naming is not None:
            self._check_input_naming(self.input_naming)
        for i, name in enumerate(self.angles):
            if name not in self.components:
                message = f"{name!r} is not one of {', '.join(self.components)}"
                raise InvalidKeyError(message, "angles", i)
        self._check_measurement_naming()
        if self.truth is None:
            if self.truth_gap is not None:
                raise InvalidKeyError("there is no truth", "truth_gap")
            if self.truth_naming is not None:
                raise InvalidKeyError("there is no truth", "truth_naming")
        truth_origin = () if self.truth_naming is None else self.truth_naming.origin
        if self.origin and truth_origin not in ((), self.origin):
            message = "is not that of the target, and both count from one point: leave it out"
            raise InvalidKeyError(message, "truth_naming", "origin")

    def _check_input_naming(self, naming: Naming) -> None:
        """Raise InvalidKeyError if the keys of the file of the inputs contradict those of the target."""
        if self.input_file is None:
            message = "there is no `input_file`, and the file of the measurements has their names"
            message += " and units"
            raise InvalidKeyError(message, "input_naming")
        for name in self.input:
            if name in naming.columns:
                message = (
                    f"the column of an input stands in `input`: {{{name}: {naming.columns[name]}}}"
                )
                raise InvalidKeyError(message, "input_naming", "columns", name)
            if name in self.units:
                way = f"`input_naming: {{units: {{{name}: {self.units[name]}}}}}`"
                message = f"its file has `input_naming`, so write the unit there, {way}"
                raise InvalidKeyError(message, "units", name)

    def _check_measurement_naming(self) -> None:
        """Raise InvalidKeyError for namings that do not fit the files, or have an origin."""
        namings = len(self.measurement_naming)
        files = len(self.measurement_files)
        if namings and not isinstance(self.measurements, tuple):
            message = "is of several files: write columns and units of one file into the target"
            raise InvalidKeyError(message, "measurement_naming")
        if namings not in (0, files):
            entries = form_for(namings, "entry", "entries")
            message = (
                f"{namings} {entries} for {counted(files, 'file')}: write one for each; {{}} has"
            )
            message += " the target's keys"
            raise InvalidKeyError(message, "measurement_naming")
        for i, naming in enumerate(self.measurement_naming):
            if naming.origin:
                message = "all files count from one point: write it into the target"
                raise InvalidKeyError(message, "measurement_naming", i, "origin")

    @property
    def measurement_files(self) -> tuple[str, ...]:
        """Files of the measurements, of which there may be one alone."""
        if isinstance(self.measurements, tuple):
            return self.measurements
        return (self.measurements,)

    @property
    def namings(self) -> tuple[Naming, ...]:
        """Columns and units of each file of measurements: its own, completed by those of the target."""
        if not self.measurement_naming:
            return (self,) * len(self.measurement_files)
        return tuple(naming.with_defaults(self) for naming in self.measurement_naming)

    @property
    def components(self) -> tuple[str, ...]:
        """Names of the components of the state, and so of the truth, in order."""
        if self.state:
            return self.state
        if self.axes:
            return position_velocity_names(self.axes)
        return ("x",)  # without axes the state is one number
