"""Mistakes of other kinds, planted when the checks of the contract were finished."""

from typing import Any

import numpy as np

from tests.planted import Cloud, HandEKF, HandKF, HandPF, Track
from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian
from trackbench.models.base import Model


def _shown(state: Track, x: Array, P: Array) -> Track:
    return state._replace(x=x, P=P, shown=Gaussian(x, P))


class OldJacobian(HandEKF):
    """H at the state before the prediction."""

    def step(self, model: Any, state: Track, z: Array, k: int, rng: Any) -> Track:
        class Stale:
            def __getattr__(self, name: str) -> Any:
                return getattr(model.sensor, name)

            def jacobian(self, x: Array, k: int) -> Array:
                return model.sensor.jacobian(state.x * 1.02, k)

        return super().step(Model(model.motion, Stale()), state, z, k, rng)  # type: ignore[arg-type]


class UsedTwice(HandEKF):
    """Every measurement updates twice."""

    def step(self, model: Any, state: Track, z: Array, k: int, rng: Any) -> Track:
        class Sharp:
            def __getattr__(self, name: str) -> Any:
                return getattr(model.sensor, name)

            def measurement(self, x: Array, k: int) -> Gaussian:
                g = model.sensor.measurement(x, k)
                return Gaussian(g.mean, 0.5 * g.cov)

        return super().step(Model(model.motion, Sharp()), state, z, k, rng)  # type: ignore[arg-type]


class Uncorrelated(HandEKF):
    """Only variances go on to the next step."""

    def step(self, model: Any, state: Track, z: Array, k: int, rng: Any) -> Track:
        new = super().step(model, state, z, k, rng)
        return _shown(new, new.x, new.P * np.eye(4)[..., None])


class LateMeasurement(HandEKF):
    """The update takes the measurement of the step before."""

    def init(self, model: Any, prior: Any, rng: Any) -> Any:
        return super().init(model, prior, rng), None

    def step(self, model: Any, state: Any, z: Array, k: int, rng: Any) -> Any:
        track, before = state
        return super().step(model, track, z if before is None else before, k, rng), z

    def estimate(self, state: Any) -> Gaussian:
        return super().estimate(state[0])

    def diagnostics(self, state: Any) -> dict[str, Array]:
        return super().diagnostics(state[0])


class PriorSpread(HandEKF):
    """The square root of the prior's covariance."""

    def init(self, model: Any, prior: Any, rng: Any) -> Track:
        new = super().init(model, prior, rng)
        return _shown(new, new.x, np.sqrt(new.P))


class OtherStep(HandEKF):
    """The motion of the next step's interval."""

    def step(self, model: Any, state: Track, z: Array, k: int, rng: Any) -> Track:
        class Off:
            def transition(self, x: Array, k: int) -> Any:
                return model.motion.transition(x, max(k - 1, 1))

            def jacobian(self, x: Array, k: int) -> Array:
                return model.motion.jacobian(x, max(k - 1, 1))

        return super().step(Model(Off(), model.sensor), state, z, k, rng)  # type: ignore[arg-type]


class Clipped(HandEKF):
    """Speeds are cut off."""

    def step(self, model: Any, state: Track, z: Array, k: int, rng: Any) -> Track:
        new = super().step(model, state, z, k, rng)
        x = new.x.copy()
        x[1::2] = np.clip(x[1::2], -80.0, 80.0)
        return _shown(new, x, new.P)


class BestHalf(HandPF):
    """Resampling takes the heavier half of the particles twice."""

    def step(self, model: Any, state: Cloud, z: Array, k: int, rng: Any) -> Cloud:
        new = super().step(model, state, z, k, rng)
        order = np.argsort(np.square(new.x - new.shown.mean[..., None]).sum(axis=0), axis=-1)
        half = np.concatenate([order[:, : self.N // 2]] * 2, axis=-1)[:, : self.N]
        return new._replace(x=np.take_along_axis(new.x, half[None], axis=-1))


class Unweighted(HandPF):
    """The estimate ignores the weights."""

    def moments(self, x: Array, w: Array) -> Gaussian:
        return super().moments(x, np.full_like(w, 1.0 / x.shape[-1]))


class NoJitterOfVelocity(HandPF):
    """Process noise moves positions only."""

    def step(self, model: Any, state: Cloud, z: Array, k: int, rng: Any) -> Cloud:
        class Still:
            def __init__(self, motion: Any) -> None:
                self.motion = motion

            def transition(self, x: Array, k: int) -> Any:
                law = self.motion.transition(x, k)

                class Law:
                    mean = law.mean

                    def sample(self, rng: Any) -> Array:
                        moved = law.sample(rng)
                        moved[1::2] = law.mean[1::2]
                        return moved

                return Law()

        return super().step(Model(Still(model.motion), model.sensor), state, z, k, rng)  # type: ignore[arg-type]


class FixedGain(HandKF):
    """The covariance of the first update is that of all."""

    def step(self, z: Array | None, dt: float) -> tuple[Array, Array]:
        x, P = super().step(z, dt)
        if not hasattr(self, "first"):
            self.first = P
        self.P = self.first
        return x, self.P


class NoiseTwice(HandKF):
    """The process noise is added before and after the update."""

    def step(self, z: Array | None, dt: float) -> tuple[Array, Array]:
        x, P = super().step(z, dt)
        B = np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
        self.P = P + self.q * np.kron(np.eye(2), B)
        return x, self.P
