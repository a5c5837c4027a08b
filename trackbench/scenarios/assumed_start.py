"""Start that filters assume in place of the true one, by the key `assume`."""

from trackbench.field_types import InvalidKeyError
from trackbench.models.assume import Assume
from trackbench.models.base import Motion
from trackbench.models.motions.map_or_ode import EquationMotion
from trackbench.models.motions.nonlinear import NonlinearMotion
from trackbench.models.sensors.stacked import Sensors
from trackbench.scenarios.starts.base import FixedStart


def assumed_start(
    assume: Assume,
    components: tuple[str, ...],
    sensor: Sensors,
    angle_rows: tuple[int, ...],
    has_state_key: bool,
) -> FixedStart | None:
    """Return the start that filters assume by the key ``assume``.

    Parameters
    ----------
    assume : Assume
        Assumptions of a filter.
    components : tuple of str
        Names of the components of the target's state, in order.
    sensor : Sensors
        True sensor, or all sensors as one.
    angle_rows : tuple of int
        Rows of the target's state that are angles, rad.
    has_state_key : bool
        True if the target has the key `state`, as a recorded one.

    Returns
    -------
    FixedStart or None
        Start of the target's state. None if filters assume no start of their own.

    Raises
    ------
    InvalidKeyError
        For a start that depends on a run's data, or that does not fit the state.
    """
    start = assume.start
    if start is None:
        return None
    if not isinstance(start, FixedStart):
        message = f"`{start.kind}` depends on the data of a run; take given, uniform or mixture"
        raise InvalidKeyError(message, "assume", "start")
    try:
        fitted = start.for_state(components)
        fitted.check(components, sensor)
    except InvalidKeyError as error:
        way_on = way_to_larger_state(assume.motion, components, has_state_key)
        raise InvalidKeyError(f"{error}{way_on}", "assume", *error.path) from None
    assert isinstance(fitted, FixedStart)
    return fitted.on_one_turn(angle_rows)


def way_to_larger_state(
    motion: Motion | None, components: tuple[str, ...], has_state_key: bool
) -> str:
    """Return the advice on an assumed motion with further components.

    Parameters
    ----------
    motion : Motion or None
        Motion that filters assume. None if it is the target's.
    components : tuple of str
        Names of the components of the target's state.
    has_state_key : bool
        True if the target has the key `state` for further components, as a recorded one.

    Returns
    -------
    str
        Advice, to be appended to a message. Empty if there is none.
    """
    # Only these two types of motions have components that the user chooses, by equations in the
    # config or by a class in Python. The components of all others are known for any target.
    if not isinstance(motion, EquationMotion | NonlinearMotion):
        return ""
    further = [name for name in motion.components if name not in components]
    if not further or not has_state_key:
        return ""
    state = ", ".join([*components, *further])
    return (
        f"; a filter with the further component {further[0]} needs it in the target's `state`: "
        f"[{state}], and the truth may lack it"
    )
