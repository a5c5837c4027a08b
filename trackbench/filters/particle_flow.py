"""Daum-Huang particle flow: particles move from the prediction to the posterior."""

from dataclasses import dataclass
from typing import Annotated, ClassVar, cast

import numpy as np
from annotated_types import Interval
from numpy.random import Generator

from trackbench.core import linalg, missing_components
from trackbench.core.arrays import Array, with_trailing
from trackbench.core.distributions import Gaussian
from trackbench.core.kalman import Innovation
from trackbench.filters.ensemble_base import Ensemble, EnsembleFilter, members_together
from trackbench.models.base import DifferentiableSensor, Model, angle_rows
from trackbench.models.numerical_derivatives import jacobian_at
from trackbench.registry import register

_GROWTH = 1.2  # of the steps in the flow's pseudo-time (Li & Coates 2017, section V)


@register("filters", "edh")
@dataclass(frozen=True, kw_only=True)
class ExactFlow(EnsembleFilter):
    """Exact Daum-Huang particle flow: particles move from the prediction to the posterior.

    Daum, Huang & Noushin 2010, in the form of Ding & Coates 2012: the flow that is exact for a linear
    Gaussian model, linearized at the particles' mean, with the particles' covariance.
    """

    steps: Annotated[int, Interval(ge=1, le=1000)] = 29
    """steps in pseudo-time, each 1.2 times as long as the one before"""
    requires: ClassVar[tuple[str, ...]] = ("sensor.jacobian",)

    def step(self, model: Model, state: Ensemble, z: Array, k: int, rng: Generator) -> Ensemble:
        """Move the particles, then integrate the flow in pseudo-time from 0, the prediction, to 1."""
        moved = model.motion.transition(state.x, k).sample(rng)
        x, _ = members_together(moved, angle_rows(model.motion))
        predicted = self.estimate(Ensemble(x, state.nis))  # of x: the NIS is not read
        start = predicted.mean
        P = predicted.cov
        # All particles of a run flow by one affine map of their deviations from the mean, x -> B x + c:
        # dB = A B dt, dc = (A c + b) dt (Euler steps, with A and b of the middle of each step).
        B = np.broadcast_to(with_trailing(np.eye(len(P)), 1, leading=2), P.shape)
        c = np.zeros_like(start)
        pseudo_time = 0.0
        # The innovation of the prediction: in the first step the mean has not been shifted yet, c = 0.
        first_innovation = None
        sensor = cast(DifferentiableSensor, model.sensor)
        for length in _step_lengths(self.steps):
            A, b, innovation = _flow(
                sensor, Gaussian(start, P), c, z, k, pseudo_time + 0.5 * length
            )
            if first_innovation is None:
                first_innovation = innovation
            B = B + length * linalg.matmul(A, B)
            c = c + length * (linalg.matvec(A, c) + b)
            pseudo_time += length
        deviations = linalg.matvec(B[..., None], x - start[..., None])
        assert first_innovation is not None
        return Ensemble(
            x=deviations + (start + c)[..., None],
            nis=first_innovation.nis,
            innovation=first_innovation,
        )


def _flow(
    sensor: DifferentiableSensor, prior: Gaussian, shift: Array, z: Array, k: int, t: float
) -> tuple[Array, Array, Innovation]:
    """Return A (n, n, M) and b (n, M) of the flow dx = (A x + b) dt, and an innovation.

    The states x are deviations from the mean m of the prior N(m, P). The measurement is linearized at
    m + shift, with ``y = z - h(m + shift) + H shift``. At the pseudo-time t, of 0 to 1,
    ``A = -P H' (t H P H' + R)^-1 H / 2`` and ``b = (I + 2 t A) (I + t A) P H' R^-1 y`` (Ding & Coates
    2012, eqs. 9, 10). The innovation is z - h(m + shift), with the covariance H P H' + R: with a shift
    of zero, that of the prior.
    """
    shifted_mean = prior.mean + shift
    expected = sensor.measurement(shifted_mean, k)
    nu = sensor.innovation(z, expected.mean)
    missing = np.isnan(nu)
    H = jacobian_at(sensor, Gaussian(shifted_mean, prior.cov), k)
    H, R = missing_components.drop_missing(H, expected.cov, missing)
    H = with_trailing(H, 1, leading=2)
    R = with_trailing(R, 1, leading=2)
    PH = linalg.matmul(prior.cov, linalg.transpose(H))
    HPH = linalg.symmetrize(linalg.matmul(H, PH))
    # A = -P H' (t H P H' + R)^-1 H / 2 (eq. 9)
    A = -0.5 * linalg.matmul(PH, linalg.matmul(linalg.inverse(t * HPH + R), H))
    # b = (I + 2 t A) (I + t A) P H' R^-1 y (eq. 10)
    y = np.where(missing, 0.0, nu) + linalg.matvec(H, shift)
    b = linalg.matvec(PH, linalg.matvec(linalg.inverse(R), y))
    for factor in (1.0, 2.0):
        b = b + factor * t * linalg.matvec(A, b)
    return A, b, Innovation(nu, HPH + R)


def _step_lengths(steps: int) -> list[float]:
    """Return the lengths of the steps in pseudo-time, which grow by a factor and sum to one."""
    lengths = [_GROWTH**i for i in range(steps)]
    # In order: `sum` differs from Python 3.12 on.
    whole = 0.0
    for length in lengths:
        whole += length
    return [length / whole for length in lengths]
