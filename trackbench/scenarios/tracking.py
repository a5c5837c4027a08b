"""Scenario `tracking`: any target, seen by any sensors, from any start."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Annotated

import numpy as np

from trackbench.core.angles import near
from trackbench.core.arrays import Array, Index, Mask
from trackbench.core.distributions import Distribution
from trackbench.core.random_streams import Streams
from trackbench.errors import counted
from trackbench.field_types import Finite, InvalidKeyError, Natural, Positive, Registered, Unit
from trackbench.models.angle_components import with_angle_names
from trackbench.models.assume import Assume, assumed_sensor
from trackbench.models.base import Model, SampledMotion, extra_std
from trackbench.models.component_names import position_velocity_names
from trackbench.models.delays import Late, shortest_delay
from trackbench.models.model_for_programs import ModelDescription, with_description
from trackbench.models.motions.nonlinear import AngledMotion
from trackbench.models.sensors.base import SensorBase
from trackbench.models.sensors.stacked import Sensors, sensors_of, stack_for, with_angles_of_state
from trackbench.registry import register
from trackbench.scenarios.assumed_start import assumed_start, way_to_larger_state
from trackbench.scenarios.base import Scenario, Simulation
from trackbench.scenarios.cramer_rao_bound import (
    Bound,
    Course,
    bound_along_path,
    bound_over_paths,
    motion_of_bound,
    why_no_bound,
)
from trackbench.scenarios.delays import arrivals, longest_delay_of
from trackbench.scenarios.diverged_runs import diverged
from trackbench.scenarios.faults import AnyFault, FaultContext
from trackbench.scenarios.late_measurements import (
    notes_on_unused_sensors,
    treatment_of_late_measurements,
)
from trackbench.scenarios.position_from_one_scan import position_sigma
from trackbench.scenarios.recordings.input_check import input_notes
from trackbench.scenarios.recordings.recording_keys import RecordingKeys
from trackbench.scenarios.recordings.undeclared_angles_check import (
    notes_on_angles,
    notes_on_multiples,
)
from trackbench.scenarios.recovery_time import recovery
from trackbench.scenarios.score import Score
from trackbench.scenarios.scored_truth import (
    describe_unscored_truth,
    note_on_runs,
    runs_with_truth,
    steps_with_truth,
)
from trackbench.scenarios.start_far_from_truth import note_on_far_start
from trackbench.scenarios.starts.base import FixedStart, InitialScans, Start, repeated
from trackbench.scenarios.starts.given import GivenStart
from trackbench.scenarios.targets.base import Target
from trackbench.scenarios.targets.peak_errors import Scored
from trackbench.scenarios.targets.timeline import Schedule, Timeline

_NOTHING = Assume()
_EVERYTHING = Score()


@register("scenarios", "tracking")
@dataclass(frozen=True, kw_only=True)
class Tracking(Scenario):
    """A target, its sensors, an initialization and a score, in any combination.

    The key ``assume``, of the scenario and of each filter, is the model that filters assume.
    """

    target: Annotated[Target, Registered("targets")]
    """where the truth comes from: {kind: legs, ...}"""
    sensor: Annotated[SensorBase | tuple[SensorBase, ...], Registered("sensors")]
    """what sees it: {kind: range-azimuth, ...}, or a list of sensors"""
    start: Annotated[Start, Registered("starts")]
    """what filters start from: {kind: two-scan}"""
    T: Annotated[Positive, Unit("s")] = 1.0
    """time between steps, s"""
    first: Natural = 0
    """number of the first step"""
    last: Natural | None = None
    """number of the last step; needed unless the target's own data say it, which may go on after it"""
    begin: Finite | None = None
    """time of the first step, s; default: 0, or what recorded data say"""
    assume: Assume = _NOTHING
    """motion, sensor and start that filters assume; default: the ones that make the data"""
    score: Score = _EVERYTHING
    """what errors are measured, and over which steps"""
    faults: tuple[AnyFault, ...] = ()
    """stretches of time in which sensors measure worse than filters assume"""

    def __post_init__(self) -> None:
        # The sensors or the assumed motion may name angles that a recorded target does not name.
        object.__setattr__(self, "target", self.target.with_angles(self.angles))
        # The timeline needs a valid start, and the scoring needs the timeline. The recorded timeline is
        # None for a simulated target.
        self._start.check(self.components, self.true_sensor)
        self._schedule.check(self._recorded_timeline)
        self.target.check(self._timeline)
        # A target whose config does not say where it begins begins at zeros.
        if self._start_that_draws_truth is not None and self.target.start(self._timeline).any():
            message = f"the start `{self.start.kind}` draws the first state"
            raise InvalidKeyError(f"{message}; leave out where the target begins", "target")
        self.score.check(self.components, self.steps)
        if self._last_training_step is not None:
            self.score.check_training(
                self._last_training_step,
                self.steps,
                self.recorded_runs,
                # `windows` leaves out those without a step.
                is_any_scored=bool(self.windows),
            )
        self._check_sensors_measure()
        self._check_windows()
        if self.score.lost_sigmas is not None and self.position_sigma is None:
            raise InvalidKeyError("no sensor here tells a position", "score", "lost_sigmas")

    def _check_sensors_measure(self) -> None:
        """Raise InvalidKeyError if no filter ever gets a measurement of a sensor.

        The key is ``period`` if the sensor measures at no step of the run, and ``delay`` if all its
        measurements arrive after the end.
        """
        steps = self.steps[1:]  # after the step of the prior
        if not len(steps):  # a recording may have one step alone
            return
        last_step = int(steps[-1])
        # Training is the first part of a recording, and needs measurements, too.
        arrival_end = last_step
        what_ends = "the run"
        if self._last_training_step is not None:
            arrival_end = self._last_training_step
            what_ends = "the training"
        for n, sensor in enumerate(sensors_of(self.true_sensor)):
            # Several sensors are a list in the config.
            place = ("sensor", n) if isinstance(self.sensor, tuple) else ("sensor",)
            measured_steps = steps[sensor.measures_at(steps)]
            if not len(measured_steps):
                message = (
                    f"this sensor never measures: with `offset: {sensor.offset}` no measurement is "
                    f"at a step of the run, {steps[0]} to {last_step}; take a shorter period, "
                    "another offset or a longer run"
                )
                raise InvalidKeyError(message, *place, "period")
            delay = shortest_delay(sensor.delay)
            if measured_steps[0] + delay > arrival_end:
                message = (
                    f"no measurement of this sensor arrives: the first one is of step "
                    f"{measured_steps[0]}, at least {counted(delay, 'step')} late, and {what_ends} "
                    f"ends at step {arrival_end}; take a shorter delay, or let {what_ends} end later"
                )
                raise InvalidKeyError(message, *place, "delay")

    def _check_windows(self) -> None:
        """Check the windows of the score, and the faults, which have windows too.

        Raises InvalidKeyError for one without steps, or of a name that is taken.
        """
        scored = self.score.scored_steps(self.steps, self._last_training_step)
        windows = self.target.windows(self.times, scored)
        windows |= self.score.check_windows(self.steps, scored, windows)
        self._fault_context.check(self.faults, windows, self.has_truth)

    @property
    def _fault_context(self) -> FaultContext:
        """Sensors and steps that the faults refer to."""
        return FaultContext(
            sensor=self.true_sensor,
            steps=self.steps,
            times=self.times,
            starts_with_scans=self._start.scans > 0,
        )

    @property
    def longest_delay(self) -> int:
        """Number of steps that few measurements are later than; 0 if all arrive on time."""
        return max(self.target.longest_delay, longest_delay_of(self.true_sensor))

    @property
    def late(self) -> Late | None:
        """Treatment of late measurements by filters; raises InvalidKeyError if it is not set."""
        if not self.longest_delay:
            return None
        return treatment_of_late_measurements(self.assume)

    @property
    def without_faults(self) -> "Tracking":
        """Scenario with equal truth and noise, and without faults."""
        if not self.faults:
            return self
        # Without faults filters cannot assume to know them: this would be an error.
        assume = replace(self.assume, faults=None)
        return replace(self, faults=(), assume=assume)

    @cached_property
    def _recorded_timeline(self) -> Timeline | None:
        return self.target.own_timeline(self.true_sensor, self._start, self.T)

    @cached_property
    def _timeline(self) -> Timeline:
        """All steps and their times, including steps whose scans the start uses up."""
        if self._recorded_timeline is None:
            return self._schedule.simulated_timeline(self.T)
        return self._schedule.cut_and_shift(self._recorded_timeline)

    @cached_property
    def _start(self) -> Start:
        """Start of the target's state; raises InvalidKeyError."""
        start = self.start.for_state(self.components)
        # Angles in the parts of a mixture may be whole turns apart.
        if isinstance(start, FixedStart):
            return start.on_one_turn(self.angle_rows)
        return start

    @property
    def _start_that_draws_truth(self) -> FixedStart | None:
        """Start, if it draws the first state of the target; else None."""
        start = self._start
        is_driven = self.target.own_motion is not None
        if is_driven and isinstance(start, FixedStart) and start.draws_truth:
            return start
        return None

    @cached_property
    def _assumed_start(self) -> FixedStart | None:
        """Start that filters assume by the key ``assume``; None without it; raises InvalidKeyError."""
        return assumed_start(
            self.assume,
            self.components,
            self.true_sensor,
            self.angle_rows,
            # Only a recorded target has the key `state`.
            has_state_key=hasattr(self.target, "state"),
        )

    def assumed_prior(self, runs: int) -> Distribution | None:
        """Return the prior of M = ``runs`` runs that filters assume in place of the simulated one.

        None if they assume no other prior.
        """
        if self._assumed_start is None:
            return None
        return self._assumed_start.distribution(runs)

    @property
    def _schedule(self) -> Schedule:
        """Keys of the config on steps and times, as they are checked and turned into a timeline.

        ``first`` and ``last`` are numbers of steps, and ``begin`` is the time of the step ``first``, s.
        ``skipped`` is the number of steps from ``first`` on before that of the first state, whose scans
        the start uses up.
        """
        return Schedule(
            first=self.first,
            last=self.last,
            begin=self.begin,
            skipped=self._steps_before_first_state,
        )

    @property
    def _steps_before_first_state(self) -> int:
        """Number of steps before the first state's, which is at the last scan that the start uses up."""
        return max(0, self._start.scans - 1)

    @property
    def components(self) -> tuple[str, ...]:
        """Components of the truth, which every filter estimates."""
        return self.target.components

    @cached_property
    def angles(self) -> tuple[str, ...]:
        """Components that are angles in rad.

        The target or the assumed motion names them, or a sensor measures one alone, as an angle.
        """
        angular = set(self.target.known_angles)
        if self.assume.motion is not None:
            angular.update(self.assume.motion.known_angles)
        for sensor in sensors_of(self._sensor_of_state):
            angular.update(sensor.measured_angles)
        return tuple(name for name in self.components if name in angular)

    @cached_property
    def _sensor_of_state(self) -> Sensors:
        """True sensor, or all joined to one, before it is known which components are angles."""
        return stack_for(self.sensor, self.components, "sensor")

    @cached_property
    def true_sensor(self) -> Sensors:
        """True sensor, or all true sensors joined to one."""
        return with_angles_of_state(self._sensor_of_state, self.angles)

    @cached_property
    def model(self) -> Model:
        """Motion and sensor of the filter model.

        Raises InvalidKeyError if filters have no motion to assume, if the motion lacks an input, or if
        its first components are not the target's. It also does if nothing says where further components
        begin, or if the assumed sensor is impossible.
        """
        motion = self.assume.motion or self.target.own_motion
        if motion is None:
            message = "name the motion that filters assume: the target has none of its own"
            raise InvalidKeyError(message, "assume")
        if isinstance(motion, AngledMotion) and self.angles:
            motion = motion.with_angles(self.angles, self.target.axes)
        try:
            sampled = self._timeline.sampled(motion, self.target.axes)
        except InvalidKeyError as error:
            # An error without a key is about the motion's known inputs.
            path = error.path or ("assume", "motion", "input")
            raise InvalidKeyError(str(error), *path) from None
        sampled = with_angle_names(sampled, self.angles)
        # The motion's first components must be the target's; more may follow.
        if sampled.components[: len(self.components)] != self.components:
            message = (
                f"a motion of {', '.join(sampled.components)} for {', '.join(self.components)}"
            )
            raise InvalidKeyError(message, "assume")
        further = sampled.components[len(self.components) :]
        if len(further) != len(extra_std(sampled)):
            message = f"nothing says where {', '.join(further)} of the motion begin"
            has_state_key = hasattr(self.target, "state")
            way_on = way_to_larger_state(self.assume.motion, self.components, has_state_key)
            raise InvalidKeyError(f"{message}{way_on}", "assume", "motion")
        sensor = assumed_sensor(self.assume, self.true_sensor, self.components)
        sensor = with_angles_of_state(sensor, self.angles)
        description = ModelDescription(
            motion=motion,
            sensor=sensor,
            # The key `assume` may have a start of its own.
            start=self._assumed_start or self._start,
            first_step=int(self.steps[0]),
        )
        model = Model(sampled, sensor)
        if self.assume.faults == "known":
            # Filters know when the scenario's faults happen, and how large they are.
            model = Model(sampled, self._fault_context.known_sensor(self.faults, sensor))
        return with_description(model, description)

    def assumed_measurements(self, z: Array) -> Array:
        """Return measurements z (n_z, T, M), corrected for the faults if the filter knows of them."""
        if self.assume.faults is None:
            return z
        return self._fault_context.corrected(self.faults, z)

    def with_assumptions(self, assume: Assume) -> "Tracking":
        """Return the scenario with a filter's assumptions."""
        return replace(self, assume=assume.over(self.assume))

    @cached_property
    def without_scoring(self) -> "Tracking":
        """Scenario without scored steps, windows and limits."""
        return replace(self, score=Score(marginals=self.score.marginals))

    @property
    def prior_type(self) -> type[Distribution]:
        """Class of the prior."""
        return (self._assumed_start or self._start).prior_type(self.true_sensor)

    @cached_property
    def _last_training_step(self) -> int | None:
        """Number of the last training step; None if all steps are scored."""
        return self.score.last_training_step(self.steps, self.times)

    @property
    def training(self) -> "Tracking | None":
        """Scenario of the recorded steps before the scored ones, for tuning; None without training."""
        if self._last_training_step is None:
            return None
        score = self.score.cut_to_training(self._last_training_step)
        # Keep the faults that change a measurement of the training.
        is_training = self.steps[1:] <= self._last_training_step
        faults = []
        for fault in self.faults:
            if (self._fault_context.faulty_steps(fault) & is_training).any():
                faults.append(fault)
        return replace(self, last=self._last_training_step, score=score, faults=tuple(faults))

    @property
    def steps(self) -> Index:
        """Steps from the first state's to the last."""
        return self._timeline.steps[self._steps_before_first_state :]

    @property
    def times(self) -> Array:
        """Times of the steps, s."""
        return self._timeline.times[self._steps_before_first_state :]

    @property
    def windows(self) -> dict[str, Mask]:
        """Masks (K,) of steps by name: all scored ones, and stretches of target, score and faults."""
        scored = self.score.scored_steps(self.steps, self._last_training_step)
        windows = {"": scored}
        windows |= self.target.windows(self.times, scored)
        windows |= self.score.windows_by_name(self.steps, scored)
        windows |= self._fault_context.windows(self.faults, scored)
        return {name: mask for name, mask in windows.items() if mask.any()}

    @property
    def spans(self) -> list[tuple[float, float]]:
        """Start and end times of the target's turns, s."""
        return self.target.spans

    @property
    def turns(self) -> tuple[float, ...]:
        """Sizes of the accelerations of the target's turns, m/s^2."""
        return self.target.turns

    @cached_property
    def position_sigma(self) -> float | None:
        """Largest standard deviation of the position by one scan at the first state, m.

        In space it is an upper bound of that deviation. None if a scan does not determine the position.
        """
        if not self.target.has_position_and_velocity:
            return None
        state = self.target.start(self._timeline)
        if self._start_that_draws_truth is not None:
            state = self._start_that_draws_truth.distribution(1).mean[:, 0]
        # The key `first` is the number of the first step, at which this state is.
        return position_sigma(self.true_sensor, state, k=self.first)

    @property
    def lost_beyond(self) -> float | None:
        """Error beyond which a run counts as lost, in the unit of the first error; None: never.

        The score's key ``lost_beyond`` has it in this unit, and ``lost_sigmas`` in standard deviations
        of a position by one scan.
        """
        if self.score.lost_sigmas is None or self.position_sigma is None:
            return self.score.lost_beyond
        return self.score.lost_sigmas * self.position_sigma

    @property
    def marginals(self) -> dict[str, tuple[int, ...]]:
        """Rows of each part of the state, by its name, that has a consistency measure of its own."""
        n = len(self.components)
        rows = {"position": tuple(range(0, n, 2)), "velocity": tuple(range(1, n, 2))}
        return {name: rows[name] for name in self.score.marginals}

    def simulate(self, rng: Streams, runs: int) -> Simulation:
        """Simulate the truth, the measurements that filters are given, and their prior.

        Of a recorded target the runs with the numbers of ``rng`` are returned, and nothing is drawn.
        """
        scans = self._start.scans  # number of scans that the start uses up
        # Step 1: the true first state, drawn by some starts for a driven target.
        configured = repeated(self.target.start(self._timeline), runs)
        is_driven = self.target.own_motion is not None
        start = configured
        if is_driven:
            start = self._start.truth(configured, rng)
        # Step 2: the truth and its measurements; the start uses up the first scans.
        flight = self.target.fly(start, self._timeline, self.true_sensor, rng, scans)
        first_scans, measurements = np.split(flight.measurements, [scans], axis=1)
        # Step 3: the prior from these scans, or from knowledge of the first state. The truth of a
        # driven target may be drawn about the configured state, which then is the prior's mean.
        opening = InitialScans(
            truth=flight.truth[:, 0],
            scans=first_scans,
            first_step=int(self._timeline.steps[0]),
            # s; recorded runs, whose numbers ``rng`` has, may differ in it
            T=self._timeline.between_scans(rng),
            diffusion=self.target.diffusion,  # m^2/s^3
        )
        nominal = configured if is_driven else None
        prior = self._start.prior(opening, self.true_sensor, nominal, rng)
        # Step 4: faults change the measurements after the start's. The first state is that of the last
        # scan: the truth has a state for it, and the measurements begin one step later.
        truth = flight.truth[:, self._steps_before_first_state :]
        if self.faults:
            measurements = self._fault_context.with_faults(
                self.faults, truth, measurements, first_scans, rng
            )
        # Step 5: the steps at which measurements arrive.
        arrival = arrivals(self.true_sensor, flight.arrival, measurements, rng)
        return Simulation(truth=truth, measurements=measurements, prior=prior, arrival=arrival)

    @property
    def named_errors(self) -> tuple[str, ...]:
        """Quantities of the errors under the key ``errors`` of ``score``."""
        return tuple(self.score.errors)

    def errors(self, mean: Array, truth: Array) -> dict[str, Array]:
        """Return error vectors by quantity: of the state, and in the coordinates of each sensor."""
        truth = near(truth, mean, self.angle_rows)
        return self.score.error_vectors(self.true_sensor, self.components, mean, truth)

    def observables(self, x: Array) -> dict[str, Array]:
        """Return functions of the state whose posterior means are scored beside the mean state's own."""
        return self.true_sensor.observables(x)

    @property
    def why_no_bound(self) -> str | None:
        """Reason why a lower bound is invalid; None if it is valid."""
        why = why_no_bound(
            self._bound_motion,
            self.true_sensor,
            self._start,
            len(self.components),
            is_recorded=self._recorded_timeline is not None,
            has_faults=bool(self.faults),
        )
        return why or self.target.why_no_bound

    @cached_property
    def _bound(self) -> Bound:
        """Posterior Cramer-Rao bound: over drawn paths of a driven target, or along the only path."""
        sensor = self.true_sensor
        path = self.target.path(self._timeline)
        # The bound begins with the first state, after the steps whose scans the start uses up.
        course = Course(
            steps=self._timeline.steps.tolist()[self._steps_before_first_state :],
            motion=self._bound_motion,
            sensor=sensor,
            initial=self._start.bound(
                path, k=self.first, sensor=sensor, T=self.T, diffusion=self.target.diffusion
            ),
            squares=partial(self.score.squares, sensor, self.components),
        )
        bound = None
        # A driven target has a motion of its own, which draws another path in each run.
        if self.target.own_motion is not None:
            bound = bound_over_paths(course, self._draw_first_states)
        # None: measurements carry equal information along all paths, so one of them is enough.
        if bound is None:
            bound = bound_along_path(course, path[:, self._steps_before_first_state :])
        return bound

    def _draw_first_states(self, number: int, rng: Streams) -> Array:
        """Draw N = ``number`` true states (n_x, N) of the first state's step, where the bound begins."""
        # Draw those of the very first step, and move them over the steps that the start uses up.
        x = self._start.truth(repeated(self.target.start(self._timeline), number), rng)
        # `bound_over_paths` draws further components of the motion, such as an acceleration. With such a
        # motion several scans have no bound (`why_no_bound`), so that the loop has no step then.
        for k in self._timeline.steps[1 : 1 + self._steps_before_first_state].tolist():
            x = self._bound_motion.transition(x, k).sample(rng)
        return x

    def bounds(self) -> dict[str, Array]:
        """Return the posterior Cramer-Rao bound on every RMSE (K,)."""
        return self._bound.whole

    @property
    def bound_caution(self) -> str:
        """Reason to doubt `bounds`: a few paths carry much of the information, or the prior is unused.

        A bound begins with the prior's covariance. A first state that is the same in every run, and not
        drawn from the prior, may be estimated with smaller errors.
        """
        if self._bound.caution:
            return self._bound.caution
        start = self._start
        if isinstance(start, FixedStart) and self._start_that_draws_truth is None:
            return (
                f"the target begins at the same state in every run, and the start `{start.kind}` has a "
                "covariance: errors may be below the bound. The start `gaussian` of a `driven` target "
                "draws the first state from it"
            )
        return ""

    def bounds_without_batch(self) -> tuple[dict[str, Array], ...]:
        """Return `bounds` by all batches of simulated paths but one; nothing without simulation."""
        return self._bound.without_batch

    @cached_property
    def _bound_motion(self) -> SampledMotion:
        """Motion for the bound."""
        return motion_of_bound(self.target.own_motion, self.T, self.target.axes)

    @property
    def has_truth(self) -> bool:
        """True if errors can be measured."""
        return self.target.has_truth

    @property
    def recorded_runs(self) -> int | None:
        """Number of recorded runs; None for simulated targets."""
        return self.target.recorded_runs

    @property
    def exists_always(self) -> bool:
        """True if a motion drives the target, whose state then is a number at every step."""
        return self.target.own_motion is not None

    @property
    def recorded_truth(self) -> Array | None:
        """Recorded true states (n_x, K, M) of the steps, NaN where unknown; None without a recording."""
        truth = self.target.recorded_truth
        if truth is None:
            return None
        # Without the steps before the first state's, and those after the scenario's last.
        return truth[:, self._steps_before_first_state : len(self._timeline.steps)]

    @property
    def cautions(self) -> tuple[str, ...]:
        """Notes on the target's data, on its unexpected keys, and on scored steps without a truth.

        The target's ``notices`` are on its data, and its ``cautions`` on its keys.
        """
        notes = [*self.target.notices, *self._notes_on_inputs]
        notes += self.target.cautions(self._timeline)
        notes += self._notes_on_angles
        truth = self.recorded_truth
        if truth is not None and isinstance(self._start, GivenStart):
            notes += note_on_far_start(
                self._start.gaussian,
                truth,
                self.times,
                self.components,
                self.angle_rows,
                self.target.run_names,
            )
        if truth is not None:
            scored = self.windows[""]  # the window of all scored steps has an empty name
            why = describe_unscored_truth(self.times, steps_with_truth(truth), scored)
            if why:
                notes.append(f"{why}; errors are not measured")
            note = note_on_runs(self.target.run_names, runs_with_truth(truth), scored)
            if note:
                notes.append(note)
        return tuple(notes)

    @property
    def cautions_on_assumptions(self) -> tuple[str, ...]:
        """Notes on sensors of which the filter drops all measurements, as they arrive late."""
        names: list[str] = []
        if isinstance(self.target, RecordingKeys):
            names = [str(name) for name in self.target.sensors]
        shortest_delays = self.target.shortest_delays(self.true_sensor)
        return tuple(notes_on_unused_sensors(self.late, shortest_delays, names))

    @property
    def _notes_on_angles(self) -> list[str]:
        """Notes on components that seem to be angles, and that no key declares as such.

        There are notes, too, on sensors that measure a multiple of one of the state's angles, such as an
        angle in degrees.
        """
        owner = "target" if isinstance(self.target, RecordingKeys) else "motion"
        lengths = position_velocity_names(self.target.axes)
        of_state = notes_on_angles(
            self.components, {*self.angles, *lengths}, self.recorded_truth, owner
        )
        return of_state + notes_on_multiples(self._sensor_of_state, self.angles)

    @cached_property
    def _notes_on_inputs(self) -> tuple[str, ...]:
        """Notes on recorded inputs that the recorded truth contradicts."""
        timeline = self._timeline
        if timeline.inputs is None or not self.has_truth:
            return ()
        truth = self.target.path(timeline)  # that of the first run
        return tuple(input_notes(self.model.motion, truth, timeline.steps, timeline.times))

    def run_metrics(self, values: Mapping[str, Array]) -> dict[str, Array]:
        """Return metrics of each run (M,) by name; nothing without a truth.

        They are ``diverged``, then the target's own, then the recovery after each fault. ``values`` are
        series (K, M) by name, such as ``squared_position``.
        """
        if not self.has_truth:
            return {}
        # Without a standard deviation of a position (NaN) no error is beyond 10 of them.
        sigma = self.position_sigma
        if sigma is None:
            sigma = np.nan
        scored = Scored(times=self.times, windows=self.windows, sigma=sigma)
        # Recorded runs differ in length, so that each one's last existing estimates count.
        metrics = {"diverged": diverged(values, recorded=self.recorded_runs is not None)}
        metrics |= self.target.run_metrics(values, scored)
        metrics |= recovery(self._fault_context, self.faults, self.windows, values)
        return metrics
