"""Linear motion with matrices F and Q over one sampling interval."""

from dataclasses import dataclass

import numpy as np

from trackbench.core import linalg
from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian
from trackbench.models.inputs import KnownInputs


@dataclass(frozen=True, eq=False)
class Linear:
    """Linear motion x_k = F x_{k-1} + N(0, Q) over T seconds."""

    T: float
    """length of the interval, s"""
    F: Array
    """transition matrix (n, n)"""
    Q: Array
    """covariance (n, n) of the noise"""
    components: tuple[str, ...]
    """names of the state's components, in order"""
    extra_std: tuple[float, ...] = ()
    """initial standard deviations of the components beyond position and velocity"""
    rows_of_angles: tuple[int, ...] = ()
    """rows of the state that are angles, rad"""
    recorded_inputs: KnownInputs | None = None
    """inputs of the recording, if it has any, for motions that are sampled alike"""

    def transition(self, x: Array, k: int) -> Gaussian:
        """Return the distribution of x_k given x_{k-1} = x.

        Parameters
        ----------
        x : array (n, *batch)
            States at step k - 1.
        k : int
            Step of the result, on which nothing depends.

        Returns
        -------
        Gaussian
            Mean F x (n, *batch), covariance Q (n, n).
        """
        return Gaussian(linalg.matvec(self.F, x), self.Q)

    def jacobian(self, x: Array, k: int) -> Array:
        """Return the derivatives F (n, n) of the predicted mean, the same for all states and steps."""
        return self.F

    @property
    def alike_axes(self) -> tuple[Array, Array]:
        """F = [1 T; 0 1] and Q (2, 2) of each axis of (px, vx, py, vy), which some filters require.

        It raises AttributeError unless this is constant velocity with equal noise along x and y, so
        that `hasattr` gives False.
        """
        F = np.array([[1.0, self.T], [0.0, 1.0]])
        Q = self.Q[:2, :2]
        # Compare with the matrices of two equal axes.
        has_planar_F = np.array_equal(self.F, np.kron(np.eye(2), F))
        has_planar_Q = np.array_equal(self.Q, np.kron(np.eye(2), Q))
        if not (has_planar_F and has_planar_Q):
            raise AttributeError("this is not constant velocity with equal noise along x and y")
        return F, Q
