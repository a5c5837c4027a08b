"""per_run.csv read group by group: the same values as its data frame has, in little memory."""

from pathlib import Path

import numpy as np
import pytest

from tests.commands import ran
from tests.execution.test_memory import peak
from tests.papers import merwe_text
from trackbench.report.tables_and_figures import Results

CONFIG = """
name: pieces
runs: 9
scenario: MERWE
filters: {PF: {kind: pf, N: 5}, "10": {kind: ukf}, None: {kind: prior-mean}}
reference: "10"
""".replace("MERWE", merwe_text(T=8, lost_beyond=1.5))


@pytest.mark.parametrize(
    "grid",
    [
        (),
        ("scenario.sensor.R=1,0.5",),
        ("filters.PF.resampling=systematic,residual", "filters.PF.N=4,6"),
        ("scenario.score.lost_beyond=null,1.5",),
    ],
    ids=["plain", "numbers", "words", "nothing"],
)
def test_runs_in_groups_are_those_of_the_frame(tmp_path: Path, grid: tuple[str, ...]) -> None:
    results = Results(ran(tmp_path, CONFIG, grid=grid).folder)
    points = results.points()
    assert points
    for point in points:
        frame = results.per_run
        for path, value in point.items():
            frame = frame[frame[path] == value]
        groups = list(frame.groupby(["filter", "metric"], sort=False))
        found = results.runs(point)
        assert list(found) == [key for key, _ in groups]
        for key, rows in groups:
            assert len(found[key]) == 9
            np.testing.assert_array_equal(found[key], rows["value"].to_numpy())


def test_many_runs_are_read_in_little_memory(tmp_path: Path) -> None:
    folder, number = ran(tmp_path, CONFIG).folder, 80_000
    labels = Results(folder).filters
    with (folder / "per_run.csv").open("w") as file:
        file.write("filter,run,metric,value\n")
        for label in labels:
            file.writelines(f"{label},{run},rmse,0.{run}\n" for run in range(number))
    results = Results(folder)
    assert results.points() == [{}]
    taken = peak(results.runs, {})
    # The data frame of the whole file, read by the same version of pandas.
    of_the_frame = peak(lambda: Results(folder).per_run)
    assert {key: len(x) for key, x in results.runs({}).items()} == {
        (label, "rmse"): number for label in labels
    }
    assert taken < 0.5 * of_the_frame
