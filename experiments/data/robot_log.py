"""Simulate robot-log.csv and robot-truth.csv: two minutes of a robot among five landmarks.

Every 0.1 s the wheels measure speed and turn rate, and every 0.5 s the robot sees its nearest landmark.
The folder robot-topics has the same log as ROS exports it, a table for each topic.
"""

import csv
from pathlib import Path

import numpy as np

FOLDER = Path(__file__).parent
LANDMARKS = {
    "door": (-4.5, 4.0),
    "shelf": (1.0, -4.0),
    "lamp": (8.0, -2.0),
    "desk": (3.5, -9.5),
    "plant": (-8.5, -6.0),
}
"""Names and places, m."""
T = 0.1
STEPS = 1200
START_OF_CLOCK = 1_718_023_412_000_000_000  # ns
SIGMA_V = 0.1  # m/s
SIGMA_W = 0.05  # rad/s
SIGMA_RANGE = 0.1  # m
SIGMA_BEARING = np.deg2rad(2.0)


def main() -> None:
    """Write all files, with the same numbers every time."""
    rng = np.random.default_rng(7)
    x, y, heading = 0.0, 0.0, 0.2
    log = []
    truth = [(0.0, x, y, heading)]
    for k in range(1, STEPS + 1):
        # Two rounds of a minute.
        angle = 2.0 * np.pi * k / 600
        v = 0.6 + 0.1 * np.sin(3.0 * angle)
        w = 0.4 * np.cos(angle) + 0.05
        x += v * T * np.cos(heading + 0.5 * w * T)
        y += v * T * np.sin(heading + 0.5 * w * T)
        heading += w * T
        truth.append((k * T, x, y, heading))
        seen = ("", "", "")
        if k % 5 == 0:
            ways = {name: (at[0] - x, at[1] - y) for name, at in LANDMARKS.items()}
            name, (dx, dy) = min(ways.items(), key=lambda way: np.hypot(*way[1]))
            distance = np.hypot(dx, dy) + SIGMA_RANGE * rng.standard_normal()
            bearing = np.arctan2(dy, dx) - heading + SIGMA_BEARING * rng.standard_normal()
            degrees = (np.rad2deg(bearing) + 180.0) % 360.0 - 180.0
            seen = (name, f"{distance:.2f}", f"{degrees:.1f}")
        v_measured = v + SIGMA_V * rng.standard_normal()
        w_measured = w + SIGMA_W * rng.standard_normal()
        log.append((f"{k * T:.1f}", f"{v_measured:.3f}", f"{np.rad2deg(w_measured):.2f}", *seen))
    with (FOLDER / "robot-log.csv").open("w", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(
            ["time [s]", "v [m/s]", "omega [deg/s]", "landmark", "range [m]", "bearing [deg]"]
        )
        table.writerows(log)
    with (FOLDER / "robot-truth.csv").open("w", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["time", "px", "py", "heading"])
        for row in truth:
            table.writerow((f"{row[0]:.1f}", *(f"{value:.4f}" for value in row[1:])))
    write_topics(log, truth)


def write_topics(log: list[tuple[str, ...]], truth: list[tuple[float, ...]]) -> None:
    """Write the tables of the topics: odometry, detections, places of landmarks, and the truth."""
    clock = "field.header.stamp"
    odometry = [(clock, "field.twist.twist.linear.x", "field.twist.twist.angular.z")]
    detections = [(clock, "field.id", "field.range_mm", "field.bearing_deg")]
    for time, v, degrees_per_second, name, distance, bearing in log:
        odometry.append((_stamp(time), v, f"{np.deg2rad(float(degrees_per_second)):.5f}"))
        if name:
            detections.append((_stamp(time), name, f"{1000 * float(distance):.0f}", bearing))
    poses = [(clock, "field.pose.x", "field.pose.y", "field.pose.yaw_deg")]
    for time, x, y, heading in truth:
        yaw = (np.rad2deg(heading) + 180.0) % 360.0 - 180.0
        poses.append((_stamp(f"{time:.1f}"), f"{x:.4f}", f"{y:.4f}", f"{yaw:.3f}"))
    places = [("name", "x_m", "y_m")]
    for name, (x, y) in LANDMARKS.items():
        places.append((name, f"{x:g}", f"{y:g}"))
    tables = {"odom": odometry, "detections": detections, "mocap": poses, "landmarks": places}
    for name, rows in tables.items():
        with (FOLDER / "robot-topics" / f"{name}.csv").open("w", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows(rows)


def _stamp(time: str) -> str:
    """Return a time of the log, s, as nanoseconds since 1970."""
    return str(START_OF_CLOCK + round(float(time) * 1e9))


if __name__ == "__main__":
    main()
