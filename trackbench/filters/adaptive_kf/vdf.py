"""Variable-dimension filter of Bar-Shalom & Birmiwal 1982: kind `vdf`."""

from dataclasses import dataclass
from typing import ClassVar

from trackbench.field_types import Count, OpenShare, Positive
from trackbench.filters.adaptive_kf.algorithm import Parameters
from trackbench.filters.adaptive_kf.decision_keys import CONFIRM_EVERY_ALARM, Detector, Exit
from trackbench.filters.adaptive_kf.joined_filters import JoinableVariableDimension
from trackbench.filters.base import PLANAR_POSITION
from trackbench.models.base import Scene
from trackbench.models.motions.kinematic import ConstantAcceleration, ConstantVelocity
from trackbench.registry import register


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
        """Motions of the non-maneuvering (nmf) and maneuvering filter (mf), and the decisions.

        The fading sum of the NIS raises alarms, and the onset is the oldest sample of the sum's window.
        """
        # A fading detector without a key `onset` takes the begin of its window.
        detector = Detector(kind="fading", gamma=self.gamma, eta=self.eta, alpha=self.alpha)
        leave = Exit(p=self.p, Ta=self.Ta)
        return Parameters(
            nmf=self.nmf,
            mf=self.mf,
            detector=detector,
            dlw=CONFIRM_EVERY_ALARM,  # second decision (decision logic window)
            exit=leave,
            initialize="barshalom",  # the maneuvering filter refilters the data since the onset
        )

    def conflicts(self, scenario: Scene) -> dict[str, str]:
        """Reject a window that does not fit into the scenario's runs."""
        misfits = super().conflicts(scenario)
        if not misfits:
            return {}
        # The only window is that of `gamma`.
        return {"gamma": next(iter(misfits.values()))}
