"""The package `particles`: a state-space model class, `Bootstrap`, `SMC`."""

import numpy as np
import particles
from particles import distributions as dists
from particles import state_space_models as ssm
from particles.collectors import Moments

from trackbench.core.arrays import Array
from trackbench.scenarios.merwe import Merwe


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


def merwe_pf(scenario: Merwe, z: Array, N: int) -> Array:
    """Bootstrap filter, one `SMC` per run; z (1, T, M), estimates (1, T, M)."""
    out = np.empty_like(z)
    model = MerweModel(scenario=scenario)
    for m in range(z.shape[2]):
        fk = ssm.Bootstrap(ssm=model, data=z[0, :, m])
        smc = particles.SMC(fk=fk, N=N, resampling="systematic", ESSrmin=1.0, collect=[Moments()])
        smc.run()
        out[0, :, m] = [moments["mean"] for moments in smc.summaries.moments]
    return out
