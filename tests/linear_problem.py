"""Constant velocity in the plane with measured positions: the Kalman filter is exact."""

from trackbench.models.motions.kinematic import WhiteAcceleration
from trackbench.models.sensors.position import PositionSensor
from trackbench.scenarios.starts.gaussian import GaussianStart
from trackbench.scenarios.targets.driven import Driven
from trackbench.scenarios.targets.initial_state import Launch
from trackbench.scenarios.tracking import Tracking

LINEAR = Tracking(
    target=Driven(motion=WhiteAcceleration(q=1.0), launch=Launch(x=10.0, vx=1.0, y=-5.0, vy=2.0)),
    sensor=PositionSensor(sigma=2.0),
    start=GaussianStart(sigma=(2.0, 1.0, 2.0, 1.0)),
    last=6,
)
