"""First state of the filters of a new config: its time, and a robot's pose there by the truth."""

import math
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.durations import time_text
from trackbench.models.inputs import KnownInputs
from trackbench.scenarios.recordings.guess_record import Guess
from trackbench.scenarios.recordings.quantity_keys import ODOMETRY
from trackbench.scenarios.recordings.rows_and_reading_context import TICK

POSE = ("X", "Y", "HEADING")
"""Words for the unknown numbers of a pose, which the user must write."""


class FirstState(NamedTuple):
    """Time and pose of the first state of filters, as a tried config has them."""

    begin: float
    """its time, s or steps"""
    pose: tuple[float, ...] = ()
    """x, y and heading there by the truth, NaN where the truth lacks one; empty if it is unknown"""
    later: float = 0.0
    """time by which the truth begins later, s or steps"""
    is_moved: bool = False
    """True if the truth's pose was moved back over this time"""


def first_state_of_robot(
    times: Array, truth: Array, inputs: KnownInputs | None, gap: float
) -> FirstState:
    """Return the time of the filters' first state, and the pose there by the truth of a robot.

    A pose that is later by at most the ``gap`` of the truth, or by the first step, is moved back by the
    odometry. It stays as it is if the truth has no heading.

    Parameters
    ----------
    times
        times (K,) of the steps, the first of them that of the first state
    truth
        poses (n_x, K, M), each with the position first, NaN where it is unknown; run 0 counts
    inputs
        speeds and turn rates of the robot
    gap
        longest gap of the truth, s or steps
    """
    begin = float(times[0])
    poses = truth[:, :, 0]
    known = np.flatnonzero(np.isfinite(poses[:2]).all(axis=0))
    if not len(known):
        return FirstState(begin=begin)
    first = int(known[0])
    times_before = times[: first + 1]
    later = float(times_before[-1]) - begin
    # If a landmark is seen in the first row, the first state lies a step before all rows.
    longest = max(gap, float(times[1]) - begin) + TICK
    if later > longest:
        return FirstState(begin=begin, later=later)
    pose = poses[:, first]
    if inputs is None or not np.isfinite(pose).all():
        return FirstState(begin=begin, pose=tuple(pose.tolist()), later=later)
    speed, turn_rate = inputs.chosen(ODOMETRY).values[:, 1 : first + 1]
    moved_pose = moved_back(pose, np.diff(times_before), speed, turn_rate)
    return FirstState(begin=begin, pose=moved_pose, later=later, is_moved=True)


def moved_back(
    pose: Array, intervals: Array, speed: Array, turn_rate: Array
) -> tuple[float, float, float]:
    """Return the pose of a robot K steps before ``pose``: x, y and heading, m and rad.

    The ``intervals`` (K,) of the steps are in s. ``speed`` and ``turn_rate`` (K,) hold over them.
    """
    x, y, heading = pose.tolist()
    steps = list(zip(intervals.tolist(), speed.tolist(), turn_rate.tolist(), strict=True))
    # The steps of the motion that the config assumes, the last one first.
    for T, v, w in reversed(steps):
        heading -= w * T
        direction = heading + w * T / 2.0
        x -= v * T * math.cos(direction)
        y -= v * T * math.sin(direction)
    return x, y, heading


def begin_in_words(guess: Guess, first_state: FirstState | None) -> str:
    """Return words for the time of the first state, such as "t = 3 s", which follow "at"."""
    if first_state is None:
        return "the start"
    begin = first_state.begin
    if "step" in guess.naming.columns:
        return f"step {begin:g}"
    if guess.is_dated:
        if begin == 0.0:
            return "the first row"
        return f"the first row, {begin:+.6g} s"
    return f"t = {time_text(begin)} s"


def pose_in_words(first_state: FirstState | None) -> list[str]:
    """Return x, y and heading of the first state as texts: a word such as X if one is unknown."""
    words = list(POSE)
    pose = () if first_state is None else first_state.pose
    for i, value in enumerate(pose):
        if math.isfinite(value):
            words[i] = f"{round(value, 4):g}"
    return words


def unknown_words(pose: list[str]) -> list[str]:
    """Return the words for unknown numbers of a ``pose``, such as HEADING, in small letters."""
    return [word.lower() for word in pose if word in POSE]
