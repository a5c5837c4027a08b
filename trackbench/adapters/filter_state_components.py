"""Components of a filter of one run in its own order, against those of the scenario."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from trackbench.core.arrays import Array, Index, with_trailing
from trackbench.core.distributions import Gaussian
from trackbench.models.base import Model

Pair = tuple[Array, Array]
"""Mean (n,) and covariance (n, n) of one run."""


def component_mismatch(
    model: Model, state: Sequence[str], measured: Sequence[str], extra_std: Mapping[str, float]
) -> str | None:
    """Explain why a filter with these components cannot run on the model; None if it can.

    Parameters
    ----------
    model
        the model that the scenario lets the filter assume
    state, measured
        components of the filter's state and measurement; empty for those of the scenario
    extra_std
        initial standard deviations of components that only the filter has

    Returns
    -------
    str or None
        the reason
    """
    scenario_state = model.motion.components
    scenario_measured = model.sensor.components
    # Step 1: the measurement.
    if measured and sorted(measured) != sorted(scenario_measured):
        filter_names = ", ".join(measured)
        scenario_names = ", ".join(scenario_measured)
        return f"it takes {filter_names}; this scenario measures {scenario_names}"
    # Step 2: components of the scenario that the filter lacks, and need not estimate if they are always
    # zero.
    missing = [name for name in scenario_state if state and name not in state]
    if missing:
        zero_components = always_zero_components(model)
        for name in missing:
            if name not in zero_components:
                return f"its state ({', '.join(state)}) has no {name}"
    # Step 3: components of the filter that the scenario lacks.
    for name in state:
        if name not in scenario_state and name not in extra_std:
            scenario_names = ", ".join(scenario_state)
            message = f"its {name} is not a component of this scenario ({scenario_names})"
            return f"{message}; give its initial standard deviation in `extra_std`"
    return None


def always_zero_components(model: Model) -> list[str]:
    """Name the components that stay at zero: the motion neither moves them from zero nor adds noise.

    Such are the errors of a sensor in scenarios with faults. A filter need not estimate them.

    Parameters
    ----------
    model : Model
        Model that the scenario lets the filter assume. Its motion is tried at one state, from step 0 to
        step 1.

    Returns
    -------
    list of str
        Names of the components, in the order of the state.
    """
    motion = model.motion
    zero_components = []
    with np.errstate(all="ignore"):
        for i, name in enumerate(motion.components):
            # Try an arbitrary state in which this component is zero.
            x = np.linspace(0.5, 1.5, len(motion.components))[:, None]
            x[i] = 0.0
            next_state = motion.transition(x, 1)
            # The component's row (n, 1) of the covariance, which may lack the axis over states.
            noise = np.asarray(with_trailing(next_state.cov, 1, leading=2))[i]
            if next_state.mean[i, 0] == 0.0 and not noise.any():
                zero_components.append(name)
    return zero_components


@dataclass(frozen=True)
class Order:
    """Positions of the scenario's components in a filter's state and measurement."""

    shared: Index
    """positions of the scenario's components that the filter has, in the scenario (n_shared,)"""
    places: Index
    """their positions in the filter's state (n_shared,)"""
    size: int
    """number of the scenario's components n_x; a component that the filter lacks is always zero"""
    first_cov: Array
    """initial covariance (n, n) of the components that only the filter has"""
    rows: Index
    """position of each component of the filter's measurement in the scenario's (n_z,)"""

    @classmethod
    def from_model(
        cls, model: Model, state: Sequence[str], measured: Sequence[str], std: Mapping[str, float]
    ) -> "Order":
        """Find the positions of the scenario's components in a filter's state and measurement.

        The filter's `conflicts` has already rejected components with a `component_mismatch`.

        Parameters
        ----------
        model : Model
            Model that the scenario lets the filter assume.
        state, measured : sequence of str
            Components of the filter's state and measurement; empty for those of the scenario.
        std : mapping of str to float
            Initial standard deviations of the components that only the filter has.

        Returns
        -------
        Order
            Positions of the shared components, and the initial covariance of the others.
        """
        scenario_state = model.motion.components
        scenario_measured = model.sensor.components
        filter_state = list(state or scenario_state)
        filter_measured = measured or scenario_measured
        # Components that only the filter has start about zero with their own variance. The others get
        # their covariance from the prior, in `to_filter`.
        variances = []
        for name in filter_state:
            is_extra = name not in scenario_state
            variances.append(std.get(name, 0.0) ** 2 if is_extra else 0.0)
        shared = [name for name in scenario_state if name in filter_state]
        return cls(
            shared=np.array([scenario_state.index(name) for name in shared]),
            places=np.array([filter_state.index(name) for name in shared]),
            size=len(scenario_state),
            first_cov=np.diag(variances),
            rows=np.array([scenario_measured.index(name) for name in filter_measured]),
        )

    def to_filter(self, mean: Array, cov: Array) -> Pair:
        """Reorder the scenario's first state of one run for the filter.

        Parameters
        ----------
        mean : array (n_x,)
            Mean of the prior, in the scenario's order.
        cov : array (n_x, n_x)
            Covariance of the prior.

        Returns
        -------
        mean : array (n,)
            New array in the filter's order, zero for the components that only the filter has.
        cov : array (n, n)
            New array in the filter's order. The components that only the filter has have the covariance
            `first_cov`, without correlation with the others.
        """
        filter_mean = np.zeros(len(self.first_cov))
        filter_mean[self.places] = mean[self.shared]
        filter_cov = self.first_cov.copy()
        filter_cov[np.ix_(self.places, self.places)] = cov[np.ix_(self.shared, self.shared)]
        return filter_mean, filter_cov

    def to_scenario(self, mean: Array, cov: Array) -> Gaussian:
        """Select the scenario's components of the filter's estimates of all runs.

        Parameters
        ----------
        mean : array (n, M)
            Means in the filter's order.
        cov : array (n, n, M)
            Covariances in the filter's order.

        Returns
        -------
        Gaussian
            Mean (n_x, M) and covariance (n_x, n_x, M) in the scenario's order. Both are zero for a
            component that the filter lacks.
        """
        selected = mean[self.places]
        selected_cov = cov[np.ix_(self.places, self.places)]
        if len(self.shared) == self.size:
            return Gaussian(selected, selected_cov)
        # Components that the filter lacks are always zero (`component_mismatch`), and so are their
        # variances: the scores count only the directions in which a covariance has spread.
        M = mean.shape[1]
        scenario_mean = np.zeros((self.size, M))
        scenario_mean[self.shared] = selected
        scenario_cov = np.zeros((self.size, self.size, M))
        scenario_cov[np.ix_(self.shared, self.shared)] = selected_cov
        return Gaussian(scenario_mean, scenario_cov)
