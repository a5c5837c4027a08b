"""A gate refuses outliers, counts them, and leaves a clean problem alone."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.conftest import track
from trackbench.evaluation.block import simulate
from trackbench.filters.ekf import EKF
from trackbench.filters.imm import IMM
from trackbench.filters.kf import KF
from trackbench.filters.ukf import CKF
from trackbench.models.motions.kinematic import WhiteAcceleration
from trackbench.models.sensors.base import Outliers
from trackbench.models.sensors.position import PositionSensor
from trackbench.scenarios.starts.without_scans import GaussianStart
from trackbench.scenarios.targets.driven import Driven
from trackbench.scenarios.tracking import Tracking

RUNS = 200
CLEAN = Tracking(
    target=Driven(motion=WhiteAcceleration(q=1.0)),
    sensor=PositionSensor(sigma=5.0),
    start=GaussianStart(sigma=(5.0, 2.0, 5.0, 2.0)),
    last=40,
)
SPOILT = replace(CLEAN, sensor=replace(CLEAN.sensor, outliers=Outliers(share=0.05, times=30.0)))


def rms(scenario: Any, tracker: Any) -> float:
    found = track(scenario, tracker, RUNS)
    error = found.mean - simulate(scenario, 1, 0, RUNS).truth
    return float(np.sqrt(np.square(error[[0, 2]]).sum(axis=0).mean()))


@pytest.mark.parametrize("kind", [KF, EKF, CKF])
def test_outliers_are_refused(kind: Any) -> None:
    gated = kind(gate=0.999)
    assert rms(SPOILT, gated) < 0.35 * rms(SPOILT, kind())
    share = np.nanmean(track(SPOILT, gated, RUNS).diagnostics["gated"])
    assert share == pytest.approx(0.05, abs=0.01)


def test_a_clean_problem_loses_what_the_gate_says() -> None:
    gated = track(CLEAN, KF(gate=0.99), RUNS).diagnostics["gated"][1:]
    steps = gated.size
    # refusals of one run hang together a little: six standard errors of independent ones
    assert abs(gated.mean() - 0.01) < 6.0 * np.sqrt(0.01 / steps)
    assert rms(CLEAN, KF(gate=0.999)) < 1.02 * rms(CLEAN, KF())


def test_a_refused_measurement_is_a_missing_one() -> None:
    plain, strict = KF(), KF(gate=1e-9)
    found = track(CLEAN, strict, 3)
    assert found.diagnostics["gated"][1:].all()
    blind = replace(CLEAN, sensor=replace(CLEAN.sensor, period=1000, offset=999))
    np.testing.assert_array_equal(found.mean, track(blind, plain, 3).mean)


def imm(gate: float | None) -> IMM:
    motions = (WhiteAcceleration(q=0.1), WhiteAcceleration(q=10.0))
    stay = ((0.95, 0.05), (0.05, 0.95))
    return IMM(motions=motions, transition=stay, filter=EKF(gate=gate))


def test_an_imm_refuses_what_no_model_explains() -> None:
    assert rms(SPOILT, imm(0.999)) < 0.5 * rms(SPOILT, imm(None))
    assert rms(CLEAN, imm(0.9999)) < 1.02 * rms(CLEAN, imm(None))
    blind = replace(CLEAN, sensor=replace(CLEAN.sensor, period=1000, offset=999))
    strict = track(CLEAN, imm(1e-9), 3)
    np.testing.assert_allclose(strict.mean, track(blind, imm(None), 3).mean, rtol=1e-12)
