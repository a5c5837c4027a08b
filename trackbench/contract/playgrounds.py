"""The scenarios that filters are examined on."""

from trackbench.models.motions.kinematic import WhiteAcceleration
from trackbench.models.motions.scalar import SineGamma
from trackbench.models.sensors.position import PositionSensor
from trackbench.models.sensors.range_azimuth import RangeAzimuth
from trackbench.models.sensors.square_then_line import SquareThenLine
from trackbench.scenarios.starts.given import GaussianStart, Known
from trackbench.scenarios.targets.base import Launch
from trackbench.scenarios.targets.driven import Driven
from trackbench.scenarios.tracking import Tracking

LINEAR = Tracking(
    target=Driven(motion=WhiteAcceleration(q=1.0), launch=Launch(x=10.0, vx=1.0, y=-5.0, vy=2.0)),
    sensor=PositionSensor(sigma=2.0),
    start=GaussianStart(sigma=(2.0, 1.0, 2.0, 1.0)),
    last=6,
)
"""Constant velocity in the plane, seen through two noisy positions: the Kalman filter is exact."""

SCALAR = Tracking(
    target=Driven(motion=SineGamma(), launch=Launch(x=1.0)),
    sensor=SquareThenLine(R=0.1),
    start=Known(),
    first=1,
    last=8,
)
"""Van der Merwe's scalar model, for filters that need one."""

RADAR = Tracking(
    target=Driven(
        motion=WhiteAcceleration(q=1.0), launch=Launch(x=6000.0, vx=-80.0, y=3000.0, vy=40.0)
    ),
    sensor=RangeAzimuth(sigma_range=20.0, sigma_azimuth_mrad=2.0),
    start=GaussianStart(sigma=(40.0, 4.0, 40.0, 4.0)),
    last=6,
)
"""The same motion before a radar, for filters that take range and azimuth."""
