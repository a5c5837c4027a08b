"""Decisions of the adaptive Kalman filter: keys and thresholds of the detector, confirmation and exit.

A threshold may be given by a false-alarm probability, by the laws of the fading sum rho and of zeta. The
fading-memory sum of normalized innovations is ``rho(k) = gamma rho(k-1) + e(k)`` with independent
``e(k)``, chi-square of two degrees of freedom. In the long run rho is a sum of independent exponentials
of means 2 gamma^j (hypo-exponential), with mean ``2 / (1 - gamma)`` and variance ``4 / (1 - gamma^2)``.
It is not chi-square.
"""

from dataclasses import dataclass
from decimal import Decimal, localcontext
from functools import lru_cache
from typing import Annotated, Literal

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.elementary import log
from trackbench.field_types import (
    Count,
    InvalidKeyError,
    Natural,
    NonNegative,
    OpenShare,
    Positive,
    Unit,
)
from trackbench.models.motions.kinematic import ConstantAcceleration


@dataclass(frozen=True, kw_only=True)
class Detector:
    """First decision: whether the target maneuvers, and since when (eqs. 5-7)."""

    kind: Literal["fading", "ie", "fading-ie"] = "ie"
    """statistic: fading sum rho of the NIS, input-estimation zeta, or rho with zeta's onset"""
    gamma: OpenShare = 0.8
    """fading factor of rho"""
    eta: Positive | None = None
    """threshold of the statistic; give this or alpha"""
    alpha: OpenShare | None = None
    """false-alarm probability of the statistic at one sample (of zeta: for one onset)"""
    window_s: Positive | None = None
    """length of the window of onsets, s; default: 1 / (1 - gamma) samples"""
    min_window_s: NonNegative = 0.0
    """least age of an onset, s (the paper's xi_min): a more recent one postpones the decision"""
    onset: Literal["argmax", "window", "paper"] | None = None
    """onset: argmax of zeta, begin of the window, or argmax of rho as printed; default: by kind"""
    start: Natural = 20
    """step at which the detector is switched on"""

    def __post_init__(self) -> None:
        if (self.eta is None) == (self.alpha is None):
            raise ValueError("give one of eta and alpha")
        if self.kind == "fading" and self.onset == "argmax":
            raise InvalidKeyError(
                "kind fading has no zeta to take an argmax of: write kind fading-ie", "onset"
            )

    @property
    def threshold(self) -> float:
        """Threshold of the statistic: the key eta, or the one that is exceeded with probability alpha.

        The statistic is zeta, the significance of the input that is estimated for one onset, for the
        kind "ie" (input estimation): chi-square with two degrees of freedom. Otherwise it is rho, the
        fading sum of the NIS with the factor gamma, whose exact tail is used.
        """
        if self.eta is not None:
            return self.eta
        assert self.alpha is not None
        if self.kind == "ie":
            return significance_threshold(self.alpha)
        return fading_threshold(self.alpha, self.gamma)

    @property
    def onset_rule(self) -> str:
        """Rule of the onset, argmax, window or paper: the key ``onset``, or the default of the kind."""
        if self.onset is not None:
            return self.onset
        return "window" if self.kind == "fading" else "argmax"

    def window(self, T: float) -> int:
        """Return the length of the window of onsets in samples; T is the sampling time, s."""
        if self.window_s is None:
            return max(1, round(1.0 / (1.0 - self.gamma)))
        return max(1, round(self.window_s / T))

    def min_window(self, T: float) -> int:
        """Return the least age of an onset in samples."""
        return round(self.min_window_s / T)

    def conflicts(self, T: float, duration: float) -> dict[str, str]:
        """Return reasons why the windows do not fit into a run.

        Parameters
        ----------
        T : float
            Sampling time, s.
        duration : float
            Length of a run, s.

        Returns
        -------
        dict
            Reason by key, such as ``detector.window_s``; empty if they fit.
        """
        window = self.window(T) * T
        conflicts = {}
        if window > duration:
            message = f"{window:g} s is longer than the run of {duration:g} s"
            conflicts["detector.window_s"] = message
        if self.min_window(T) * T > window:
            conflicts["detector.min_window_s"] = f"{self.min_window_s:g} s exceed the window"
        elif self.onset_rule == "paper" and self.min_window(T) > 1:
            # The paper's printed formula gives the newest onset, one sample old. A larger least age
            # would postpone every alarm for ever, so that the filter never switches.
            message = "the printed onset is always the newest: no switch"
            conflicts["detector.min_window_s"] = message
        return conflicts


