"""Test whether a filter wraps its angles: runs in which each angle passes its cut, and runs elsewhere.

The prior of a problem is turned until an angle has a chosen value some steps later; sensors and motion
stay as they are. A filter may count an angle from -pi, from 0, or from north. So the angle passes pi, 0,
pi/2 and -pi/2 in some runs, and stays between them in others, which show how far an honest filter is
from a reference filter.
"""

from collections.abc import Sequence
from itertools import cycle, islice
from typing import NamedTuple

import numpy as np

from trackbench.contract.compare_with_references import compare_with_references, with_many_particles
from trackbench.contract.estimates import Estimates, deviation, run_filter
from trackbench.contract.findings import ContractError, LeftOutError
from trackbench.contract.likely_cause import PLACE_IGNORED
from trackbench.contract.problems import PLANAR, RADAR, ModelDraws
from trackbench.contract.turned_priors import Angle, angles_of, simulate_from_turned_priors
from trackbench.contract.unwrapped_innovations import is_unwrapped
from trackbench.contract.why_not_running import runs_on, why_not
from trackbench.core.arrays import Array, Mask
from trackbench.core.distributions import Gaussian
from trackbench.filters.base import AnyFilter
from trackbench.filters.bootstrap_pf import PF
from trackbench.filters.ekf import EKF
from trackbench.filters.ukf import UKF
from trackbench.models.likelihood import has_own_density
from trackbench.scenarios.base import Scenario, Simulation
from trackbench.statistics.share_of_runs import fisher_exact_p

_RUNS_BY_CUT = {
    "+-pi": (np.pi, 64),
    "0": (0.0, 24),
    "pi/2": (np.pi / 2, 24),
    "-pi/2": (-np.pi / 2, 24),
}
"""Value of the angle, rad, and number of runs, by the cut that the angle passes."""
_FAR_FROM_CUTS = "elsewhere"
_ELSEWHERE = (np.pi / 4, -np.pi / 4, 3 * np.pi / 4, -3 * np.pi / 4)
_RUNS_ELSEWHERE = 24  # of each
# Numbers of steps after which the angle has its value: each run takes the next of them.
_AHEAD = (1, 2, 3, 5, 8)
_SOUND = 6.0  # standard deviations: largest error of a reference filter in a run that counts
_LEAST_SCALE = 1.0 / 3.0  # standard deviations from the reference, of filters that nearly equal it
_BEYOND = 3.0  # times the largest deviation of a run in which no angle is near a cut
_FOLLOWS = 100.0  # times a correct filter's deviation: a filter that is farther off is not judged
_LEAST_RUNS = 3  # runs beyond it that are a fault
_LEAST_SHARE = 0.05  # of a cut's runs, likewise
_CHANCE = 1e-3  # probability of such runs by chance, of a filter that draws


def _steps_before_cuts(problem: ModelDraws, angle: Angle, data: Simulation) -> Array:
    """Count the first steps (M,) of each run in which its angle passes none of its cuts.

    A cut is a value at which the numbers of the angle may jump: 0, pi or +-pi/2. The true angle and the
    measured one must stay in the quarter of the circle in which the true angle is at the first step.
    """
    steps = problem.steps[1:].tolist()
    if angle.kind == "state":
        true_angle = data.truth[angle.row, 1:]
        measured = np.full(true_angle.shape, np.nan)
    else:
        sensor = problem.model.sensor
        expected = [sensor.measurement(data.truth[:, i], k).mean for i, k in enumerate(steps, 1)]
        true_angle = np.stack([values[angle.row] for values in expected])
        measured = data.measurements[angle.row]
    quarter = _quarter_of_circle(true_angle)
    measured_quarter = np.where(np.isnan(measured), quarter[0], _quarter_of_circle(measured))
    stays = (quarter == quarter[0]) & (measured_quarter == quarter[0])
    return np.logical_and.accumulate(stays, axis=0).sum(axis=0)


