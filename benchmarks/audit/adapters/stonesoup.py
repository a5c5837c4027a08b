"""Stone Soup: the Gaussian filters of its predictors and updaters."""

import numpy as np
from stonesoup.predictor import kalman as predictors
from stonesoup.types.state import SqrtGaussianState
from stonesoup.updater import kalman as updaters

from benchmarks.audit.nonlinear import CUBATURE, EXTENDED, Iterated, SigmaPoints
from trackbench.adapters import StoneSoup


class Kalman(StoneSoup, kind="KalmanUpdater"):
    def make(self, transition, measurement):
        return predictors.KalmanPredictor(transition), updaters.KalmanUpdater(measurement)


class Extended(StoneSoup, kind="ExtendedKalmanUpdater"):
    rule = EXTENDED

    def make(self, transition, measurement):
        return (
            predictors.ExtendedKalmanPredictor(transition),
            updaters.ExtendedKalmanUpdater(measurement),
        )


class Unscented(StoneSoup, kind="UnscentedKalmanUpdater"):
    rule = SigmaPoints(alpha=0.5, beta=2.0, kappa=-1.0)

    def make(self, transition, measurement):
        return (
            predictors.UnscentedKalmanPredictor(transition),
            updaters.UnscentedKalmanUpdater(measurement),
        )


class Cubature(StoneSoup, kind="CubatureKalmanUpdater"):
    rule = CUBATURE

    def make(self, transition, measurement):
        return (
            predictors.CubatureKalmanPredictor(transition),
            updaters.CubatureKalmanUpdater(measurement),
        )


class Iterated(StoneSoup, kind="IteratedKalmanUpdater"):
    rule = Iterated()

    def make(self, transition, measurement):
        return (
            predictors.ExtendedKalmanPredictor(transition),
            updaters.IteratedKalmanUpdater(measurement),
        )


class SquareRoot(StoneSoup, kind="SqrtKalmanUpdater"):
    rule = EXTENDED

    def make(self, transition, measurement):
        return (
            predictors.SqrtKalmanPredictor(transition),
            updaters.SqrtKalmanUpdater(measurement),
        )

    def start(self, mean, cov):
        super().start(mean, cov)
        root = np.linalg.cholesky(cov)
        self._now = SqrtGaussianState(mean, root, timestamp=self._now.timestamp)