@dataclass(frozen=True, kw_only=True)
class Exit:
    """Exit from the maneuvering filter: ``sum over p samples of a' P_a^-1 a < Ta``."""

    p: Count = 2
    """number of samples in the sum"""
    Ta: Positive = 9.49
    """threshold; 9.49 is the 95 % point of chi-square with 4 degrees, of p = 2 samples"""
    hold_s: Annotated[NonNegative, Unit("s")] = 0.0
    """least time in the maneuvering filter, s"""


@dataclass(frozen=True, kw_only=True)
class SecondDecision:
    """Second decision (decision logic window): both filters run, and the likelier one goes on."""

    n: Natural = 0
    """samples both filters run after an alarm; 0 confirms every alarm"""


def exit_cautions(
    leave: Exit, mf: ConstantAcceleration, T: float, R: Array, smallest: float | None
) -> list[str]:
    """Return a note if the exit test fires during a turn, or cannot fire after a long one.

    The test fires when the sum of a' P_a^-1 a over the last p samples is below Ta. The variance P_a of
    the estimated acceleration is that of the steady state. With q = 0 there is none: P_a and the gain go
    to zero, and the estimated acceleration stays significant after the turn.

    Parameters
    ----------
    leave : Exit
        Keys of the test.
    mf : ConstantAcceleration
        Motion of the maneuvering filter.
    T : float
        Sampling time, s.
    R : array (1, 1)
        Variance of a measured position along an axis, m^2.
    smallest : float or None
        Least acceleration of a turn, m/s^2; None without turns.

    Returns
    -------
    list of str
        One note, or none.
    """
    if mf.q == 0.0:
        return [
            "mf.q = 0 lets the maneuvering filter's gain go to zero: after a long turn the "
            "exit test can no longer fire, and the filter stays a constant-acceleration filter"
        ]
    if smallest is None:
        return []
    # In a turn of acceleration a, the statistic is p a^2 / P_a on average, plus noise.
    statistic = leave.p * smallest**2 / steady_acceleration_variance(mf, T, R)
    if statistic >= leave.Ta:
        return []
    return [
        f"the exit test fires during the smallest turn, {smallest:.3g} m/s^2 "
        f"(p a^2 / P_a = {statistic:.2g} < Ta = {leave.Ta:g})"
    ]


def steady_acceleration_variance(mf: ConstantAcceleration, T: float, R: Array) -> float:
    """Return the variance of the maneuvering filter's acceleration after many steps.

    It is the solution of a Riccati equation.

    Parameters
    ----------
    mf : ConstantAcceleration
        Motion of the filter, whose q must be positive.
    T : float
        Time between two measured positions, s.
    R : array (1, 1)
        Variance of a measured position along an axis, m^2.

    Returns
    -------
    float
        Variance along an axis after an update, (m/s^2)^2.
    """
    from scipy.linalg import solve_discrete_are

    F, Q = mf.axis(T)
    H = np.eye(1, 3)
    # The Riccati equation's solution is the predicted covariance; one update makes the posterior.
    P = solve_discrete_are(F.T, H.T, Q, R)
    K = P[:, 0] / (P[0, 0] + R[0, 0])
    return float(P[2, 2] - K[2] * P[0, 2])


