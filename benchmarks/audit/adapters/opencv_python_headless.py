"""OpenCV: cv2.KalmanFilter."""

import cv2
import numpy as np

from benchmarks.audit.linear import Matrices


class Kalman(Matrices, kind="KalmanFilter"):
    def start(self, mean, cov):
        self.one = cv2.KalmanFilter(4, 2, 0, cv2.CV_64F)
        self.one.statePost, self.one.errorCovPost = mean[:, None], cov

    def step(self, z, dt):
        one = self.one
        one.transitionMatrix, one.processNoiseCov = self.motion_matrices()
        one.measurementMatrix, one.measurementNoiseCov = self.sensor_matrices()
        one.predict()
        if z is not None:
            one.correct(z[:, None])
        return one.statePost[:, 0].copy(), np.array(one.errorCovPost)
