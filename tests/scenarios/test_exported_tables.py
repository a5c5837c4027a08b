"""`new experiment --from` reads the exports of loggers and programs right, or its advice can be pasted.

The right values are those of the paths from which the tables are made.
"""

import re
import shlex
from pathlib import Path

import numpy as np
import pytest

from tests.scenarios.test_device_tables import (
    KNOT,
    Path2,
    check_path,
    decimal,
    guessed,
    lonlat,
    table,
    whole,
    xy,
)
from trackbench.config.load import load
from trackbench.errors import UserError
from trackbench.new_experiment_from_tables import write_config_for

pytestmark = pytest.mark.usefixtures("no_report")

CAR = Path2()
HOURLY = Path2(rows=60, usual_speed=0.05, every=3600.0)
CELLS = Path2(rows=40, usual_speed=0.2, every=30.0)
SLOW_CELLS = Path2(rows=40, usual_speed=0.2, every=600.0)
SOUTH_WEST = Path2(usual_speed=8.0, latitude=-33.4, longitude=-70.6)
LON, LAT = lonlat(CAR)
SPEED, COURSE = decimal(CAR.speed, 2), decimal(CAR.course, 1)
WAY = decimal(np.concatenate([[0.0], np.cumsum(CAR.speed[1:])]), 2)
"""way from the first row, m"""


def same(cell: object, rows: int = CAR.rows) -> list[object]:
    return [cell] * rows


def in_plane(name: str, form: str) -> str:
    return table(f"{name};x;y", CAR.dates(form), *xy(CAR), separator=";")


def south_west() -> str:
    longitude, latitude = (decimal(-degrees, 7) for degrees in SOUTH_WEST.degrees)
    motion = decimal(SOUTH_WEST.speed / KNOT, 2), decimal(SOUTH_WEST.course, 1)
    names = "time,latitude,N/S,longitude,E/W,speed_kts,course"
    return table(names, whole(SOUTH_WEST.t), latitude, same("S"), longitude, same("W"), *motion)


def missing(cell: str) -> str:
    """Return a table with four further rows, before those of the path, that have no position."""
    x, y = xy(CAR)
    return table("time,x,y", whole(np.arange(64.0)), [cell] * 4 + x, [cell] * 4 + y)


