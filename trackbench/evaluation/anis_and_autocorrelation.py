"""ANIS and autocorrelation of a filter's innovations: their series, and the metrics of each run."""

from collections.abc import Iterator, Mapping

import numpy as np

from trackbench.core import linalg, missing_components
from trackbench.core.arrays import Array, Mask
from trackbench.core.sums import total_of_known

LAGS = 10
"""Largest lag, in measurements, of the autocorrelation."""


def innovation_series(nu: Array, S: Array, refused: Mask) -> dict[str, Array]:
    """Return ``anis``, ``innovations`` and ``autocovariance_<lag>`` of all steps.

    Parameters
    ----------
    nu
        innovations (n_z, T, M), in the units of the measurement, NaN for missing components
    S
        their covariances (n_z, n_z, T, M), NaN for a prediction without a covariance, with the row of a
        unit matrix for a missing component
    refused
        mask (n_z, T, M) of the components that the filter's gate left out

    Returns
    -------
    dict
        series (T, M) by name: NIS over the number of measured components, this number, and lagged
        products of whitened innovations. They are NaN where no component is known
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
    """Return the ANIS and the autocorrelations of each run over some steps.

    Parameters
    ----------
    values
        series (T + 1, M) by name, among them those of `innovation_series`
    mask
        mask (T + 1,) of the steps

    Returns
    -------
    dict
        ``anis`` and ``autocorrelation_<lag>`` (M,); empty without the series
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