@lru_cache(maxsize=256)
def tail(eta: float, gamma: float) -> float:
    """Return P(rho > eta) in the long run: ``sum_j A_j exp(-eta / (2 gamma^j))``.

    rho is the fading sum ``rho(k) = gamma rho(k-1) + e(k)`` of the NIS e of two axes without a maneuver.
    The factors ``A_j = prod_{i != j} 1 / (1 - gamma^(i - j))`` alternate in sign and are as large as
    ``exp(2 / (1 - gamma))``. So the sum is computed with enough decimal digits that they cancel.

    Parameters
    ----------
    eta : float
        Threshold of rho; the result is 1 unless it is positive.
    gamma : float
        Fading factor, above 0 and below 1.

    Returns
    -------
    float
        Probability at one sample.
    """
    if eta <= 0.0:
        return 1.0
    with localcontext() as context:
        # The largest term has at most 2.5 / (1 - gamma) digits before the point; 50 more are for the
        # sum.
        context.prec = 50 + int(2.5 / (1.0 - gamma))
        g = Decimal(gamma)
        half = Decimal(eta) / 2
        smallest = Decimal(10) ** -context.prec
        # Step 1: A_0 = 1 / prod_{i >= 1} (1 - gamma^i), with factors until they are 1 in these digits.
        product = Decimal(1)
        power = g
        while power > smallest:
            product *= 1 - power
            power *= g
        A = 1 / product
        # Step 2: add A_j exp(-eta / (2 gamma^j)), with A_j / A_{j-1} = 1 / (1 - gamma^-j).
        total = Decimal(0)
        power = Decimal(1)
        while True:
            term = A * (-half / power).exp()
            total += term
            if abs(term) < smallest:
                # Rounding may bring the sum below 0 or above 1.
                return float(min(max(total, Decimal(0)), Decimal(1)))
            power *= g
            A /= 1 - 1 / power


@lru_cache(maxsize=256)
def fading_threshold(alpha: float, gamma: float) -> float:
    """Find the threshold that rho exceeds with a probability, by bisection of ``tail(eta, gamma)``.

    rho is the fading sum ``rho(k) = gamma rho(k-1) + e(k)`` of the NIS e of two axes without a maneuver.

    Parameters
    ----------
    alpha : float
        Probability of a false alarm at one sample, above 0 and below 1.
    gamma : float
        Fading factor, above 0 and below 1.

    Returns
    -------
    float
        Threshold eta, to nine digits.
    """
    # Step 1: bracket the threshold, starting from the mean of rho: e has the mean 2.
    low = 0.0
    high = 2.0 / (1.0 - gamma)
    while tail(high, gamma) > alpha:
        low = high
        high *= 2.0
    # Step 2: halve the bracket to nine digits.
    while high - low > 1e-9 * high:
        middle = 0.5 * (low + high)
        if tail(middle, gamma) > alpha:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


def significance_threshold(alpha: float) -> float:
    """Return the value that a chi-square variable of two degrees exceeds with probability alpha."""
    return -2.0 * float(log(alpha))


def explain_thresholds() -> str:
    """Explain the false-alarm probabilities of the thresholds in the paper: eta = 20 and 35.

    rho is the fading sum of the NIS, with the paper's fading factor gamma = 0.8. zeta is the
    significance of the input that is estimated for one onset, chi-square with two degrees of freedom.
    """
    rows = [
        f"  eta = {eta:g}: P(rho > eta) = {tail(eta, 0.8):.2g} per sample at gamma = 0.8, "
        f"P(zeta > eta) = {np.exp(-eta / 2):.2g} per onset"
        for eta in (20.0, 35.0)
    ]
    head = "Without a maneuver (two axes, consistent filter, long run):"
    return "\n".join([head, *rows])


PAPER_EXIT = Exit()
CONFIRM_EVERY_ALARM = SecondDecision()
