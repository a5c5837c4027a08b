"""The package `particles`: a state-space model class, `Bootstrap`, `SMC`."""

from typing import Any

import numpy as np
import particles
from particles import distributions as dists
from particles import state_space_models as ssm
from particles.collectors import Moments

from trackbench.core.arrays import Array


class MerweModel(ssm.StateSpaceModel):
    def _moved(self, t: int, x: Array | float) -> dists.ProbDist:
        s = self.scenario
        k = s.steps[t + 1]
        noise = dists.Gamma(s.gamma_shape, s.gamma_rate)
        return dists.LinearD(noise, b=1.0 + np.sin(s.w * np.pi * k) + s.phi1 * x)

    def PX0(self) -> dists.ProbDist:
        return self._moved(0, self.scenario.x1)

    def PX(self, t: int, xp: Array) -> dists.ProbDist:
        return self._moved(t, xp)

    def PY(self, t: int, xp: Array, x: Array) -> dists.ProbDist:
        s = self.scenario
        h = s.phi2 * x**2 if s.steps[t + 1] <= s.switch else s.phi3 * x - 2.0
        return dists.Normal(loc=h, scale=np.sqrt(s.R))


def merwe_pf(scenario: Any, z: Array, N: int) -> Array:
    """Bootstrap filter, one `SMC` per run; z (1, T, M), estimates (1, T, M)."""
    out = np.empty_like(z)
    model = MerweModel(scenario=scenario)
    for m in range(z.shape[2]):
        fk = ssm.Bootstrap(ssm=model, data=z[0, :, m])
        smc = particles.SMC(fk=fk, N=N, resampling="systematic", ESSrmin=1.0, collect=[Moments()])
        smc.run()
        out[0, :, m] = [moments["mean"] for moments in smc.summaries.moments]
    return out


class Moved(dists.ProbDist):
    """The first measured state: a given cloud moved by one step."""

    dim = 4

    def __init__(self, cloud: Array, F: Array, Q: Array) -> None:
        self.cloud, self.F, self.Q = cloud, F, Q

    def rvs(self, size: int | None = None) -> Array:
        return dists.MvNormal(loc=self.cloud.T @ self.F.T, cov=self.Q).rvs(size=size)


class BananaModel(ssm.StateSpaceModel):
    def PX0(self) -> dists.ProbDist:
        return Moved(self.cloud, self.F, self.Q)

    def PX(self, t: int, xp: Array) -> dists.ProbDist:
        return dists.MvNormal(loc=xp @ self.F.T, cov=self.Q)

    def PY(self, t: int, xp: Array, x: Array) -> dists.ProbDist:
        px, py = x[:, 0], x[:, 2]
        return dists.IndepProd(
            dists.Normal(loc=np.sqrt(px**2 + py**2), scale=np.sqrt(self.R[0, 0])),
            dists.Normal(loc=np.arctan2(py, px), scale=np.sqrt(self.R[1, 1])),
        )


def banana_pf(F: Array, Q: Array, R: Array, clouds: list[Array], z: Array) -> Array:
    """Bootstrap filter of range and azimuth z (2, T, M) from clouds (4, N); estimates (4, T, M).

    The azimuth does not cross the cut of atan2 on this track.
    """
    out = np.empty((4, z.shape[1], len(clouds)))
    for m, cloud in enumerate(clouds):
        model = BananaModel(cloud=cloud, F=F, Q=Q, R=R)
        fk = ssm.Bootstrap(ssm=model, data=list(z[:, :, m].T[:, None]))
        smc = particles.SMC(
            fk=fk, N=cloud.shape[1], resampling="systematic", ESSrmin=1.0, collect=[Moments()]
        )
        smc.run()
        out[:, :, m] = np.array([moments["mean"] for moments in smc.summaries.moments]).T
    return out
