"""A sampled linear motion: the matrices F and Q, and the interval they are of."""

from dataclasses import dataclass

import numpy as np

from trackbench.core import linalg
from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian


@dataclass(frozen=True, eq=False)
class Linear:
    """x_k = F x_{k-1} + N(0, Q), sampled every T seconds; F and Q (n, n).

    ``extra_std``: see `trackbench.models.base.extra_std`.
    """

    T: float
    F: Array
    Q: Array
    components: tuple[str, ...]
    extra_std: tuple[float, ...] = ()

    def transition(self, x: Array, k: int) -> Gaussian:
        """Return N(F x, Q)."""
        return Gaussian(linalg.matvec(self.F, x), self.Q)

    def jacobian(self, x: Array, k: int) -> Array:
        """Return the F."""
        return self.F

    @property
    def alike_axes(self) -> tuple[Array, Array]:
        """Return F = [1 T; 0 1] and Q (2, 2) of each axis of (px, vx, py, vy).

        Raises AttributeError for any other motion.
        """
        F, Q = np.array([[1.0, self.T], [0.0, 1.0]]), self.Q[:2, :2]
        whole = (np.kron(np.eye(2), block) for block in (F, Q))
        if not all(map(np.array_equal, (self.F, self.Q), whole)):
            raise AttributeError("no constant velocity, alike along x and y")
        return F, Q
