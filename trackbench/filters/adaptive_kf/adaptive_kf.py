"""Adaptive Kalman filter of the paper: kind `adaptive-kf`, its keys and presets."""

from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np

from trackbench.filters.adaptive_kf.alarm_threshold import tail
from trackbench.filters.adaptive_kf.algorithm import Parameters
from trackbench.filters.adaptive_kf.decision_keys import (
    CONFIRM_EVERY_ALARM,
    PAPER_EXIT,
    Detector,
    Exit,
    SecondDecision,
)
from trackbench.filters.adaptive_kf.joined_filters import JoinableVariableDimension
from trackbench.filters.base import PLANAR_POSITION
from trackbench.models.motions.kinematic import ConstantAcceleration, ConstantVelocity
from trackbench.registry import register


@register("filters", "adaptive-kf")
@dataclass(frozen=True, kw_only=True)
class AdaptiveKF(JoinableVariableDimension):
    """Adaptive Kalman filter: a detector switches from constant velocity to constant acceleration.

    Tang, Sun & Liu, adaptive-kf paper, section 3, after Bar-Shalom & Birmiwal 1982, Bogler 1987 and
    Park, Seo & Lee 1995. The paper states no process noise: both filters have a key q.
    """

    nmf: ConstantVelocity
    """motion of the non-maneuvering filter: {q: ..., noise_gain: standard | printed}"""
    mf: ConstantAcceleration
    """motion of the maneuvering filter; the detector estimates its first acceleration"""
    detector: Detector
    """first decision: statistic, threshold, window, onset"""
    dlw: SecondDecision = CONFIRM_EVERY_ALARM
    """second decision, between both filters"""
    exit: Exit = PAPER_EXIT
    """return to the non-maneuvering filter"""
    initialize: Literal["ie", "barshalom"] = "ie"
    """start of the maneuvering filter: estimated input added, or refiltered from the onset (1982)"""
    requires: ClassVar[tuple[str, ...]] = PLANAR_POSITION
    summed_diagnostics: ClassVar[frozenset[str]] = frozenset({"alarm"})
    presets: ClassVar[dict[str, dict[str, Any]]] = {
        "paper-eta35": {"detector": {"kind": "fading-ie", "gamma": 0.8, "eta": 35.0}},
        "paper-eta20": {"detector": {"kind": "fading-ie", "gamma": 0.8, "eta": 20.0}},
        "seconds": {
            "detector": {"kind": "ie", "eta": 20.0, "window_s": 60.0, "min_window_s": 15.0},
            "exit": {"p": 2, "Ta": 9.49, "hold_s": 30.0},
        },
    }

    @property
    def parameters(self) -> Parameters:
        """Motions of the non-maneuvering (nmf) and maneuvering filter (mf), and the decisions.

        ``detector`` raises alarms, ``dlw``, the decision logic window, confirms or rejects them, and
        ``exit`` ends a maneuver.
        """
        return Parameters(
            nmf=self.nmf,
            mf=self.mf,
            detector=self.detector,
            dlw=self.dlw,
            exit=self.exit,
            initialize=self.initialize,
        )

    @classmethod
    def explain(cls) -> str:
        """Explain the false-alarm probabilities of the thresholds in the paper: eta = 20 and 35.

        rho is the fading sum of the NIS, with the paper's fading factor gamma = 0.8. zeta is the
        significance of the input that is estimated for one onset, chi-square with two degrees of
        freedom.
        """
        rows = [
            f"  eta = {eta:g}: P(rho > eta) = {tail(eta, 0.8):.2g} per sample at gamma = 0.8, "
            f"P(zeta > eta) = {np.exp(-eta / 2):.2g} per onset"
            for eta in (20.0, 35.0)
        ]
        head = "Without a maneuver (two axes, consistent filter, long run):"
        return "\n".join([head, *rows])
