"""Units of quantities: components of states and measurements, errors, names such as azimuth_mrad."""


def quantity(name: str, unit: str) -> None:
    """Declare the unit of a plugin's quantity: of an error, or of a component of a motion or sensor.

    Parameters
    ----------
    name
        name of the quantity, such as ``temperature``, which ``rmse_temperature`` ends in
    unit
        its unit, such as ``K``

    Raises
    ------
    ValueError
        if the name has another unit already
    """
    if UNITS_OF_QUANTITIES.setdefault(name, unit) != unit:
        raise ValueError(f"the unit of {name!r} is {UNITS_OF_QUANTITIES[name]!r} already")


def without_unit(name: str) -> tuple[str, str]:
    """Split a name such as ``azimuth_mrad`` into ``azimuth`` and the unit ``mrad``.

    The unit is empty for a name that ends in no unit.
    """
    for ending, unit in _ENDINGS.items():
        if name.endswith(f"_{ending}"):
            return name.removesuffix(f"_{ending}"), unit
    return name, ""


_ENDINGS = {"mrad": "mrad", "deg": "deg", "km": "km", "deg_s": "deg/s", "s": "s", "m": "m"}
UNITS_OF_QUANTITIES = {
    **dict.fromkeys(["position", "px", "py", "pz", "range", "mean_range", "radial", "cross"], "m"),
    **dict.fromkeys(["velocity", "vx", "vy", "vz", "range_rate"], "m/s"),
    **dict.fromkeys(["acceleration", "ax", "ay", "az"], "m/s^2"),
    **dict.fromkeys(("azimuth", "elevation"), "rad"),
    "turn_rate": "rad/s",
}
"""Units of the quantities of the package: errors of scenarios, components of motions and sensors."""
