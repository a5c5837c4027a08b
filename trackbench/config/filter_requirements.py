"""Requirements of a filter that a scenario meets or not, in words; conflicts of both."""

from trackbench.component_parts import walk_parts
from trackbench.config.build_components import ENTRY_KEYS
from trackbench.config.key_and_value_mistakes import add_conflicts
from trackbench.errors import Problem
from trackbench.field_types import InvalidKeyError
from trackbench.filters.base import AnyFilter
from trackbench.models.component_names import position_velocity_names
from trackbench.models.likelihood import has_own_density
from trackbench.models.sensors.base import SensorBase
from trackbench.models.sensors.noise import ScaledNoise
from trackbench.plugins.checked_hook_calls import filter_conflicts
from trackbench.scenarios.base import Scenario
from trackbench.yaml_source import Keys, Source, dotted

_REQUIREMENTS = {
    "state.planar": "a target in the plane",
    "motion.jacobian": "a motion with a Jacobian",
    "motion.alike_axes": "a motion of constant velocity, alike along x and y (cv, cwna; of any other "
    "motion try rpf or gpf), and steps of equal length",
    "motion.F": "a linear motion and steps of equal length",
    "motion.F|linear": "a linear motion",
    "motion.Q": "a linear motion",
    "motion.T": "steps of equal length",
    "motion.T|intervals": "a motion with a sampling time",
    **dict.fromkeys(["sensor.H", "sensor.H|linear"], "a linear sensor"),
    "sensor.jacobian": "a sensor with a Jacobian",
    "sensor.per_axis": "a sensor of planar positions, as it works axis by axis (try imm, or cmkf)",
    "sensor.reading": "a sensor of range and azimuth",
    **dict.fromkeys(
        ["prior.first", "prior.gaussian", "prior.positions", "prior.azimuths"],
        "a start from two scans of a radar at the origin",
    ),
}
"""Requirements of filters in words; a message names others as they are."""


def meets_requirement(scenario: Scenario, requirement: str) -> bool:
    """Test whether a scenario has what a filter requires.

    ``requirement`` names a component and its attribute, as ``prior.first`` or ``motion.T``. Of
    ``motion.T|F`` one of the two attributes is enough.
    """
    component, _, name = requirement.partition(".")
    if component == "state":  # `state.planar`, the only requirement of the state
        return scenario.components == position_velocity_names(2)
    if component == "prior":
        prior_type = scenario.prior_type
        # A field of a dataclass without a default is no attribute of the class.
        return hasattr(prior_type, name) or name in getattr(prior_type, "__dataclass_fields__", ())
    model_component = getattr(scenario.model, component)
    return any(hasattr(model_component, attribute) for attribute in name.split("|"))


def check_fit(source: Source, keys: Keys, tracker: AnyFilter, scenario: Scenario) -> None:
    """Check that the scenario meets a filter's requirements and has no conflict with the filter.

    ``keys`` lead to the filter's entry, where the mistakes are reported.
    """
    sensor = scenario.model.sensor
    kind_mark = source.mark((*keys, "kind"))
    # Step 1: what the filter requires of the scenario.
    meets_all = True
    for requirement in tracker.all_requirements:
        if meets_requirement(scenario, requirement):
            continue
        meets_all = False
        # For `assume: {faults: known}` the sensor is wrapped into one with factors on its noise. Any
        # attribute of a sensor that this ScaledNoise lacks is missing for this reason.
        if requirement.startswith("sensor.") and isinstance(sensor, ScaledNoise):
            message = f"`{tracker.kind}` cannot know a fault that multiplies noise"
            message += "; leave out `assume: {faults: known}`, or take ekf or ukf"
        else:
            needed = _REQUIREMENTS.get(requirement, requirement)
            message = f"`{tracker.kind}` works only with {needed}; {_remedy(scenario, requirement)}"
        source.problems.append(Problem(kind_mark, dotted(keys), message))
    # Step 2: measurements without mean and covariance. `why` is empty if they have both. A filter that
    # is `density_only` uses neither.
    why = sensor.why_no_moments() if has_own_density(sensor) else ""
    if why and not tracker.density_only:
        message = f"`{tracker.kind}` uses mean and covariance of a measurement: {why}"
        message += "; take a particle filter (pf, rpf, apf) or `grid`"
        source.problems.append(Problem(kind_mark, dotted(keys), message))
    # Step 3: the filter's own checks, which may use what it requires of the scenario.
    if meets_all:
        add_conflicts(source, keys, filter_conflicts(tracker, scenario))


def _remedy(scenario: Scenario, requirement: str) -> str:
    """Explain what to do about a requirement that a scenario does not meet."""
    component = requirement.partition(".")[0]
    if component == "sensor":
        parts = walk_parts(scenario.true_sensor)
        sensors = " and ".join(f"`{part.kind}`" for part in parts if isinstance(part, SensorBase))
        return f"this scenario has {sensors}: take another filter or sensor"
    if requirement == "motion.T":
        return "take another filter, or resample recorded data (`resample: SECONDS`)"
    key = {"state": "target", "prior": "start"}.get(component, component)
    return f"take another filter or {key}"


def check_late(source: Source, keys: Keys, tracker: AnyFilter, scenario: Scenario) -> None:
    """Check that a filter has a treatment of late measurements, and that it can apply it.

    ``keys`` lead to the filter's entry, where mistakes are reported.
    """
    # With mistakes in these keys, the scenario's treatment is unknown.
    entry_paths = tuple(dotted((*keys, key)) for key in ENTRY_KEYS)
    if any(problem.path.startswith(entry_paths) for problem in source.problems):
        return
    try:
        late = scenario.late
    except InvalidKeyError as error:
        message = str(error)
        is_added = not source.mark(keys).line
        if is_added:  # the entry of a filter of --filter stands in no file
            message += f"; write --set {dotted(keys)}.late=drop"
        source.add_problem(keys, message)
        return
    # None: all measurements arrive on time.
    if late is not None and late.kind == "refilter" and tracker.smooths:
        message = "a smoother goes back through all states at the end; take `drop` or `apply`"
        source.add_problem((*keys, "late"), f"{message}, or a filter without `smooth`")