def _select_runs(data: Simulation, runs: list[int]) -> Simulation:
    """Return the data of some runs, by their indices."""
    prior = data.prior
    return Simulation(
        truth=data.truth[..., runs],
        measurements=data.measurements[..., runs],
        prior=Gaussian(prior.mean[:, runs], prior.cov[..., runs]),
    )


def _quarter_of_circle(values: Array) -> Array:
    """Return the number 0 to 3 of the quarter in which angles lie; they count from 0."""
    return np.floor(np.mod(values, 2.0 * np.pi) / (0.5 * np.pi))


def _judged_runs(
    problem: ModelDraws, angle: Angle, data: Simulation, groups: Sequence[str], ahead: Array
) -> tuple[list[int], int]:
    """Select the runs that show whether an angle's cut matters, and the number of steps to compare.

    A cut is a value at which the numbers of an angle jump. ``groups`` has for each run the cut that its
    angle passes, or a name that begins with "elsewhere" if the angle is to stay far from all cuts.

    In every run the angle is at its chosen value, a cut or one between the cuts, after ``ahead`` (M,)
    steps. An angle that wanders also passes a cut in many of the runs elsewhere. Then only the first
    steps count, up to the last one to which half of these runs pass no cut; the other half is left out.
    So is a run of another group in which the angle reaches its cut too late.

    If no step would be left, all runs and steps are judged. Then the runs elsewhere pass cuts, too. They
    raise the limit of a right run (`_Comparison.limit`), so that fewer faults are found.
    """
    is_elsewhere = np.array([name.startswith(_FAR_FROM_CUTS) for name in groups])
    quiet_steps = _steps_before_cuts(problem, angle, data)
    horizon = int(np.quantile(quiet_steps[is_elsewhere], 0.5, method="lower"))
    if horizon <= ahead.min():
        # The angle wanders so fast that the runs elsewhere pass cuts before any run reaches its own.
        return [*range(len(groups))], len(problem.steps) - 1
    is_judged = np.where(is_elsewhere, quiet_steps >= horizon, ahead < horizon)
    return np.flatnonzero(is_judged).tolist(), horizon


class _Comparison(NamedTuple):
    """Comparison of a filter with reference filters, in runs in which one angle has chosen values.

    In some runs the angle passes a cut, a value at which its numbers jump. In the others, elsewhere, it
    is in one of four directions between the cuts. A group is the runs of one cut or one direction.
    """

    ratio: Array
    """deviation of the tested filter from a reference, over that of another correct filter; (M,)"""
    group: tuple[str, ...]
    """group of each run: the cut that the angle passes, or a value far from its cuts"""
    center: Estimates
    """estimates of the best reference"""
    data: Simulation
    random: bool
    """whether the filter drew random numbers"""

    def of_group(self, name: str) -> Mask:
        """Return which runs (M,) belong to a group."""
        return np.array([other == name for other in self.group])

    @property
    def elsewhere(self) -> list[str]:
        """Groups whose angle is far from its cuts."""
        return sorted({name for name in self.group if name.startswith(_FAR_FROM_CUTS)})

    @property
    def is_elsewhere(self) -> Mask:
        """Runs whose angle is far from its cuts."""
        return np.array([name.startswith(_FAR_FROM_CUTS) for name in self.group])

    @property
    def follows(self) -> bool:
        """True if the filter follows the target where the angle is far from the cuts at which it jumps.

        The runs of one direction of the angle are a group. In one group far from all cuts, at least, the
        median of `ratio` must be small. It is the filter's deviation from a reference filter in a run,
        divided by that of another correct filter.
        """
        medians = [float(np.median(self.ratio[self.of_group(name)])) for name in self.elsewhere]
        return min(medians) < _FOLLOWS

    @property
    def limit(self) -> float:
        """Ratio above which a run is wrong: a multiple of the largest ratio far from all cuts.

        A run's ratio is the filter's deviation from a reference filter over that of another correct
        filter. The runs of one direction of the angle are a group, and `elsewhere` names the groups far
        from all cuts. Of their largest ratios the smallest counts, but at least 1.
        """
        largest = [float(self.ratio[self.of_group(name)].max()) for name in self.elsewhere]
        return _BEYOND * max(1.0, min(largest))


