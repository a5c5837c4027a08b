"""A reference that fails leaves the other filters their results, without a distance to it."""

from pathlib import Path

import numpy as np
import pytest

from tests.bad_input.test_odd_words import FAILS
from trackbench import api

pytestmark = pytest.mark.usefixtures("no_report")

TEXT = """
name: ref
seed: 8
runs: 10
reference: Exact
scenario:
  kind: tracking
  T: 1
  last: 10
  target:
    kind: driven
    motion: {kind: map, components: [a, b], next: {a: a + b, b: b}, Q: {a: 0.01, b: 0.0001}}
    initial: {a: 0}
  sensor: {kind: function, h: {z: a}, R: 1e-6}
  start: {kind: gaussian, sigma: {a: 10, b: 10}}
filters:
  Exact: {kind: always-fails}
  KF: {kind: kf}
metrics: [rmse_a, rmsd_a]
plugins: [fails.py]
"""


def test_the_filters_keep_their_results(tmp_path: Path) -> None:
    (tmp_path / "fails.py").write_text(FAILS)
    (tmp_path / "ref.yaml").write_text(TEXT)
    (tmp_path / "alone.yaml").write_text(
        TEXT.replace("reference: Exact\n", "")
        .replace("  Exact: {kind: grid-2d, nodes: 32}\n", "")
        .replace(", rmsd_a", "")
    )
    options = api.Options(engine="serial", quiet=True, out=tmp_path / "out", allow_plugins=True)
    report = api.run(tmp_path / "ref.yaml", options, formats=())
    with_reference = report.results.runs({})
    alone = api.run(tmp_path / "alone.yaml", options, formats=()).results.runs({})
    assert [line.split(":")[0] for line in report.failed] == [
        "Exact failed",
        "KF has no distance",
    ]
    assert report.failed[1].endswith("the reference Exact failed")
    np.testing.assert_array_equal(with_reference["KF", "rmse_a"], alone["KF", "rmse_a"])
    assert np.isnan(with_reference["KF", "rmsd_a"]).all()
