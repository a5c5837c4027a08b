"""Input estimation: the effect of an unmodeled acceleration on the innovations of a quiescent filter.

One constant input u per axis sets in after step t, for every t of a window at once (Bogler 1987; Park,
Seo & Lee 1995). The filter's error is then ``M(t) u`` plus the error without an input::

    M^- = F M + g,   psi = H M^-,   L^-1 += psi^2 / S,   d += psi nu / S,   M = M^- - K psi

and ``u = L d`` with variance L. Without an input, ``zeta = sum over axes d^2 L`` is chi-square with as
many degrees of freedom as there are axes.

Array axes: state component (2), axis of the plane (A), onset in the window (W), run (M). A is one where
the axes share their covariance.

The filter `input-estimation` corrects its state by the estimated input of a maneuver (1979, 1987). The
adaptive Kalman filter starts its maneuvering filter by it.
"""

from dataclasses import dataclass
from typing import Annotated, ClassVar, NamedTuple

import numpy as np
from numpy.random import Generator

from trackbench.core.arrays import Array, Index, Mask, any_nan
from trackbench.core.distributions import Distribution, Gaussian
from trackbench.core.kalman import Innovation
from trackbench.core.sums import total
from trackbench.field_types import NonNegative, Positive, Unit
from trackbench.filters.adaptive_kf.decision_keys_and_thresholds import Detector
from trackbench.filters.adaptive_kf.per_axis import (
    axis_step,
    both_axes,
    is_missing,
    per_axis,
    sampling_of,
    sum_over_axes,
    where_runs,
)
from trackbench.filters.base import PLANAR_POSITION, Filter
from trackbench.models.assume import OWN_MOTION
from trackbench.models.base import Model, Scene
from trackbench.models.motions.kinematic import ConstantVelocity
from trackbench.registry import register