def mistaken_angle(tracker: AnyFilter, problem: ModelDraws) -> str | None:
    """Describe the angle at whose cut a filter goes wrong; an empty text if there is none.

    A cut is a value at which the numbers of an angle jump by a turn, such as pi or 0.

    The result is None if no angle passes its cut, or if no reference filter runs. It is also None if the
    filter does not even follow the target elsewhere, for example one that was written for positions.
    """
    compared_any = False
    doubtful = ""
    for angle in angles_of(problem):
        compared = _compare(tracker, problem, angle)
        if compared is None or not compared.follows:
            continue
        compared_any = True
        cut = _cut_of_fault(compared)
        if not cut:
            continue
        # The runs whose angle passes this cut. A run is wrong if its ratio is above the limit: the
        # filter's deviation from a reference filter, over that of another correct filter.
        is_here = compared.of_group(cut)
        number = int((compared.ratio > compared.limit)[is_here].sum())
        where = f"{number} of {is_here.sum()} runs go wrong where {angle.name} crosses {cut}"
        if angle.kind == "measured" and is_unwrapped(
            tracker, problem, angle, compared.data, compared.center, compared.is_elsewhere
        ):
            return f"the innovation of {angle.name} is not wrapped: {where}"
        # Reported unless another angle is plainly unwrapped.
        if not doubtful:
            message = "is every difference of it wrapped, and a mean of sigma points on the circle?"
            doubtful = f"{where}: {message}"
    if not compared_any:
        return None
    return doubtful


def _compare(tracker: AnyFilter, problem: ModelDraws, angle: Angle) -> _Comparison | None:
    """Compare a filter with reference filters, in runs at the cuts of an angle and in runs elsewhere.

    A cut is a value at which the numbers of the angle jump, such as pi. The result is None if the angle
    does not pass the cut at pi, or if no reference filter runs.
    """
    # Step 1: runs of each group: of a cut, or of a direction far from all cuts. The angle has its value
    # after `ahead` steps, a number that differs from run to run.
    values: list[float] = []
    group: list[str] = []
    for name, (value, number) in _RUNS_BY_CUT.items():
        values += [value] * number
        group += [name] * number
    for value in _ELSEWHERE:
        values += [value] * _RUNS_ELSEWHERE
        group += [f"{_FAR_FROM_CUTS} {value:.2f}"] * _RUNS_ELSEWHERE
    possible = [step for step in _AHEAD if step < len(problem.steps)]
    ahead = np.array([*islice(cycle(possible), len(values))])
    data = simulate_from_turned_priors(problem, angle, np.array(values), ahead, seed=7)
    # Runs whose angle can have its value: the prior is NaN in the others.
    reached = np.flatnonzero(np.isfinite(data.prior.mean).all(axis=0)).tolist()
    group = [group[i] for i in reached]
    if "+-pi" not in group or not any(name.startswith(_FAR_FROM_CUTS) for name in group):
        return None
    data = _select_runs(data, reached)
    # Of these, the runs that are compared, in their first `horizon` steps. An angle may wander over
    # other cuts afterwards.
    judged, horizon = _judged_runs(problem, angle, data, group, ahead[reached])
    group = [group[i] for i in judged]
    data = _select_runs(data, judged)
    # Step 2: references.
    sensor = problem.model.sensor
    if has_own_density(sensor) and sensor.why_no_moments():
        return None
    filters: list[AnyFilter] = [f for f in (UKF(), EKF()) if not why_not(f, problem)]
    if not filters:
        return None
    tested = run_filter(tracker, problem, data)
    references = [run_filter(f, problem, data) for f in filters]
    rows = problem.angle_rows
    # The truth in place of a filter: its covariance is not used.
    truth = Estimates(mean=data.truth, cov=references[0].cov, random=False, series={})
    errors = [deviation(truth, reference, rows, horizon) for reference in references]
    best = int(np.argmin([np.median(error) for error in errors]))
    center = references[best]
    others = [reference for i, reference in enumerate(references) if i != best]
    particles = PF(N=max(tracker.particle_count, 50))
    if tested.random and not why_not(particles, problem):
        others.append(run_filter(particles, problem, data))
    # Step 3: deviations from the best reference, in units of another reference's. Runs in which the best
    # reference itself is off the truth by more than `_SOUND` of its standard deviations do not count.
    scale = np.full(len(group), _LEAST_SCALE)
    for other in others:
        scale = np.maximum(scale, deviation(other, center, rows, horizon))
    deviations = deviation(tested, center, rows, horizon)
    ratio = np.where(errors[best] < _SOUND, deviations / scale, 0.0)
    return _Comparison(
        ratio=ratio,
        group=tuple(group),
        center=center,
        data=data,
        random=tested.random,
    )


