"""Kinds of the filters of variable dimension: `adaptive-kf` of the paper, and `vdf` of 1982."""

from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np

from trackbench.field_types import Count, OpenShare, Positive
from trackbench.filters.adaptive_kf.algorithm import Parameters
from trackbench.filters.adaptive_kf.decision_keys import (
    CONFIRM_EVERY_ALARM,
    PAPER_EXIT,
    Detector,
    Exit,
    SecondDecision,
    tail,
)
from trackbench.filters.adaptive_kf.joined_filters import JoinableVariableDimension
from trackbench.filters.base import PLANAR_POSITION
from trackbench.models.base import Scene
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
        """Motions and decisions, from the keys."""
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
        """Explain the false-alarm probabilities of the paper's thresholds."""
        rows = [
            f"  eta = {eta:g}: P(rho > eta) = {tail(eta, 0.8):.2g} per sample at gamma = 0.8, "
            f"P(zeta > eta) = {np.exp(-eta / 2):.2g} per onset"
            for eta in (20.0, 35.0)
        ]
        head = "Without a maneuver (two axes, consistent filter, long run):"
        return "\n".join([head, *rows])


@register("filters", "vdf")
@dataclass(frozen=True, kw_only=True)
class VDF(JoinableVariableDimension):
    """Variable-dimension filter: refilters the last window with an acceleration after an alarm.

    Bar-Shalom & Birmiwal 1982. A fading sum of the NIS raises the alarm, not before step 20. The
    onset of the maneuver is the begin of the window. The maneuver ends when the acceleration is
    insignificant.
    """

    nmf: ConstantVelocity
    """motion in quiet flight"""
    mf: ConstantAcceleration
    """motion in a maneuver"""
    gamma: OpenShare = 0.8
    """fading factor of the NIS; the window is 1 / (1 - gamma) samples"""
    eta: Positive | None = None
    """threshold of the fading sum; give this or alpha"""
    alpha: OpenShare | None = None
    """false-alarm probability at one sample"""
    p: Count = 2
    """samples over which the acceleration's significance is summed"""
    Ta: Positive = 9.49
    """threshold of that sum"""
    requires: ClassVar[tuple[str, ...]] = PLANAR_POSITION
    contract_exemptions: ClassVar[dict[str, str]] = {"kalman": "has motions of its own"}
    summed_diagnostics: ClassVar[frozenset[str]] = frozenset({"alarm"})

    def __post_init__(self) -> None:
        if (self.eta is None) == (self.alpha is None):
            raise ValueError("give one of eta and alpha")

    @property
    def parameters(self) -> Parameters:
        """Decisions: the fading sum raises alarms, all are confirmed, the onset begins the window."""
        detector = Detector(kind="fading", gamma=self.gamma, eta=self.eta, alpha=self.alpha)
        leave = Exit(p=self.p, Ta=self.Ta)
        return Parameters(
            nmf=self.nmf,
            mf=self.mf,
            detector=detector,
            dlw=CONFIRM_EVERY_ALARM,
            exit=leave,
            initialize="barshalom",
        )

    def conflicts(self, scenario: Scene) -> dict[str, str]:
        """Reject a window that does not fit into the scenario's runs."""
        misfits = super().conflicts(scenario)
        if not misfits:
            return {}
        # The only window is that of `gamma`.
        return {"gamma": next(iter(misfits.values()))}