class Hypotheses(NamedTuple):
    """Hypotheses of an input's onset after each step of a window.

    ``response`` M (2, A, W, M), ``information`` L^-1 (A, W, M), ``score`` d (2, W, M). Slot ``t % W``
    belongs to the onset after step t. ``since`` (M,) is the step of each run's last restart, the
    earliest possible onset; it is -1 before the first step.
    """

    response: Array
    information: Array
    score: Array
    since: Index

    @property
    def width(self) -> int:
        """Number of onsets W."""
        return self.score.shape[1]

    def update(
        self, k: int, F: Array, g: Array, posterior: Gaussian, innovation: Innovation, R: Array
    ) -> "Hypotheses":
        """Update every onset's response and least squares after step k of the quiescent filter.

        The quiescent filter is the one whose motion has no input. A is 1 if both axes of the plane share
        their covariance, else 2.

        Parameters
        ----------
        k : int
            Number of the step.
        F : array (2, 2)
            Transition matrix of position and velocity along one axis.
        g : array (2,)
            Effect of a unit input in one step on position and velocity, such as [T^2 / 2, T] of an
            acceleration.
        posterior : Gaussian
            Posterior of the filter: covariance (2, 2, A, M). Its mean is not used.
        innovation : Innovation
            Innovation ``nu`` (1, 2, M), NaN if a run has no measurement, and S (1, 1, A, M).
        R : array (1, 1)
            Variance of the measurement noise of one axis, m^2.

        Returns
        -------
        Hypotheses
            Response M (2, A, W, M), information L^-1 (A, W, M) and score d (2, W, M) of the W onsets.
        """
        # Step 1: M^- = F M + g, psi = H M^- with H = [1 0].
        F_ = F[:, :, None, None, None]
        g_ = g[:, None, None, None]
        response = F_[:, 0] * self.response[0]
        response += F_[:, 1] * self.response[1]
        response += g_
        psi = response[0]  # (A, W, M)
        S = innovation.S[0, 0]  # (A, M)
        nu = innovation.nu[0]  # (2, M)
        # Step 2: K = P H' / R of the posterior; a missing measurement has no gain and no information.
        gain = posterior.cov[:, 0] / R[0, 0]
        precision = 1.0 / S
        if any_nan(nu):
            measured = ~np.isnan(nu).any(axis=0)
            gain, precision, nu = (np.where(measured, a, 0.0) for a in (gain, precision, nu))
        # Step 3: L^-1 += psi^2 / S, d += psi nu / S, M = M^- - K psi.
        weight = precision[:, None] * psi
        information = weight * psi
        score = weight * nu[:, None]
        information += self.information
        score += self.score
        response -= gain[:, :, None] * psi
        return Hypotheses(
            response=response,
            information=information,
            score=score,
            since=self.with_start(k).since,  # the earliest possible onset
        )

    def with_start(self, k: int) -> "Hypotheses":
        """Set ``since`` to step k - 1 in the runs whose first step is k; it is -1 before."""
        return self._replace(since=np.where(self.since < 0, k - 1, self.since))

    def add_onset(self, k: int) -> "Hypotheses":
        """Replace the oldest onset by the onset after step k; the arrays are changed in place.

        Each of the last W = `width` onsets has a slot of the second last axis, in which the onset after
        step k has the index ``k % W``.
        """
        for array in (self.response, self.information, self.score):
            array[..., k % self.width, :] = 0.0
        return self

    def reset(self, where: Mask, k: int) -> "Hypotheses":
        """Clear the runs whose filters restart.

        Parameters
        ----------
        where : array (M,)
            True in the runs that restart.
        k : int
            Number of the step at which they do, their earliest possible onset.

        Returns
        -------
        Hypotheses
            Hypotheses without information in these runs; the same object if there are none.
        """
        if not where.any():
            return self
        return Hypotheses(
            response=np.where(where, 0.0, self.response),
            information=np.where(where, 0.0, self.information),
            score=np.where(where, 0.0, self.score),
            since=np.where(where, k, self.since),
        )

    def significance(self) -> Array:
        """Return the statistic zeta (W, M) of an input that sets in at each of the W onsets.

        Without an input it is chi-square with as many degrees of freedom as there are axes. It is zero
        where there is no information yet.
        """
        # zeta = sum over the axes of d^2 L, with the score d and the variance L of the estimated input
        L = 1.0 / np.where(self.information > 0.0, self.information, np.inf)
        square = np.square(self.score)
        square *= L
        return total(square, axis=0)

    def onset(self, slot: Index, k: int) -> Index:
        """Return the step t (M,) after which the input of each run's ``slot`` (M,) sets in, at step k.

        It is not before the run's last restart.
        """
        # Age of the slot in the ring of W onsets, 1 ... W.
        age = (k - 1 - slot) % self.width + 1
        return np.maximum(k - age, self.since)

    def slot_of(self, age: int, k: int) -> Index:
        """Return the slot (M,) of the onset ``age`` steps before k, or of the restart if it is later."""
        return np.maximum(k - np.minimum(age, self.width), self.since) % self.width

    def select(self, slot: Index, runs: Index) -> "Input":
        """Return response and estimated input of ``runs`` (m,), each for the onset in its slot (m,).

        Information L^-1 and score d have the array axes (axis of the plane, onset, run). The response
        has that of the state's components before these. Each axis of the plane has an input u and a
        score of its own; the variance L may be one for both.
        """
        # Least squares: u = L d with the variance L
        L = 1.0 / self.information[:, slot, runs]
        return Input(self.response[:, :, slot, runs], L * self.score[:, slot, runs], L)


