"""`trackbench new filter --from KIND` copies a step that works for every shipped filter."""

from pathlib import Path

import numpy as np
import pytest

from tests.commands import trackbench
from tests.conftest import track
from trackbench.config.load import load
from trackbench.registry import kinds
from trackbench.scaffold import write_new

OURS = sorted(
    kind
    for kind, cls in kinds("filters").items()
    if cls.__module__.startswith("trackbench.") and not cls.runs_program
)


@pytest.mark.parametrize("kind", OURS)
def test_a_copy_gives_the_same_numbers(kind: str, tmp_path: Path) -> None:
    name = f"copied-{kind}"
    _, config, _ = write_new("filter", name, tmp_path, "copy", kind)
    last = 3 if kind == "grid-2d" else 20
    (point,) = load(config, [f"scenario.last={last}"], allow_plugins=True).points
    copy, shipped = point.filters[name], point.filters[kind]
    assert isinstance(copy, type(shipped))
    assert "step" in vars(type(copy).__mro__[0])
    a, b = (track(point.scenario, one, 2, covariances=2) for one in (copy, shipped))
    np.testing.assert_array_equal(a.mean, b.mean)
    np.testing.assert_array_equal(a.cov, b.cov)
    assert a.diagnostics.keys() == b.diagnostics.keys()
    assert np.isfinite(a.mean).all()


def test_a_change_of_the_copy_shows(tmp_path: Path) -> None:
    path, config, _ = write_new("filter", "changed", tmp_path, "copy", "kf")
    text = path.read_text().replace("self.prepared(state.posterior)", "state.posterior")
    step = "posterior, innovation, weight = self.predict_and_update(model, before, z, k)"
    assert step in text
    path.write_text(text.replace(step, step.replace("z, k", "0.9 * z, k")))
    (point,) = load(config, allow_plugins=True).points
    a, b = (track(point.scenario, one, 2) for one in point.filters.values())
    assert not np.array_equal(a.mean, b.mean)


def test_what_is_no_filter_is_one_line(tmp_path: Path) -> None:
    done = trackbench("new", "filter", "mine", "--from", "hdef", cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr == "--from: 'hdef' is not a kind of filter; did you mean hdepf?\n"
    both = trackbench("new", "filter", "mine", "--from", "kf", "--per-run", cwd=tmp_path)
    assert both.returncode == 2
    assert not list(tmp_path.iterdir())
