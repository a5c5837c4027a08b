"""`check` reads and compares: but for the key `exact` nothing is simulated to validate an experiment."""

from pathlib import Path
from typing import Any

import pytest

from tests.conftest import EXPERIMENT_FILES
from trackbench import api
from trackbench.config.experiment import cautions
from trackbench.execution.memory import check_memory
from trackbench.execution.plan import make_plan
from trackbench.registry import kinds


def _refused(*_: Any, **__: Any) -> Any:
    raise AssertionError("validation computes")


@pytest.mark.parametrize("path", EXPERIMENT_FILES.values(), ids=lambda p: p.stem)
def test_validation_computes_nothing(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if "\nexact:" in path.read_text(encoding="utf-8"):
        api.prepare(path, api.Options())  # caches whether a few runs show a linear filter
    for cls in kinds("filters").values():
        for name in ("init", "step", "estimate"):
            monkeypatch.setattr(cls, name, _refused)
    for cls in kinds("scenarios").values():
        monkeypatch.setattr(cls, "simulate", _refused)
    experiment = api.prepare(path, api.Options())
    check_memory(experiment)
    make_plan(experiment, save_tracks=False)
    cautions(experiment.points)
