"""Lines of a new config on its sensors: type, place and standard deviations."""

import re
from collections.abc import Iterator

from trackbench.errors import in_line
from trackbench.scenarios.recordings.errors_from_neighbors import round_to_two_digits
from trackbench.scenarios.recordings.guess_record import Guess
from trackbench.scenarios.recordings.new_config_further_tables import FurtherTables
from trackbench.scenarios.recordings.new_config_unknown_places import lacks_place
from trackbench.scenarios.recordings.yaml_values import quoted


def sensor_lines(guess: Guess, tables: FurtherTables) -> Iterator[str]:
    """Yield a line for each sensor, with comments on what the user must write or may change.

    The ``tables`` may have the places of landmarks.
    """
    source = "guess: how far measurements are from the line between their neighbors"
    for sensor in guess.sensors:
        kind = sensor.kind
        # Standard deviations in the order of the sensor's quantities, m; that of an angle, rad, is last.
        sigmas = sensor.sigmas
        comment = f"  # {source}"
        place_comment = "  # write where it is, m"
        if sensor.name:
            name = quoted(sensor.name)
            comment = f"  # {name}: {source}"
            place_comment = f"  # write where {name} is, m"
        place = re.sub(r"\W", "_", sensor.name) or "SENSOR"
        place_key = f"at: [X_{place}, Y_{place}]"
        known_place = tables.place_of(sensor.name)
        if known_place is not None:
            x, y = known_place
            place_key = f"at: [{x:.9g}, {y:.9g}]"
            named = quoted(sensor.name) if sensor.name else "the landmark"
            place_comment = f"  # {named}: place of {in_line(tables.source_of_places)}, m"
        elif tables.places:
            source_of_places = in_line(tables.source_of_places)
            place_comment += (
                f", which {source_of_places} lacks; or leave out the line, and the name in"
            )
            place_comment += " `sensors`"
        # The kinds `position` and `range` take a state px, vx, py, vy; a robot's is px, py, heading.
        if kind == "position" and guess.inputs:
            variance = float(f"{max(sigmas) ** 2:.3g}")
            yield f"- {{kind: function, h: {{x: px, y: py}}, R: {variance:g}}}{comment}; R is a variance"
        elif kind == "range" and guess.inputs:
            sigma_key = f"sigma_range: {sigmas[0]:g}"
            yield f"- {{kind: landmark, {place_key}, {sigma_key}}}{place_comment}; sigmas: guess"
        elif kind == "position":
            yield f"- {{kind: position, sigma: {max(sigmas):g}}}{comment}"
        elif kind.startswith("landmark"):
            *sigma_range, angle = sigmas  # the first is empty for a sensor without a range
            keys = [place_key, *(f"sigma_range: {value:g}" for value in sigma_range)]
            keys.append(f"sigma_bearing_mrad: {float(f'{1000.0 * angle:.3g}'):g}")
            yield f"- {{kind: landmark, {', '.join(keys)}}}{place_comment}; sigmas: guess"
        elif kind == "range":
            yield f"- {{kind: range, {place_key}, sigma: {sigmas[0]:g}}}{place_comment}"
        else:
            *sigma_range, angle = sigmas
            keys = [f"sigma_range: {value:g}" for value in sigma_range]
            angle_key = "sigma_azimuth_mrad" if sigma_range else "sigma_mrad"
            keys.append(f"{angle_key}: {float(f'{1000.0 * angle:.3g}'):g}")
            if lacks_place(guess, sensor):
                keys.insert(0, place_key)
                comment = place_comment
            yield f"- {{kind: {kind}, {', '.join(keys)}}}{comment}"
    has_azimuth = any("azimuth" in sensor.quantities for sensor in guess.sensors)
    # With several files (`guess.files`) each has its own key `clockwise`, and this comment would not say
    # in which one to write it.
    if has_azimuth and not guess.files and not guess.naming.clockwise:
        yield "# azimuth counts from x to y; from north clockwise: `clockwise: [azimuth]` above"
    if guess.measures_velocity:
        velocity = round_to_two_digits(max(0.05 * guess.speed, 0.05))
        yield f"- {{kind: velocity, sigma: {velocity:g}}}  # guess: 5 % of the usual speed"
