"""Fixtures of the small experiment, and runs that are computed again once for all tests of a file."""

import json
import shutil
from importlib import import_module

import pytest

from tests.small_experiment import folder, hostile, made
from trackbench.report.tables_and_figures import Results

__all__ = ["folder", "hostile", "made"]


@pytest.fixture(autouse=True, scope="module")
def _recomputed_once(tmp_path_factory):
    """Recompute equal experiments once: tests change the stored numbers, which it does not read."""
    verify = import_module("trackbench.verify.verify_folder")
    recompute, computed = verify.recompute, {}

    def copied(experiment, folder, runs, tracks):
        config = json.dumps(experiment.source.data, default=str)
        key = (config, len(experiment.figures), runs, tracks)
        if key not in computed:
            computed[key] = recompute(experiment, tmp_path_factory.mktemp("again"), runs, tracks)
        again = computed[key]
        shutil.copytree(again.folder, folder, dirs_exist_ok=True)
        return Results(folder, again.run_facts)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(verify, "recompute", copied)
        yield
