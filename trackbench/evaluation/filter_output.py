"""Output of one filter over one block: its estimates, recorded step by step, and their series."""

from typing import Any, NamedTuple, TypeAlias, cast

import numpy as np

from trackbench.component_parts import foreign_parts
from trackbench.core.angles import near, particles_together
from trackbench.core.arrays import Array, Mask, any_nan
from trackbench.core.distributions import Gaussian, per_run_moments
from trackbench.core.particles import moments_together
from trackbench.core.posterior_scores import ParticlePosterior
from trackbench.evaluation.allowed_metric_names import check_diagnostic_names
from trackbench.evaluation.block_task import BlockTask
from trackbench.evaluation.calibration_series import Calibration
from trackbench.evaluation.nees import ConsistencySeries, leave_out_known_start, leave_out_unknown
from trackbench.evaluation.posterior_mean_errors import observable_errors
from trackbench.evaluation.predictive_and_held_out_scores import with_nan_first
from trackbench.evaluation.validate_returned_arrays import (
    check_estimate,
    check_numbers,
    check_symmetry,
)
from trackbench.filters.base import Steps, has_expectations
from trackbench.models.base import Model
from trackbench.models.sensors.stacked import Sensors, rows_of
from trackbench.scenarios.base import Simulation

Series: TypeAlias = dict[str, Array] | None
"""Arrays (T + 1, M) by name; None before the first step."""


class FilterOutput(NamedTuple):
    """Estimates and diagnostics of one filter over one block of M runs and T steps."""

    mean: Array
    """estimates (n_x, T + 1, M), the first from the prior"""
    nees: Array
    """normalized error squared (T + 1, M)"""
    cov: Array | None
    """covariances (n_x, n_x, T + 1, r) of the first r runs"""
    diagnostics: dict[str, Array]
    """series (T + 1, M) by name"""
    cpu_s: float
    """CPU seconds of the filter"""
    refused: Mask | None = None
    """refused components (n_z, T, M), if several sensors have a gate each"""
    indefinite: Mask | None = None
    """covariances (T + 1, M) that are not positive definite; None if all are"""


