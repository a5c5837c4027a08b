"""Checks of the contract, by name; each raises ContractError with a breach in one line."""

from collections.abc import Callable
from typing import TypeAlias

from trackbench.contract.angle_wrap_check import check_angles
from trackbench.contract.compare_with_references import (
    check_consistency,
)
from trackbench.contract.covariance_check import check_covariance
from trackbench.contract.digits_check import check_digits
from trackbench.contract.independent_runs_check import check_independence
from trackbench.contract.interval_check import check_interval
from trackbench.contract.kalman_check import check_against_kalman
from trackbench.contract.missing_measurements_check import check_gaps
from trackbench.contract.motion_check import check_motion
from trackbench.contract.repeated_and_copied_runs_check import check_copies, check_repeats
from trackbench.contract.sensor_of_equations_check import check_sensor_of_equations
from trackbench.contract.sensor_place_check import check_place
from trackbench.contract.shapes_and_all_steps_check import check_shapes
from trackbench.contract.tracks_check import check_tracks
from trackbench.contract.unchanged_arguments_check import check_purity
from trackbench.filters.base import AnyFilter
from trackbench.scenarios.base import Scenario

Check: TypeAlias = Callable[[AnyFilter, Scenario], str | None]
"""A check of the contract, which raises ContractError; it may return what was tried, or a note."""


CHECKS: dict[str, tuple[str, Check]] = {
    "shapes": ("shapes", check_shapes),
    "digits": ("answers have enough digits", check_digits),
    "purity": ("step leaves its arguments unchanged", check_purity),
    "repeats": ("equal runs give equal estimates", check_repeats),
    "copies": ("copies of a state are independent", check_copies),
    "independence": ("runs are independent", check_independence),
    "covariance": ("covariance is symmetric and positive definite", check_covariance),
    "gaps": ("predicts over a missing measurement", check_gaps),
    "interval": ("uses the interval between steps", check_interval),
    "tracks": ("follows the target", check_tracks),
    "motion": ("uses the motion of the model", check_motion),
    "place": ("uses the place of the sensor", check_place),
    "equations": ("runs with a sensor of equations", check_sensor_of_equations),
    "angles": ("wraps angles at their cut", check_angles),
    "kalman": ("equals the Kalman filter on a linear model", check_against_kalman),
    "consistency": ("errors and covariance fit reference filters", check_consistency),
}
"""Title and function of each check, by the name used in `contract_exemptions`.

`digits` checks programs alone, and `equations` classes alone. `repeats` includes `copies`, which is a
check of its own if `repeats` is left out.
"""
