"""Names of components and errors that would be taken for the error of a prediction."""

from pathlib import Path

import pytest

from trackbench.config.load import load
from trackbench.errors import UserError

CONFIG = """
name: names
seed: 1
runs: 2
scenario:
  kind: tracking
  last: 4
  target:
    kind: driven
    motion:
      kind: map
      components: [x, {name}]
      next: {{x: 0.9*x, {name}: x}}
      Q: 0.1
  sensor: {{kind: function, h: {{x: x}}, R: 0.1}}
  start: {{kind: gaussian, sigma: [1, 1]}}
filters:
  EKF: {{kind: ekf}}
"""


@pytest.mark.parametrize("name", ["predicted_x", "held_x"])
def test_a_component_named_as_a_prediction_is_refused_with_its_line(
    tmp_path: Path, name: str
) -> None:
    path = tmp_path / "c.yaml"
    path.write_text(CONFIG.format(name=name))
    with pytest.raises(UserError) as caught:
        load(path)
    (problem,) = caught.value.problems
    place = f"{path}:12:23: scenario.target.motion.components.1: "
    assert str(problem).startswith(f"{place}a component cannot be named {name!r}, as rmse_")


def test_an_error_named_as_a_prediction_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "c.yaml"
    path.write_text(CONFIG.format(name="y"))
    load(path)
    with pytest.raises(
        UserError, match=r"score\.errors\.held_y: 'held_y' cannot be the name of an"
    ):
        load(path, overrides=["scenario.score={errors: {held_y: [y]}}"])
