"""Check that the answers of an external program have enough digits."""

from trackbench.contract.estimates import run_filter, simulate
from trackbench.contract.findings import ContractError
from trackbench.filters.base import AnyFilter
from trackbench.filters.external import External
from trackbench.filters.float32_digits import FLOAT32_NOTE, PRINT_ALL_DIGITS, float32_advice
from trackbench.scenarios.base import Scenario


def check_digits(tracker: AnyFilter, scenario: Scenario) -> str:
    """Check that a program prints enough digits; return a note if they are those of float32."""
    assert isinstance(tracker, External)
    data = simulate(scenario, runs=5)
    first_step = int(scenario.steps[0]) + 1
    digits = tracker.digits(scenario.model, data.prior, data.measurements, first_step)
    # `too_few` is a text, such as "at most 6 digits"; empty if there are enough.
    if digits.too_few:
        raise ContractError(f"answers have {digits.too_few}: {PRINT_ALL_DIGITS}; of float32 `%.9g`")
    if not digits.is_float32:
        return ""
    estimates = run_filter(tracker, scenario, data)
    components = scenario.model.motion.components
    # The first estimate is the prior, which trackbench has written.
    mean = estimates.mean[:, 1:]
    cov = estimates.cov[:, :, 1:]
    advice = float32_advice(mean, cov, components, digits.printed)
    if advice:
        return f"{FLOAT32_NOTE}. Here {advice}"
    return FLOAT32_NOTE
