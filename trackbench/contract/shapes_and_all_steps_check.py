"""Check shapes and types of estimates and diagnostics, and that all steps at once equal single steps."""

import numpy as np

from trackbench.contract.estimates import new_rng, simulate
from trackbench.contract.findings import ContractError
from trackbench.core.arrays import with_trailing
from trackbench.core.distributions import Gaussian
from trackbench.evaluation.allowed_metric_names import check_diagnostic_names
from trackbench.evaluation.validate_returned_arrays import check_estimate, checked_numbers
from trackbench.filters.base import AnyFilter, Steps, declares_diagnostics, has_likelihood
from trackbench.scenarios.base import Scenario


def check_shapes(tracker: AnyFilter, scenario: Scenario) -> None:
    """Check shapes and types of estimates and diagnostics, and `all_steps` against `step`."""
    runs = 5
    rng = new_rng()
    data = simulate(scenario, runs)
    n = data.truth.shape[0]
    state = tracker.init(scenario.model, data.prior, rng)
    first_step = int(scenario.steps[0]) + 1
    # Step 1: all steps at once, if the filter can.
    all_steps = tracker.all_steps(scenario.model, state, data.measurements, first_step)
    if all_steps is not None and all_steps.estimate.mean.shape[1] != len(scenario.steps) - 1:
        message = f"{all_steps.estimate.mean.shape[1]} states, not one per measurement"
        raise ContractError(f"all_steps gives {message}")
    # Step 2: step through the scenario; check the estimate and the other numbers at each step. The first
    # step (i = 0) is that of the prior, which has no measurement.
    has_single_precision = True
    has_fractions = False
    first = tracker.estimate(state)
    changes = False
    steps_without_cov: list[int] = []
    for i, k in enumerate(scenario.steps):
        if i:
            state = tracker.step(scenario.model, state, data.measurements[:, i - 1], int(k), rng)
        estimate = tracker.estimate(state)
        changes = changes or not np.array_equal(estimate.mean, first.mean)
        if i and all_steps is not None:
            _compare_with_all_steps(tracker, all_steps, estimate, i, int(k))
        # Estimate and truth have the same number n of components.
        check_estimate(estimate, (n, n), runs)
        for name, array in (("mean", estimate.mean), ("cov", estimate.cov)):
            if np.asarray(array).dtype != np.float64:
                raise ContractError(f"{name} at step {k} is of {np.asarray(array).dtype}")
            # A filter may estimate the mean alone.
            if name == "cov" and np.isnan(array).all():
                steps_without_cov.append(int(k))
            elif not np.isfinite(array).all():
                raise ContractError(f"{name} at step {k} is not finite")
            if i and not np.array_equal(array, np.float32(array)):
                has_single_precision = False
            # Whole numbers are the same in float32.
            has_fractions = has_fractions or bool((array != np.rint(array)).any())
        diagnostics = checked_numbers("diagnostic", tracker.diagnostics(state), runs)
        if i and all_steps is not None:
            for name, value in diagnostics.items():
                rows = all_steps.diagnostics.get(name)
                if rows is None or not np.allclose(rows[i - 1], value, equal_nan=True):
                    message = f"another {name} than step at step {k}"
                    raise ContractError(f"all_steps gives {message}")
        check_diagnostic_names(diagnostics)
        names = sorted(tracker.diagnostic_names)
        if i and declares_diagnostics(type(tracker)) and sorted(diagnostics) != names:
            gives = f"diagnostics gives {sorted(diagnostics)}"
            raise ContractError(f"diagnostic_names is {names}, {gives}")
        if i and has_likelihood(tracker):
            checked_numbers("series", {"log_likelihood": tracker.log_likelihood(state)}, runs)
    # A filter without covariance has none at any step, but perhaps that of the prior.
    if 0 < len(steps_without_cov) < len(scenario.steps) - 1:
        raise ContractError(f"cov at step {steps_without_cov[0]} is not finite")
    # Step 3: the digits of all estimates; those of a program are another check. Estimates that stay as
    # they began have the digits of the start, whatever they are computed in.
    if has_single_precision and has_fractions and changes and not tracker.runs_program:
        raise ContractError("the estimates have the digits of float32: compute in float64")


def _compare_with_all_steps(
    tracker: AnyFilter, all_steps: Steps, estimate: Gaussian, i: int, k: int
) -> None:
    """Raise ContractError if `all_steps` gives another estimate after ``i`` steps, at step ``k``.

    ``all_steps`` is the result of this method of the filter. ``estimate`` is that of ``i`` calls of
    `step`.
    """
    state_estimate = tracker.estimate(all_steps.state(i - 1))
    # One covariance of all runs may stand for equal ones: then an axis of length 1 stands for the runs.
    cov = with_trailing(estimate.cov, 1, leading=2)
    pairs = [
        (state_estimate.mean, estimate.mean),
        (with_trailing(state_estimate.cov, 1, leading=2), cov),
        (all_steps.estimate.mean[:, i - 1], estimate.mean),
        (all_steps.estimate.cov[:, :, i - 1], cov),
    ]
    if not all(np.allclose(a, b, rtol=1e-6, atol=0.0, equal_nan=True) for a, b in pairs):
        raise ContractError(f"all_steps gives another estimate than step at step {k}")