RIGHT: dict[str, tuple[Path2, str]] = {
    "aircraft of dump1090": (
        CAR,
        table(
            "message_type,hex_ident,date_generated,time_generated,date_logged,time_logged,callsign,"
            "lat,lon",
            *(same("MSG"), same("4CA7B3"), CAR.dates("%Y/%m/%d"), CAR.dates("%H:%M:%S.000")),
            *(CAR.dates("%Y/%m/%d"), CAR.dates("%H:%M:%S.100"), same(""), LAT, LON),
        ),
    ),
    "a logger with way, speed and bearing": (
        CAR,
        table("time,lat,lon,bearing,speed,distance", whole(CAR.t), LAT, LON, COURSE, SPEED, WAY),
    ),
    "hemispheres beside speed and course": (SOUTH_WEST, south_west()),
    "u-blox with parts of dates": (
        CAR,
        table(
            "iTOW[ms],year,month,day,hour,min,sec,lon,lat",
            *(whole(381600000.0 + 1e3 * CAR.t), same(2024), same(5), same(3), same(10)),
            *(whole(CAR.t // 60.0), whole(CAR.t % 60.0), LON, LAT),
        ),
    ),
    "a column of units": (
        CELLS,
        table(
            "Position X,Position Y,Unit,Time [s]",
            *(decimal(1e6 * part, 3) for part in CELLS.place),
            *(same("um", 40), whole(CELLS.t)),
        ),
    ),
    "an index of pandas": (CAR, table(",x,y", CAR.dates("%Y-%m-%d %H:%M:%S"), *xy(CAR))),
    "differences of pandas": (
        CAR,
        table("time,x,y", [f"1 days 00:00:{t:09.6f}" for t in CAR.t.tolist()], *xy(CAR)),
    ),
    "hours of a storm": (
        HOURLY,
        table("time,lat,lon", HOURLY.dates("%Y%m%d%H"), *lonlat(HOURLY)[::-1]),
    ),
    "a clock of 12 hours without a space": (CAR, in_plane("Timestamp", "%d-%b-%Y %I:%M:%S%p")),
    "a stamp with a decimal comma": (CAR, in_plane("time", "%Y%m%d%H%M%S,250").replace(".", ",")),
    "a time of day with a decimal comma": (CAR, in_plane("utc", "%H%M%S,50").replace(".", ",")),
    "colons in a date": (CAR, in_plane("time", "%Y:%m:%d %H:%M:%S")),
    "whole names of months": (CAR, in_plane("time", "%d %B %Y %H:%M:%S")),
    "groups of columns of a ROS message": (
        CAR,
        table(
            "header,stamp,secs,nsecs,pose,x,y",
            *(same(""), same(""), whole(1714730400.0 + CAR.t), same(0), same("")),
            *xy(CAR),
        ),
    ),
    "noisy positions beside true ones": (
        CAR,
        table("t,true_x,true_y,noisy_x,noisy_y", whole(CAR.t), same(1.0), same(2.0), *xy(CAR)),
    ),
    "centers of boxes": (
        CAR,
        table("t,center_x,center_y,length,width", whole(CAR.t), *xy(CAR), same(4.5), same(1.8)),
    ),
    "days": (CAR, table("days,x,y", decimal(CAR.t / 86400.0, 8), *xy(CAR))),
    "days of the year, with seconds after a comma, at whole minutes": (
        SLOW_CELLS,
        table(
            "time;x;y",
            SLOW_CELLS.dates("%Y%j%H%M%S,50"),
            *xy(SLOW_CELLS),
            separator=";",
        ).replace(".", ","),
    ),
    "decimal days of the year": (
        CAR,
        table("doy,x,y", decimal(124.0 + CAR.t / 86400.0, 8), *xy(CAR)),
    ),
    "seconds beside equal minutes": (
        CAR,
        table("hour,minutes,seconds,x,y", same(10), same(5), whole(CAR.t), *xy(CAR)),
    ),
    "words that name no target": (
        CAR,
        table("time,lat,lon,modes", whole(CAR.t), LAT, LON, ["A"] * 30 + ["B"] * 30),
    ),
    "minutes": (CAR, table("minutes,x,y", decimal(CAR.t / 60.0, 6), *xy(CAR))),
}
for word in ("#NUM!", ".", "missing", "-999.25", "9999.9"):
    RIGHT[f"{word} for a missing number"] = (CAR, missing(word))


@pytest.mark.parametrize("what", RIGHT)
def test_an_export_is_read_right(tmp_path: Path, what: str) -> None:
    path, text = RIGHT[what]
    scenario, _ = guessed(tmp_path, text)
    check_path(scenario, path)


ASKED: dict[str, tuple[Path2 | None, str, str]] = {
    "a zone by its name": (
        CAR,
        table("time,x,y", CAR.dates("%Y-%m-%d %H:%M:%S CEST"), *xy(CAR)),
        r"m\.csv:2:1: .* as it ends with CEST: if all times are in this zone, say",
    ),
    "an index of numbers": (
        CAR,
        table(",kind,x,y", whole(CAR.t), same("a"), *xy(CAR)),
        r"no column looks like a time or a step; there are column 1, kind, x, y",
    ),
    "rising numbers in a column of any name": (
        CAR,
        table("kind,moment,x,y", same(7), whole(CAR.t), *xy(CAR)),
        r"say which is one, `--set 'columns\.time=moment'`",
    ),
    "tenths of a second with three rows": (
        None,
        table("time,x,y", [f"{0.1 * (k // 3):.1f}" for k in range(CAR.rows)], *xy(CAR)),
        r"is there twice, .* say --set same_time=mean",
    ),
    "columns of a player": (
        CAR,
        table("Period,t,P1_x,P1_y", same(1), whole(CAR.t), *xy(CAR)),
        r"say which are, `--set 'columns\.x=P1_x' --set 'columns\.y=P1_y'`",
    ),
    "truth beside positions of another name": (
        CAR,
        table("t,true_a,true_b,a,b", whole(CAR.t), same(1.0), same(2.0), *xy(CAR)),
        r"say which are, `--set 'columns\.x=a' --set 'columns\.y=b'`",
    ),
    "names of targets without cells": (
        CAR,
        table("time,callsign,x,y", whole(CAR.t), [""] * 30 + ["A"] * 30, *xy(CAR)),
        r"callsign: is missing .*: write it in each row, or say --set 'columns\.run=\"\"'",
    ),
}


@pytest.mark.parametrize("what", ASKED)
def test_the_options_of_a_question_can_be_pasted(tmp_path: Path, what: str) -> None:
    path, text, message = ASKED[what]
    with pytest.raises(UserError, match=message) as error:
        guessed(tmp_path, text)
    pasted = re.findall(r"--set '[^']+'|--set [^\s,;`]+", str(error.value))
    assert pasted
    options = [words for option in pasted for words in shlex.split(option) if words != "--set"]
    scenario, _ = guessed(tmp_path, text, *options)
    if path is not None:
        check_path(scenario, path)


def test_years_with_months_are_no_times_of_day(tmp_path: Path) -> None:
    months = [f"{2000 + k // 12}{k % 12 + 1:02}" for k in range(CAR.rows)]
    with pytest.raises(
        UserError, match=r"m\.csv:2:1: is 200001 the month 2000-01\? Then write dates"
    ):
        guessed(tmp_path, table("time,lat,lon", months, LAT, LON))


@pytest.mark.parametrize(
    "names", ["gt_x,gt_y", "x_true,y_true", "ground_truth_x_m,ground_truth_y_m"]
)
def test_a_file_of_the_truth_may_name_its_columns_so(tmp_path: Path, names: str) -> None:
    measurements = tmp_path / "m.csv"
    measurements.write_text(table("time,x,y", whole(CAR.t), *xy(CAR)))
    truth = tmp_path / "truth.csv"
    truth.write_text(table(f"time,{names}", whole(CAR.t), *xy(CAR)))
    config = write_config_for(measurements, "g", tmp_path, truth=truth).paths[0]
    target = load(config).points[0].scenario.target
    np.testing.assert_allclose(target.recorded_truth[[0, 2], 5, 0], CAR.place[:, 5], atol=0.01)
