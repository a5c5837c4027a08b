"""Places of sensors, and the origin, that the user must write into a new config."""

from collections.abc import Sequence
from typing import Any

from trackbench.scenarios.recordings.guess_record import Guess, SensorGuess
from trackbench.scenarios.recordings.guess_truth import TruthGuess
from trackbench.scenarios.recordings.new_config_filters import LOCATING
from trackbench.scenarios.recordings.new_config_first_state import (
    POSE,
    FirstState,
    pose_in_words,
    unknown_words,
)
from trackbench.scenarios.recordings.new_config_further_tables import FurtherTables


def unknown_places(
    guess: Guess, tables: FurtherTables, first_state: FirstState | None = None
) -> list[str]:
    """Return words for the sensors and other places whose position the user must write into the config.

    Their places are unknown by the ``tables``, and the pose of a robot at the start by the
    ``first_state`` of the filters.
    """
    # Only the log of a robot has inputs.
    unnamed = "the landmark" if guess.inputs else "the sensor"
    names = []
    for sensor in guess.sensors:
        if lacks_place(guess, sensor) and tables.place_of(sensor.name) is None:
            names.append(sensor.name or unnamed)
    # A robot starts at a pose that a truth may show. The filters of a target start from the first scan
    # of a sensor that measures positions or ranges and azimuths (LOCATING), or else at a place that the
    # user must write.
    if guess.inputs:
        missing = unknown_words(pose_in_words(first_state))
        if len(missing) == len(POSE):
            names.append("the start")
        else:
            names += [f"the {word} of the start" for word in missing]
    elif not {sensor.kind for sensor in guess.sensors} & LOCATING:
        names.append("the start")
    if lacks_origin(guess, tables.truth):
        names.append(origin_name(guess))
    return names


def origin_name(guess: Guess) -> str:
    """Return words for the point x = y = 0: the radar, if it alone has no latitude and longitude."""
    planar_kinds = []
    for file in guess.each_file:
        if not _has_geodetic_positions(file):
            planar_kinds += [sensor.kind for sensor in file.sensors]
    return "the radar" if planar_kinds == ["range-azimuth"] else "the origin"


def _has_geodetic_positions(guess: Guess) -> bool:
    """Test whether a file measures positions by latitude and longitude."""
    columns = guess.naming.columns
    is_geodetic = "latitude" in columns and not {"x", "y"} <= columns.keys()
    return is_geodetic and any(sensor.kind == "position" for sensor in guess.sensors)


def lacks_place(guess: Guess, sensor: SensorGuess) -> bool:
    """Test whether the user must write a sensor's place into the config.

    A single radar needs none, as it is at the origin, nor does a sensor of positions.
    """
    if sensor.kind in ("range", "bearing") or sensor.kind.startswith("landmark"):
        return True
    radars = [other for other in guess.sensors if other.kind == "range-azimuth"]
    return sensor.kind == "range-azimuth" and len(radars) > 1


def lacks_origin(guess: Guess, truth: TruthGuess | None) -> bool:
    """Test whether the user must write the origin: latitude and longitude of x = y = 0.

    This is so if some positions, perhaps those of the truth, are latitudes and longitudes, and other
    sensors or positions count from a point x = y = 0 that no file has.
    """
    if guess.naming.origin:
        return False
    # Geodetic positions get their x and y by the origin; planar measurements have their own x = y = 0.
    has_geodetic = False
    has_planar = False
    for file in guess.each_file:
        kinds = {sensor.kind for sensor in file.sensors}
        has_positions = _has_geodetic_positions(file)
        has_geodetic = has_geodetic or has_positions
        # Sensors of another kind beside geodetic positions are planar.
        has_planar = has_planar or len(kinds) > 1 or not has_positions
    if truth is not None:
        has_geodetic = has_geodetic or truth.is_geodetic
        has_planar = has_planar or not truth.is_geodetic
    return has_geodetic and has_planar


def fill_unknown_places(config: dict[str, Any], origin: Sequence[float]) -> None:
    """Put numbers in place of the words of a config that the user must replace.

    The numbers serve to try the config, and are not kept, so that any will do: where a place has words,
    its numbers may change, too. ``origin`` is the latitude and longitude of some position, deg; empty if
    there is none.
    """
    scenario = config["scenario"]
    for number, sensor in enumerate(scenario["sensor"]):
        if "at" in sensor and isinstance(sensor["at"][0], str):
            sensor["at"] = [1000.0 * number, 1000.0]
    # Words and known numbers become 1.0. Zeros stay: they are velocities of a start at rest.
    mean = scenario["start"].get("mean")
    if mean:
        scenario["start"]["mean"] = [value if value == 0 else 1.0 for value in mean]
    target = scenario["target"]
    if target.get("origin") == ["LATITUDE", "LONGITUDE"]:
        target["origin"] = [*origin]
