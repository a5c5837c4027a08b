"""Innovations of a filter, from its predictions: their NIS, and their autocorrelation by lag."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from trackbench.core import linalg, missing_components
from trackbench.core.arrays import Array, Mask
from trackbench.core.distributions import Gaussian
from trackbench.core.kalman import Innovation
from trackbench.core.sums import total_of_known
from trackbench.evaluation.nees import side_by_side
from trackbench.models.base import Model
from trackbench.models.sensors.steps_at_once import SensorOfSteps

LAGS = 10
"""Largest lag, in measurements, of the autocorrelation."""
_AT_ONCE = 65_536
"""Numbers in the covariances of the predictions whose innovations are computed in one call."""


class Innovations:
    """Innovations of predictions, computed for many steps in one call."""

    def __init__(self, model: Model, errors_at_mean: bool = False) -> None:
        """Begin without predictions; ``model`` is the one that the filter assumes.

        The predicted measurement is the mean of h over the predicted Gaussian, by cubature. With
        ``errors_at_mean`` the `errors` are those of h at the predicted mean instead. That is for a
        filter that never updates, whose covariance grows without a limit.
        """
        self._model = model
        self._errors_at_mean = errors_at_mean
        # Steps that wait for a call: predicted state, measurements and number of each.
        self._waiting: list[tuple[Gaussian, Array, int]] = []
        # By call: the innovations and the prediction errors of its steps.
        self._computed: list[Innovation] = []
        self._errors: list[Array] = []

    def add(self, predicted: Gaussian, z: Array, k: int) -> None:
        """Add the predicted state of step k and the step's measurements (n_z, M).

        The step waits until there are enough for one call.
        """
        self._waiting.append((predicted, z, k))
        # Numbers in covariances (n, n, M) of all waiting steps; the size of the mean is n M.
        if len(self._waiting) * len(predicted.mean) * predicted.mean.size >= _AT_ONCE:
            self._compute_waiting()

    def add_steps(self, predicted: Gaussian, z: Array, steps: Sequence[int]) -> None:
        """Add predictions of many steps, with means (n, T, M), and their measurements (n_z, T, M).

        ``steps`` are the numbers of the steps.
        """
        self._compute_waiting()  # the steps that were added before come first
        n = len(predicted.mean)
        model = Model(self._model.motion, SensorOfSteps(self._model.sensor, steps))
        # The batch (T, M) becomes one axis.
        cov = np.broadcast_to(predicted.cov, (n, n, *z.shape[1:])).reshape(n, n, -1)
        together = Gaussian(predicted.mean.reshape(n, -1), cov)
        z = z.reshape(len(z), -1)
        # `SensorOfSteps` has the numbers of the steps: the one given here matters to no sensor.
        innovation = _innovation(model, together, z, steps[-1])
        self._computed.append(innovation)
        # Innovations are z less the mean of h over the predicted Gaussian. A filter that never updates
        # is judged by z - h(predicted mean), the error of its path, however wide its covariance is.
        if self._errors_at_mean:
            measured = model.sensor.measurement(together.mean, steps[-1])
            self._errors.append(model.sensor.innovation(z, measured.mean))
        else:
            self._errors.append(innovation.nu)

    def joined(self, runs: int) -> tuple[Array, Array]:
        """Return the innovations (n_z, T, M) of all steps and their covariances (n_z, n_z, T, M).

        ``runs`` is M.
        """
        self._compute_waiting()
        nu = np.concatenate([i.nu for i in self._computed], axis=1)
        S = np.concatenate([i.S for i in self._computed], axis=2)
        n_z = len(nu)
        return nu.reshape(n_z, -1, runs), S.reshape(n_z, n_z, -1, runs)

    def errors(self, runs: int) -> Array:
        """Return the prediction errors (n_z, T, M) of all steps.

        They are the innovations, or with ``errors_at_mean`` the errors z - h(predicted mean). ``runs``
        is M.
        """
        self._compute_waiting()
        errors = np.concatenate(self._errors, axis=1)
        return errors.reshape(len(errors), -1, runs)

    def _compute_waiting(self) -> None:
        """Compute the innovations of the steps that were added one by one."""
        if self._waiting:
            estimates, z, steps = zip(*self._waiting, strict=True)
            self._waiting.clear()  # first, as `add_steps` computes the waiting ones
            means = np.stack([estimate.mean for estimate in estimates], axis=1)
            covs = side_by_side([estimate.cov for estimate in estimates])
            self.add_steps(Gaussian(means, covs), np.stack(z, axis=1), steps)


def _innovation(model: Model, predicted: Gaussian, z: Array, k: int) -> Innovation:
    """Return the innovations of measurements z (n_z, B) at step k, with covariances S, from predictions.

    If a predicted state has a mean and no covariance, the measurement is predicted by the sensor at the
    mean, and S is NaN.
    """
    # Imported here, since pydantic comes with the filters' keys, and a worker may need neither.
    from trackbench.filters.ukf import predicted_innovation

    mean_only = np.isnan(predicted.cov).any(axis=(0, 1)) & ~np.isnan(predicted.mean).any(axis=0)
    if not mean_only.any():
        return predicted_innovation(model, predicted, z, k)
    without_spread = Gaussian(predicted.mean, np.where(mean_only, 0.0, predicted.cov))
    innovation = predicted_innovation(model, without_spread, z, k)
    return innovation._replace(S=np.where(mean_only, np.nan, innovation.S))


def innovation_series(nu: Array, S: Array, refused: Mask) -> dict[str, Array]:
    """Return ``anis``, ``innovations`` and ``autocovariance_<lag>`` (T, M) of all steps.

    nu (n_z, T, M) are the innovations, NaN for missing components, and S (n_z, n_z, T, M) their
    covariances. ``refused`` (n_z, T, M) are the components that the filter's gate left out.
    """
    # Step 1: whiten, e = L^-1 nu with S = L L'. Missing and refused components have no e, and
    # neither have the components of a prediction without a covariance.
    refused = refused & ~np.isnan(nu)
    missing = np.isnan(nu) | refused
    for i in range(len(nu)):
        missing[i] |= np.isnan(S[i, i])
    number = (~missing).sum(axis=0)
    if (refused.any(axis=0) & (number > 0)).any():
        # Some components are refused and others are used: whiten these by S without the refused ones.
        # S has the rows of a unit matrix already for components that are missing.
        S = missing_components.drop_missing_cov(S, refused)
    whitened = list(linalg.whiten(linalg.cholesky(S), np.where(missing, 0.0, nu)))
    e = np.where(missing, np.nan, np.stack(whitened))
    series: dict[str, Array] = {}
    # Step 2: NIS = e' e, over the number of measured components.
    series["anis"] = _sum_of_known(np.square(e)) / number
    series["innovations"] = np.where(number > 0, number, np.nan)
    # Step 3: products with the whitened innovations of the last LAGS measurements.
    for lag, products in enumerate(_lagged_products(e, missing), 1):
        series[f"autocovariance_{lag}"] = _sum_of_known(products)
    return series


def innovation_metrics(values: Mapping[str, Array], mask: Mask) -> dict[str, Array]:
    """Return the ANIS and the autocorrelations of each run (M,) over the steps of the mask (T + 1,).

    ``values`` are the series (T + 1, M) of `innovation_series`; without them the result is empty.
    """
    if "innovations" not in values:
        return {}
    metrics: dict[str, Array] = {}
    # ANIS = sum of NIS over the number of measured components.
    nis = total_of_known((values["anis"] * values["innovations"])[mask])
    metrics["anis"] = nis / total_of_known(values["innovations"][mask])
    # Autocorrelation = sum of lagged products over sum of squares (lag 0).
    for name, rows in values.items():
        if name.startswith("autocovariance_"):
            # A run without two measurements at this lag has no correlation.
            paired = ~np.isnan(rows[mask]).all(axis=0)
            correlation = np.where(paired, total_of_known(rows[mask]) / nis, np.nan)
            metrics[name.replace("covariance", "correlation")] = correlation
    return metrics


def _lagged_products(white: Array, missing: Mask) -> Iterator[Array]:
    """Yield ``e_j e_(j-l)`` (n, T, M) for each lag l from 1 to `LAGS`.

    ``white`` (n, T, M) are the whitened innovations e. j counts the known values of a component, so
    that steps without a measurement are skipped; ``missing`` (n, T, M) marks the other values.
    """
    # Known values stand before the missing ones, in the order of their steps.
    order = np.argsort(missing, axis=1, kind="stable")
    known = np.take_along_axis(white, order, axis=1)
    for lag in range(1, LAGS + 1):
        lagged = known[:, lag:] * known[:, :-lag]
        products = np.full_like(white, np.nan)
        np.put_along_axis(products, order[:, lag:], lagged, axis=1)
        yield products


def _sum_of_known(rows: Array) -> Array:
    """Sum the known values of the rows (n, T, M) over the components; NaN if none is known."""
    known = ~np.isnan(rows)
    return np.where(known.any(axis=0), total_of_known(rows), np.nan)