class Input(NamedTuple):
    """Response M (2, A, m), input u (2, m) and its variance L (A, m) of m runs.

    A is 1 if both axes of the plane share their covariance, else 2.
    """

    response: Array
    u: Array
    variance: Array

    def correct(self, state: Gaussian) -> Gaussian:
        """Correct the quiescent state by the input's effect: ``N(x + M u, P + M L M')``.

        M (2, A, m) is ``response``, u (2, m) the input, and L (A, m) its ``variance``.
        ``state`` has the mean x (2, 2, m), component by axis, and the covariance P (2, 2, A, m). A is 1
        if both axes share their covariance, else 2.
        """
        M = self.response
        L = self.variance
        return Gaussian(state.mean + M * self.u, state.cov + M[:, None] * L * M[None])

    def augment(self, state: Gaussian) -> Gaussian:
        """Add the input as a component: ``[x + M u; u]`` with ``[P + M L M', M L; L M', L]``.

        M (2, A, m) is ``response``, u (2, m) the input, and L (A, m) its ``variance``, of m runs. A is 1
        if both axes share their covariance, else 2.

        Parameters
        ----------
        state : Gaussian
            Quiescent state: mean x (2, 2, m), component by axis, and covariance P (2, 2, A, m).

        Returns
        -------
        Gaussian
            Mean (3, 2, m) and covariance (3, 3, A, m); the input is the third component.
        """
        corrected = self.correct(state)
        M, u, L = self
        ML = np.broadcast_to(M * L, corrected.cov[:, 0].shape)
        # Stack the blocks [P + M L M', M L] and [L M', L].
        upper = np.concatenate([corrected.cov, ML[:, None]], axis=1)
        lower = np.concatenate([ML, np.broadcast_to(L, ML[0].shape)[None]])[None]
        mean = np.concatenate([corrected.mean, u[None]])
        return Gaussian(mean, np.concatenate([upper, lower]))


def empty_hypotheses(window: int, axes: int, runs: int) -> Hypotheses:
    """Return hypotheses without information, before the first step.

    Parameters
    ----------
    window : int
        Number W of onsets, in steps.
    axes : int
        1 if both axes of the plane share their covariance, else 2.
    runs : int
        Number of runs M.

    Returns
    -------
    Hypotheses
        Arrays of zeros, and ``since`` -1.
    """
    return Hypotheses(
        response=np.zeros((2, axes, window, runs)),  # of position and velocity
        information=np.zeros((axes, window, runs)),
        score=np.zeros((2, window, runs)),  # of both axes of the plane
        since=np.full(runs, -1),  # earliest possible onset: -1 before the first step
    )


class Corrected(NamedTuple):
    """Filter (2, 2, M) with the estimated inputs of the window."""

    filter: Gaussian
    inputs: Hypotheses
    nis: Array
    alarm: Mask
    """runs (M,) corrected in the last step"""
    age: Array
    """time since the onset of their input (M,), s"""
    innovation: Innovation | None = None


