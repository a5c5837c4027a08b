"""Check that a filter runs with a sensor that is written as equations."""

from trackbench.contract.findings import ContractError, LeftOutError
from trackbench.contract.problems import OF_EQUATIONS
from trackbench.contract.why_not_running import runs_on, why_not_running
from trackbench.filters.base import AnyFilter
from trackbench.scenarios.base import Scenario


def check_sensor_of_equations(tracker: AnyFilter, _: Scenario) -> None:
    """Check that a filter that runs with a sensor also runs with its equations, if it accepts them.

    The sensor of equations measures the same components with the same noise. The attributes of its class
    are other ones: its ``R`` is the key of the config, such as a variance for each component.
    """
    has_run = False
    for problem, problem_of_equations in OF_EQUATIONS:
        if not runs_on(tracker, problem):
            continue
        why = why_not_running(tracker, problem_of_equations)
        if why.is_failure:
            names = ", ".join(problem.model.sensor.components)
            advice = (
                "take R and h by functions, which every sensor has: `self.functions.R(x)` of a "
                "PerRun, or `model.sensor.measurement(x, k).cov`; the attribute `sensor.R` is a key of "
                "the config there, and no matrix"
            )
            message = f"runs with a sensor of {names}, and fails if its kind is `function`"
            raise ContractError(f"{message}: {why.text}; {advice}")
        has_run = has_run or not why.text
    if not has_run:
        raise LeftOutError("the filter refuses a sensor of the kind `function`")
