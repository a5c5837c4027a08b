"""A sampled linear motion: the matrices F and Q, and the interval they are of."""

from dataclasses import dataclass

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
        """N(F x, Q)."""
        return Gaussian(linalg.matvec(self.F, x), self.Q)

    def jacobian(self, x: Array, k: int) -> Array:
        """F."""
        return self.F