class Recorder:
    """Recorder of copies, step by step, since the filter may write to its own arrays."""

    def __init__(self, task: BlockTask, data: Simulation, model: Model, covariances: int) -> None:
        """Begin before the estimate of the prior.

        ``model`` is the one that the filter assumes. ``covariances`` is the number of first runs whose
        covariances are recorded.
        """
        scenario = task.scenario
        self._task = task
        self._is_of_plugin = bool(foreign_parts(task.filter))
        self._data = data
        self._runs_with_covariance = covariances  # number of first runs; 0 for none
        # Components of the truth, and of the motion that the filter assumes.
        self._sizes = (len(data.truth), len(model.motion.components))
        self._mean = np.empty(data.truth.shape)
        # By step: covariances (n, n, r) of the first r runs, and refused components (n_z, M).
        self._covs: list[Array] = []
        self._refused: list[Mask] = []
        # The filter's diagnostics, and the errors of the scenario's observables.
        self._diagnostics: Series = None
        self._observables: Series = None
        self._has_several_sensors = len(rows_of(cast(Sensors, scenario.true_sensor))) > 1
        # Indices of the steps that are recorded next. A smoother's estimates are recorded after all
        # diagnostics.
        self._next_step = 0
        self._next_diagnostics = 1  # the first state has no diagnostics
        self._consistency = ConsistencySeries(scenario, self._mean, data.truth)
        # Calibration compares a posterior with the truth.
        wanted = task.predictive_metrics if scenario.has_truth else ()
        self._calibration = Calibration(scenario.components, wanted)
        self._angles = scenario.angle_rows
        self.needs_states = has_expectations(task.filter) or not self._calibration.disabled
        """True if the recorded series depend on more than estimates and diagnostics"""

    def add_diagnostics(self, diagnostics: dict[str, Array]) -> None:
        """Record the diagnostics of the next step.

        Parameters
        ----------
        diagnostics
            numbers (M,) by name, with the names of the first step

        Raises
        ------
        WrongReturnError
            for arrays of another shape or type, and for a name that a diagnostic cannot have
        """
        check_numbers("diagnostic", diagnostics, self._task.runs)
        if self._diagnostics is None:  # all steps have the names of the first
            check_diagnostic_names(diagnostics)
        self._diagnostics = self._filled(self._diagnostics, self._next_diagnostics, diagnostics)
        self._next_diagnostics += 1

    def add_refused(self, refused: Mask | None) -> None:
        """Record which components (n_z, M) the gates of several sensors refused at a step."""
        if refused is not None and self._has_several_sensors:
            self._refused.append(refused)

    def add(self, state: Any, estimate: Gaussian) -> None:
        """Record the state and the estimate of the next step, in the components of the truth.

        Parameters
        ----------
        state
            state of the filter
        estimate
            its mean (n, M) and covariance (n, n[, M]), of the truth's components or of all components of
            the filter's motion

        Raises
        ------
        WrongReturnError
            if the estimate has other shapes, or a plugin's covariance is not symmetric
        """
        check_estimate(estimate, self._sizes, self._task.runs)
        if self._is_of_plugin:
            check_symmetry(estimate.cov)
        k = self._next_step
        n, _ = self._sizes  # the number of the truth's components
        # Drop the components that only the filter's motion has: the truth has none of them.
        if len(estimate.mean) > n:
            estimate = Gaussian(estimate.mean[:n], estimate.cov[:n, :n])
        # A posterior is needed for angles, and for series of calibration if any is requested.
        posterior = None
        if self._angles or not self._calibration.disabled:
            posterior = self._task.filter.posterior(state)
        if self._angles and isinstance(posterior, ParticlePosterior):
            # Particles on both sides of the jump of an angle by 2 pi are averaged about one direction,
            # in the truth's components. Without angles the posterior itself compares only these.
            particles = posterior.particles
            particles = particles._replace(x=particles.x[:n])
            together = particles_together(particles, estimate.mean, self._angles)
            estimate = moments_together(estimate, particles, together)
            posterior = ParticlePosterior(together)
        self._mean[:, k] = estimate.mean
        self._consistency.add(estimate.cov)
        if self.needs_states:
            truth = near(self._data.truth[:, k], estimate.mean, self._angles)
            self._calibration.add(posterior, estimate, truth)
            rows = observable_errors(self._task.scenario, self._task.filter, state, truth)
            self._observables = self._filled(self._observables, k, rows)
        if self._runs_with_covariance:
            self._covs.append(
                per_run_moments(estimate).cov[..., : self._runs_with_covariance].copy()
            )
        self._next_step += 1

    def add_steps(self, steps: Steps) -> None:
        """Record the estimates and diagnostics of the next steps, which the filter made in one call.

        Parameters
        ----------
        steps
            means (n, S, M) and covariances (n, n, S, M) or (n, n, S, 1) of S steps, and diagnostics (S,
            M) by name

        Raises
        ------
        WrongReturnError
            if an array has another shape, or a plugin's covariance is not symmetric
        """
        check_estimate(steps.estimate, self._sizes, *steps.estimate.mean.shape[1:])
        if self._is_of_plugin:
            check_symmetry(steps.estimate.cov)
        # Only the truth's components, which come first. The second size is that of the filter's state.
        n, _ = self._sizes
        mean = steps.estimate.mean[:n]
        cov = steps.estimate.cov[:n, :n]
        _, count, runs = mean.shape
        check_numbers("diagnostic", steps.diagnostics, count, runs)
        piece = slice(self._next_step, self._next_step + count)
        self._diagnostics = self._filled(self._diagnostics, piece, steps.diagnostics)
        self._mean[:, piece] = mean
        self._consistency.add_steps(cov)
        if self._runs_with_covariance:
            # One array (n, n, r) for each step, of the first r runs.
            per_run = np.broadcast_to(cov, (n, n, count, runs))
            self._covs += [*np.moveaxis(per_run[..., : self._runs_with_covariance], 2, 0).copy()]
        # Both are equal here: a smoother, whose estimates come after all diagnostics, is recorded by
        # `add`.
        self._next_step = piece.stop
        self._next_diagnostics = piece.stop

    def output(self, z: Array, predictive: dict[str, Array], cpu_s: float) -> FilterOutput:
        """Return the output of the filter after the last step.

        Parameters
        ----------
        z
            measurements (n_z, T, M) that the filter was given, NaN where a component is missing
        predictive
            predictive series (T + 1, M) by name
        cpu_s
            CPU seconds of the filter

        Returns
        -------
        FilterOutput
            estimates and series of all runs of the block
        """
        series = self._consistency.series()
        series |= self._calibration.series(series)
        if self._consistency.unknown is not None:
            leave_out_unknown(series, self._mean, self._consistency.unknown)
        leave_out_known_start(series, self._data.prior.cov)
        nees = series.pop("nees")
        diagnostics = self._diagnostics or {}
        nis = diagnostics.get("nis")
        # Components (n_z, T, M) that the gates of several sensors refused; None if there are no such
        # gates.
        refused = np.stack(self._refused, axis=1) if self._refused else None
        if nis is not None and (any_nan(z) or (refused is not None and refused.any())):
            # Number of components that each NIS lacks; NaN if a step has no NIS.
            unused = np.isnan(z)
            if refused is not None:
                unused |= refused
            number = with_nan_first(unused.sum(axis=0).astype(float))
            series["unused_nis"] = np.where(np.isnan(nis), np.nan, number)
        # Covariances of the shown runs (n, n, T + 1, r).
        cov = np.stack(self._covs, axis=2) if self._covs else None
        # Errors of the functions of the state that the scenario names, such as the range.
        observables = self._observables or {}
        return FilterOutput(
            mean=self._mean,
            nees=nees,
            cov=cov,
            diagnostics=diagnostics | series | observables | predictive,
            cpu_s=cpu_s,
            refused=refused,
            indefinite=self._consistency.indefinite,
        )

    def _filled(self, series: Series, steps: int | slice, rows: dict[str, Array]) -> Series:
        """Write the values of some steps to the series (T + 1, M), and return the series.

        ``steps`` is the index of one step, with ``rows`` (M,) by name, or the slice of several, with
        ``rows`` (S, M). If ``series`` is None, new ones are made. All steps have the names of the first.
        """
        if series is None:
            series = {name: np.full(self._data.truth.shape[1:], np.nan) for name in rows}
        for name, values in series.items():
            values[steps] = rows[name]
        return series