def _cut_of_fault(compared: _Comparison) -> str:
    """Return the cut at which the largest share of the runs is wrong, if these are too many; else "".

    A cut is a value at which the angle may jump, such as +-pi or 0. A filter that draws is wrong in
    some runs by chance, and so is one with a gate, which is then wrong in some runs elsewhere, too. Its
    wrong runs are too many if chance does not explain them, in comparison with the runs elsewhere.
    """
    # A run is wrong if its ratio is above the limit: the filter's deviation from a reference filter,
    # over that of another correct filter. A group is the runs of one cut, or of one direction elsewhere.
    beyond = compared.ratio > compared.limit
    shares = {name: float(beyond[compared.of_group(name)].mean()) for name in {*compared.group}}
    # The groups elsewhere are of up to four directions. A filter may be wrong in half of the plane, so
    # compare with the two best of them only.
    quiet = sorted(compared.elsewhere, key=shares.__getitem__)[:2]
    is_quiet = np.any([compared.of_group(name) for name in quiet], axis=0)
    is_by_chance = compared.random or bool(beyond[compared.is_elsewhere].any())
    cuts = [name for name in _RUNS_BY_CUT if name in shares]
    for cut in sorted(cuts, key=shares.__getitem__, reverse=True):
        is_here = compared.of_group(cut)
        number = int(beyond[is_here].sum())
        if number < _LEAST_RUNS or shares[cut] < _LEAST_SHARE:
            continue
        chance = fisher_exact_p(
            number, int(is_here.sum()), int(beyond[is_quiet].sum()), int(is_quiet.sum())
        )
        if not is_by_chance or chance < _CHANCE:
            return cut
    return ""


def check_angles(tracker: AnyFilter, scenario: Scenario) -> None:
    """Check that a filter does not go wrong where an angle crosses its cut, such as pi.

    The prior is turned about the sensor until the angles cross it. A filter that runs on the contract's
    linear problem, PLANAR, is checked with a radar instead, if it runs with one.
    """
    if scenario is PLANAR and runs_on(tracker, RADAR):
        scenario = RADAR
    problem = scenario if isinstance(scenario, ModelDraws) else ModelDraws(base=scenario)
    if not angles_of(problem):
        where = "this problem" if isinstance(scenario, ModelDraws) else "the contract's problem"
        raise LeftOutError(f"{where} has no angle; `--on CONFIG` names an experiment with one")
    # The prior is turned as a normal distribution, which lacks the attributes of other priors.
    for requirement in tracker.all_requirements:
        if requirement.startswith("prior."):
            raise LeftOutError(f"needs {requirement}, which a turned problem has not")
    message = mistaken_angle(with_many_particles(tracker), problem)
    # None: the angles could not be tested; empty: no mistake was found.
    if message is None:
        why = (
            "no angle passes its cut, no reference filter runs, or the filter is far off everywhere"
        )
        raise LeftOutError(f"{why}; `--on CONFIG` names an experiment that it is written for")
    if message:
        # A filter with a wrong place counts every angle wrongly.
        difference = compare_with_references(with_many_particles(tracker), problem)
        if difference and difference.ignores_place:
            raise LeftOutError(f"cannot be tested, as {PLACE_IGNORED}")
        raise ContractError(message)
