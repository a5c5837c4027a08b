"""Names of a filter's diagnostics: declared, or found by one step of the filter before the runs."""

from dataclasses import replace
from typing import Any, TypeAlias, cast

import numpy as np

from trackbench.component_parts import field_values
from trackbench.config.experiment_keys import Settings
from trackbench.core.random_streams import block_stream
from trackbench.evaluation.run_filter import prior_of
from trackbench.evaluation.simulated_runs import simulate
from trackbench.filters.base import AnyFilter, declares_diagnostics
from trackbench.plugins.guarded_code import guarded
from trackbench.scenarios.base import Scenario

Built: TypeAlias = AnyFilter | None
"""A filter, or None for one that mistakes in its keys keep from being built."""
_PROBE_PARTICLES = 10
"""Particles that suffice to learn a filter's diagnostics."""


def numeric_keys(tracker: AnyFilter) -> set[str]:
    """Name the keys of a filter that are numbers."""
    return {key for key, value in field_values(tracker).items() if type(value) in (int, float)}


def diagnostic_names(settings: Settings, scenario: Scenario, tracker: Built) -> set[str]:
    """Name a filter's diagnostics: those it declares, or else those after the first step of one run.

    ``scenario`` is the one that the filter assumes. A filter that fails raises its error, and a filter
    with mistakes (None) a ValueError: the caller counts both as filters with unknown diagnostics.
    """
    if tracker is None:
        raise ValueError("mistaken")
    if declares_diagnostics(type(tracker)):
        return set(tracker.diagnostic_names)
    # Undeclared: simulate one run, and make its first step.
    data = simulate(scenario, settings.seed, 0, 1)
    model = scenario.model
    rng = block_stream(settings.seed, 0)
    if "N" in numeric_keys(tracker):  # the memory that all particles need is still unknown
        particles = min(tracker.particle_count, _PROBE_PARTICLES)
        tracker = replace(cast(Any, tracker), N=particles)
    with guarded(), np.errstate(all="ignore"):
        prior_state = tracker.init(model, prior_of(data, model), rng)
        first_step = int(scenario.steps[1])  # of the first measurement; steps[0] is the prior's
        state = tracker.step(model, prior_state, data.measurements[:, 0], first_step, rng)
        return set(tracker.diagnostics(state))