@register("filters", "input-estimation")
@dataclass(frozen=True, kw_only=True)
class InputEstimation(Filter[Corrected]):
    """Input estimation filter: constant velocity, corrected by the input of a detected maneuver.

    Chan, Hu & Plant 1979; Bogler 1987. If the input of an onset in the window is significant, the
    filter adds it with its uncertainty, ``x + M u`` and ``P + M L M'``, and the window begins
    again. No alarm is raised before step 20.
    """

    motion: ConstantVelocity
    """motion of the filter"""
    eta: Positive = 20.0
    """threshold of zeta, chi-square with two degrees of freedom for one onset"""
    window_s: Annotated[Positive, Unit("s")] = 60.0
    """length of the window of onsets, s"""
    min_window_s: NonNegative = 15.0
    """least age of an onset, s: a more recent one postpones the correction"""
    requires: ClassVar[tuple[str, ...]] = PLANAR_POSITION
    contract_exemptions: ClassVar[dict[str, str]] = {"kalman": "has motions of its own"}
    diagnostic_names = frozenset({"nis", "mode", "alarm", "alarm_age_s"})
    summed_diagnostics: ClassVar[frozenset[str]] = frozenset({"alarm"})

    @property
    def detector(self) -> Detector:
        """Detector, as one of `adaptive-kf`."""
        return Detector(eta=self.eta, window_s=self.window_s, min_window_s=self.min_window_s)

    def conflicts(self, scenario: Scene) -> dict[str, str]:
        """Reject windows that do not fit into the scenario's runs."""
        T = sampling_of(scenario.model).T
        misfits = self.detector.conflicts(T, float(scenario.times[-1]))
        # The detector's keys are keys of this filter.
        return {key.removeprefix("detector."): message for key, message in misfits.items()}

    def idle_keys(self, scenario: Scene) -> dict[str, str]:
        """Report an assumed motion as idle: the filter's own is `motion`."""
        return OWN_MOTION

    def init(self, model: Model, prior: Distribution, rng: Generator) -> Corrected:
        """Start the filter at the prior, without inputs."""
        state = per_axis(prior)
        runs = state.mean.shape[-1]
        # The covariance is (2, 2, A, M), with A = 1 if both axes of the plane share it.
        axes = state.cov.shape[2]
        inputs = empty_hypotheses(self.detector.window(sampling_of(model).T), axes, runs)
        unknown = np.full(runs, np.nan)
        no_alarm = np.zeros(runs, dtype=np.bool_)
        # `age` is the time since the onset of the input in s, NaN without an alarm.
        return Corrected(filter=state, inputs=inputs, nis=unknown, alarm=no_alarm, age=unknown)

    def step(self, model: Model, state: Corrected, z: Array, k: int, rng: Generator) -> Corrected:
        """Predict, update, and add the input of the most significant onset."""
        # Step 1: predict and update with constant velocity.
        T, R = sampling_of(model)
        motion = self.motion.axis(T)
        posterior, innovation = axis_step(state.filter, motion, z, R)
        # Step 2: update, for every onset, the estimated input and its significance zeta, which without
        # an input is chi-square of two degrees. An acceleration adds [T^2/2, T]' a.
        g = np.array([T * T / 2, T])
        inputs = state.inputs.update(k, motion.F, g, posterior, innovation, R)
        zeta = inputs.significance()  # (W, M), of W onsets
        # Step 3: alarm if the largest zeta exceeds eta, its onset is old enough, and the detector is on,
        # from its step `start`.
        slot = zeta.argmax(axis=0)
        runs = np.arange(zeta.shape[1])
        age = k - inputs.onset(slot, k)  # steps
        alarm = (zeta[slot, runs] > self.eta) & (age >= self.detector.min_window(T))
        alarm &= k >= self.detector.start
        # Step 4: in the runs with an alarm add the input u of variance L, by its effect M on the state:
        # x + M u, P + M L M'. In other runs u may be NaN, and `where_runs` leaves it out.
        if alarm.any():
            corrected = inputs.select(slot, runs).correct(posterior)
            posterior = where_runs(alarm, corrected, posterior)
            inputs = inputs.reset(alarm, k)
        nis = np.where(is_missing(innovation), np.nan, sum_over_axes(innovation.nis))
        age_s = np.where(alarm, age * T, np.nan)
        return Corrected(
            filter=posterior,
            inputs=inputs.add_onset(k),
            nis=nis,
            alarm=alarm,
            age=age_s,
            innovation=innovation,
        )

    def estimate(self, state: Corrected) -> Gaussian:
        """Return the corrected filter."""
        return both_axes(state.filter)

    def log_likelihood(self, state: Corrected) -> Array:
        """Evaluate log N(innovation; 0, S) (M,) of the filter before a correction."""
        if state.innovation is None:
            return np.full(state.nis.shape, np.nan)
        log_likelihood = sum_over_axes(state.innovation.log_likelihood)
        return np.where(is_missing(state.innovation), np.nan, log_likelihood)

    def diagnostics(self, state: Corrected) -> dict[str, Array]:
        """Report ``nis``, ``alarm_age_s``, and ``mode`` and ``alarm``: 1 where just corrected."""
        alarm = state.alarm.astype(float)
        return {"nis": state.nis, "mode": alarm, "alarm": alarm, "alarm_age_s": state.age}
