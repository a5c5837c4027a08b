"""A filter in another language: the Kalman filter of tests/programs/planar.c, and programs that fail."""

import math
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from copy import deepcopy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.commands import trackbench
from tests.conftest import ROOT, forget_facts, make_filter, track
from trackbench import api
from trackbench.contract import check_file
from trackbench.contract.estimates import new_rng, simulate
from trackbench.contract.problems import UNEQUAL, ModelDraws, planar, radar
from trackbench.contract.run_contract import check_filter
from trackbench.core.distributions import Gaussian
from trackbench.errors import UserError
from trackbench.evaluation import run_filter
from trackbench.evaluation.block_task import BlockTask
from trackbench.evaluation.run_blocks_side_by_side import run_block
from trackbench.execution import arithmetic_digests
from trackbench.execution.block_key import block_key
from trackbench.field_types import InvalidKeyError
from trackbench.filters import external_process
from trackbench.filters.external import External, ProgramRunError
from trackbench.filters.external_process import programs_cpu_s
from trackbench.filters.float32_digits import Digits, digits_of
from trackbench.models.motions.kinematic import WhiteAcceleration
from trackbench.models.sensors.base import Outliers
from trackbench.models.sensors.landmark import Landmark
from trackbench.models.sensors.position import PositionSensor
from trackbench.models.sensors.range_azimuth import PolarPosition, RangeAzimuth
from trackbench.registry import kinds
from trackbench.scenarios.starts.gaussian import GaussianStart
from trackbench.scenarios.targets.driven import Driven
from trackbench.scenarios.targets.initial_state import Launch
from trackbench.scenarios.tracking import Tracking
from trackbench.starting_files import write_new

SOURCE = Path(__file__).parents[1] / "programs" / "planar.c"
KEYS = {"q": 25.0, "sigma": 20.0}
"""Constants of the contract's linear problem."""
FAULTS = {
    "missing taken as zero": "taken as zero",
    "sigma for sigma squared": "the filter takes sigma for sigma^2",
    "first interval": "fits at equal intervals and not at unequal ones",
    "swapped axis": "x and y exchanged",
    "gain forgotten in the covariance": "does the update reduce it",
    "a step late": "one step earlier",
    "degrees": "an axis, a unit (degrees)",
    "covariance not propagated": "the covariance is too large",
    "process noise halved": "the covariance is too small",
    "state carried over": "does `init` set all of the state",
    "azimuth not wrapped": "the innovation of azimuth is not wrapped",
}


@pytest.fixture(scope="session")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the program: 0 is good, the others have a fault each."""
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler is here")
    folder = tmp_path_factory.mktemp("programs")
    for fault in range(len(FAULTS) + 1):
        out = ["-o", str(folder / str(fault)), f"-DFAULT={fault}"]
        subprocess.run([compiler, "-O1", "-Wall", "-Werror", *out, str(SOURCE), "-lm"], check=True)
    return folder


@pytest.fixture(autouse=True)
def no_program_is_left() -> Iterator[None]:
    yield
    external_process.end_all()
    assert not external_process._running


def external(path: Path, **parameters: float) -> External:
    return External(command=(str(path),), parameters=parameters, timeout=20.0)


def script(folder: Path, answer: str, first: str = "print('ready', flush=True)") -> External:
    """A program in Python, of which a line is tried."""
    path = folder / "filter.py"
    path.write_text(
        f"import os, signal, sys, time\nhello = input()\n{first}\n"
        f"for number, line in enumerate(sys.stdin):\n"
        f"    word, *fields = line.split()\n    good = ' '.join(['1'] * 4)\n    {answer}\n"
    )
    return External(command=(sys.executable, str(path)), timeout=1.0)


@pytest.mark.parametrize("scenario", [planar(), UNEQUAL], ids=["equal", "unequal"])
def test_a_kalman_filter_in_c_is_kf_in_every_run(compiled: Path, scenario: ModelDraws) -> None:
    mine, kf = (
        track(scenario, f, 23) for f in (external(compiled / "0", **KEYS), make_filter("kf"))
    )
    np.testing.assert_allclose(mine.mean, kf.mean, rtol=1e-9)
    np.testing.assert_allclose(mine.nees, kf.nees, rtol=1e-7)


def test_it_passes_the_contract(compiled: Path) -> None:
    tracker = external(compiled / "0", q=25.0, sigma=40.0, sigma_azimuth=0.04)
    on_radar = ModelDraws(base=radar(x=4000.0, y=3000.0))
    on_line = ModelDraws(base=planar(sigma=40.0))
    for on in (None, on_line, on_radar):
        assert [str(f) for f in check_filter(External, tracker, on=on) if f.verdict == "bad"] == []
    by_kind = check_file(compiled / "0")
    assert {f.verdict for f in by_kind["0"]} == {"good", "left out"}


@pytest.fixture(scope="session")
def radar_ekf(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The program of docs/any-language.md that takes the model of a radar from its first line."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        pytest.skip("no C compiler is here")
    program = tmp_path_factory.mktemp("radar") / "radar_ekf"
    source = SOURCE.parent / "radar_ekf.c"
    warn = ["-Wall", "-Wextra", "-Werror"]
    subprocess.run([compiler, "-O1", *warn, str(source), "-o", str(program), "-lm"], check=True)
    return program


@pytest.mark.parametrize("at", [(), (-1500.0, 300.0)], ids=["origin", "elsewhere"])
def test_a_program_that_reads_the_sensors_is_the_ekf(
    radar_ekf: Path, at: tuple[float, ...]
) -> None:
    """With sigmas, place and motion of the first line alone, the azimuth's cut included."""
    sensor = RangeAzimuth(
        sigma_range=30.0, sigma_azimuth_mrad=7.0, at=at, detection=0.8, outliers=Outliers(share=0.1)
    )
    scenario = replace(radar(), sensor=sensor, last=40)
    mine, ekf = (track(scenario, f, 23) for f in (external(radar_ekf), make_filter("ekf")))
    np.testing.assert_allclose(mine.mean, ekf.mean, rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(mine.nees, ekf.nees, rtol=1e-6)


def test_a_program_that_reads_the_sensors_passes_the_contract(radar_ekf: Path) -> None:
    (findings,) = check_file(radar_ekf).values()
    assert [str(finding) for finding in findings if finding.verdict == "bad"] == []
    assert findings[-1][:2] == ("errors and covariance fit reference filters", "good")
    tracker = external(radar_ekf)
    assert "needs the state px vx py vy" in tracker.conflicts(planar())[""]
    bearings = replace(radar(), sensor=PolarPosition(sigma_range=1.0, sigma_azimuth_mrad=1.0))
    assert "needs the state" in tracker.conflicts(bearings)[""]


ORIGIN = ("x[0] - at[0], dy = x[2] - at[1]", "x[0], dy = x[2]")
"""What the program of the page has, and what a program has that takes every radar to the origin."""


@pytest.fixture(scope="session")
def origin_ekf(radar_ekf: Path) -> Path:
    """The program of docs/any-language.md that assumes that the radar stands at the origin."""
    source = (SOURCE.parent / "radar_ekf.c").read_text()
    assert ORIGIN[0] in source
    program = radar_ekf.with_name("origin_ekf")
    program.with_suffix(".c").write_text(source.replace(*ORIGIN))
    compiler = shutil.which("cc") or "gcc"
    subprocess.run(
        [compiler, str(program.with_suffix(".c")), "-o", str(program), "-lm"], check=True
    )
    return program


def test_the_contract_finds_a_program_that_ignores_the_place(origin_ekf: Path) -> None:
    (findings,) = check_file(origin_ekf).values()
    bad = [finding for finding in findings if finding.verdict == "bad"]
    assert [finding.check for finding in bad] == ["uses the place of the sensor"]
    assert "subtract the place `at` of the sensor" in bad[0].why
    assert "answer `error` to an `at` that is not [0.0,0.0]" in bad[0].why
    # On a problem the program may have the place as a constant: its errors show that it has not.
    on = ModelDraws(base=radar(x=4000.0, y=3000.0, at=(-1500.0, 2000.0)))
    findings = [*check_filter(External, external(origin_ekf), on=on)]
    assert [finding.check for finding in findings if finding.verdict == "bad"] == [
        "errors and covariance fit reference filters"
    ]
    assert "ignores the place of the sensor" in findings[-1].why


@pytest.fixture(scope="session")
def float32_ekf(radar_ekf: Path) -> Path:
    """The program of docs/any-language.md in float32."""
    source = (SOURCE.parent / "radar_ekf.c").read_text()
    program = radar_ekf.with_name("float32_ekf")
    text = source.replace("double", "float").replace("%.17g", "%.9g")
    program.with_suffix(".c").write_text(text)
    compiler = shutil.which("cc") or "gcc"
    subprocess.run(
        [compiler, str(program.with_suffix(".c")), "-o", str(program), "-lm"], check=True
    )
    return program


@pytest.mark.parametrize(("magnitude", "spacing"), [(2.7e6, 0.25), (2.7e7, 2.0), (1e4, None)])
def test_float32_at_large_coordinates_names_the_spacing(
    float32_ekf: Path, magnitude: float, spacing: float | None
) -> None:
    """With a standard deviation of about 1 m; the covariance itself is not exactly symmetric."""
    base = Tracking(
        target=Driven(
            motion=WhiteAcceleration(q=0.01),
            launch=Launch(x=magnitude, vx=60.0, y=0.6 * magnitude, vy=-90.0),
        ),
        sensor=RangeAzimuth(
            sigma_range=1.0,
            sigma_azimuth_mrad=0.1,
            at=(magnitude - 9e3, 0.6 * magnitude - 8e3),
        ),
        start=GaussianStart(sigma=(3.0, 1.0, 3.0, 1.0)),
        last=40,
    )
    findings = {
        finding.check: finding
        for finding in check_filter(External, external(float32_ekf), on=ModelDraws(base=base))
    }
    digits = findings["answers have enough digits"]
    assert digits.verdict == "good"
    assert "the digits of float32" in digits.why
    errors = findings["errors and covariance fit reference filters"]
    if spacing is None:
        assert "spacing" not in digits.why
        assert errors.verdict == "good"
        return
    assert np.spacing(np.float32(magnitude)) == spacing
    advice = f"float32 has a spacing of {spacing:g} at px = "
    assert advice in digits.why
    assert "move the origin" in digits.why
    if spacing > 1.0:
        assert errors.verdict == "bad"
        assert advice in errors.why


INDEFINITE_AT = """
    P = [[0.0625 if i == j else 0.0 for j in range(4)] for i in range(4)]
    if word == 'step':
        P[0][1] = P[1][0] = 0.125
    print(X, 1.5, X, 1.5, *[p for row in P for p in row], flush=True)
"""


@pytest.mark.parametrize(
    ("position", "advice"),
    [("2700000.0", "move the origin of the coordinates"), ("100.0", "the Joseph form or a square")],
)
def test_an_indefinite_covariance_in_float32_has_the_advice_that_helps(
    tmp_path: Path, position: str, advice: str
) -> None:
    tracker = script(tmp_path, INDEFINITE_AT.replace("X", position))
    findings = {finding.check: finding for finding in check_filter(External, tracker)}
    covariance = findings["covariance is symmetric and positive definite"]
    assert covariance.verdict == "bad"
    assert "not positive definite" in covariance.why
    assert advice in covariance.why


def test_the_page_lists_the_components_of_every_sensor() -> None:
    page = (ROOT / "docs" / "any-language.md").read_text(encoding="utf-8")
    table = page.partition("| `kind` | `components` |")[2].partition("\n\n")[0]
    listed = {}
    for row in table.splitlines()[2:]:
        sensors, names = row.strip("| ").split(" | ")
        for kind in sensors.split(", "):
            listed[kind.strip("`")] = names
    own = {k: c for k, c in kinds("sensors").items() if c.__module__.startswith("trackbench.")}
    assert listed.keys() == own.keys()
    for kind, cls in own.items():
        if cls.components:
            assert listed[kind] == f"`{' '.join(cls.components)}`"
    landmark = Landmark(at=(0.0, 0.0), sigma_range=1.0, sigma_bearing_mrad=1.0)
    assert listed["landmark"].startswith(f"`{' '.join(landmark.components)}`")


def test_a_step_without_a_measurement_has_a_line(tmp_path: Path) -> None:
    tracker = script(tmp_path, f"open({str(tmp_path / 'lines')!r}, 'a').write(line); print(good)")
    tracker = replace(tracker, command=(sys.executable, "-u", tracker.command[1]))
    data = simulate(planar(), 1)
    data.measurements[:, 1] = math.nan
    state = tracker.init(planar().model, data.prior, new_rng())
    tracker.all_steps(planar().model, state, data.measurements, 1)
    lines = (tmp_path / "lines").read_text().splitlines()
    assert len([line for line in lines if line.startswith("step")]) == data.measurements.shape[1]
    assert "step 4 nan nan" in lines


FIXED_GAIN = """name: steady
scenario:
  kind: tracking
  last: 60
  target: {kind: driven, motion: {kind: cwna, q: 0.2}, launch: {x: 100, vx: 3, vy: -2}}
  sensor: {kind: position, sigma: 1.5}
  start: two-scan
  score: {steps: [SCORED, null]}
filters:
  KF: {kind: kf}
"""


@pytest.fixture(scope="module")
def fixed_gain(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A program of constant gain, that of the Kalman filter of `FIXED_GAIN` after many steps."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        pytest.skip("no C compiler is here")
    folder = tmp_path_factory.mktemp("fixed-gain")
    (folder / "steady.yaml").write_text(FIXED_GAIN.replace("SCORED", "30"))
    # Step 1: the covariance of position and velocity after many steps, and the gain.
    F = np.array([[1.0, 1.0], [0.0, 1.0]])
    Q = 0.2 * np.array([[1 / 3, 1 / 2], [1 / 2, 1.0]])
    R = 1.5**2
    P = np.eye(2)
    for _ in range(200):
        predicted = F @ P @ F.T + Q
        gain = predicted[:, 0] / (predicted[0, 0] + R)
        P = predicted - np.outer(gain, predicted[0])
    # Step 2: the program with these constants.
    constants = {
        "0.5 * innovation": f"{gain[0]:.17g} * innovation",
        "0.2 * innovation": f"{gain[1]:.17g} * innovation",
        "{{12.5, 5}, {5, 5}}": f"{{{{{P[0, 0]}, {P[0, 1]}}}, {{{P[0, 1]}, {P[1, 1]}}}}}",
    }
    source = (SOURCE.parent / "fixed_gain.c").read_text()
    for constant, value in constants.items():
        assert constant in source
        source = source.replace(constant, value)
    (folder / "mine.c").write_text(source)
    command = [compiler, "-O1", "-Wall", "-Werror", "mine.c", "-o", "mine", "-lm"]
    subprocess.run(command, cwd=folder, check=True)
    return folder


def test_a_constant_covariance_passes_the_contract(fixed_gain: Path) -> None:
    (findings,) = check_file(fixed_gain / "mine").values()
    assert [str(finding) for finding in findings if finding.verdict == "bad"] == []
    assert ("predicts over a missing measurement", "good") in {f[:2] for f in findings}


def test_the_contract_scores_the_steps_that_the_config_scores(fixed_gain: Path) -> None:
    (findings,) = check_file(fixed_gain / "mine", fixed_gain / "steady.yaml").values()
    assert [str(finding) for finding in findings if finding.verdict == "bad"] == []
    assert findings[-1][1] == "good"
    (fixed_gain / "whole.yaml").write_text(FIXED_GAIN.replace("SCORED", "1"))
    (findings,) = check_file(fixed_gain / "mine", fixed_gain / "whole.yaml").values()
    assert findings[-1].verdict == "bad"
    assert "of its standard deviations" in findings[-1].why
    assert "the covariance is constant: is the start scored" in findings[-1].why


@pytest.mark.parametrize("fault", FAULTS)
def test_planted_faults_are_found(compiled: Path, fault: str) -> None:
    path = compiled / str([*FAULTS].index(fault) + 1)
    tracker = external(path, q=25.0, sigma=40.0, sigma_azimuth=0.04)
    of_radar = fault in ("degrees", "azimuth not wrapped")
    problem = radar(x=4000.0, y=3000.0) if of_radar else planar(sigma=40.0)
    findings = check_filter(External, tracker, on=ModelDraws(base=problem))
    assert FAULTS[fault] in " ".join(str(f) for f in findings if f.verdict == "bad")


def test_a_program_of_one_sensor_is_one_line_that_names_on(tmp_path: Path) -> None:
    for first in ("print('error needs an elevation', flush=True)", "sys.exit('no elevation')"):
        tracker = script(tmp_path, "print(good, flush=True)", first)
        (finding,) = check_filter(External, tracker)
        assert finding.verdict == "bad"
        assert "elevation" in finding.why
        assert "`--on CONFIG`" in finding.why
    # A program that refuses the first problem is checked on another one of the contract.
    first = "print('ready' if 'azimuth' in hello else 'error needs an azimuth', flush=True)"
    tracker = script(tmp_path, "print(*[float(fields[-1]) / 7.0] * 4, flush=True)", first)
    findings = [*check_filter(External, tracker)]
    assert ("shapes", "good") in {finding[:2] for finding in findings}


def test_a_program_that_does_not_answer_is_started_once(tmp_path: Path) -> None:
    starts = tmp_path / "starts"
    first = f"open({str(starts)!r}, 'a').write('x'); time.sleep(60)"
    tracker = replace(script(tmp_path, "print(good, flush=True)", first), timeout=0.5)
    (finding,) = check_filter(External, tracker)
    assert (finding.check, finding.verdict) == ("runs on a problem", "bad")
    assert "does not answer the first line, `trackbench 1 {JSON}`, within 0.5 s" in finding.why
    assert "docs/any-language.md" in finding.why
    assert "--on CONFIG" not in finding.why
    assert starts.read_text() == "x"


def test_angles_are_sent_within_half_a_turn(tmp_path: Path) -> None:
    """Also those that noise carried over the cut, and recorded ones of any turn."""
    answer = "print(*([fields[2]] if word == 'step' else ['0']), *['0'] * 3, flush=True)"
    tracker, scenario = script(tmp_path, answer), radar()
    data = simulate(scenario, 1)
    z = data.measurements
    z[1, :4, 0] = [math.pi + 0.01, 4.0 - 6.0 * math.pi, -math.pi, math.nan]
    state = tracker.init(scenario.model, data.prior, new_rng())
    sent = tracker.all_steps(scenario.model, state, z, 1).estimate.mean[0, :4, 0]
    expected = [0.01 - math.pi, 4.0 - 2.0 * math.pi, math.pi]
    np.testing.assert_allclose(sent[:3], expected, atol=1e-12)
    assert z[1, 0, 0] == math.pi + 0.01


def test_a_run_goes_on_from_any_of_its_states(compiled: Path) -> None:
    """Runs side by side, and a step that is taken twice, give what whole runs give."""
    tracker, scenario = external(compiled / "0", **KEYS), planar()
    data = simulate(scenario, 5)
    state = tracker.init(scenario.model, data.prior, new_rng())
    whole = tracker.all_steps(scenario.model, state, data.measurements, 1).estimate.mean
    for i in range(data.measurements.shape[1]):
        for before in (state, deepcopy(state)):
            z = data.measurements[:, i]
            state = tracker.step(scenario.model, before, z, i + 1, new_rng())
            assert np.array_equal(state.mean, whole[:, i])


def test_seeds_belong_to_runs(tmp_path: Path) -> None:
    answer = "print(fields[0] if word == 'init' else 0, *[1] * 3, flush=True)"
    tracker = script(tmp_path, answer)
    first, more = (track(planar(), tracker, runs).mean[0, 0] for runs in (3, 7))
    assert np.array_equal(first, more[:3])
    assert len({*more}) == 7
    assert track(planar(), tracker, 3, seed=2).mean[0, 0, 0] != first[0]


WRONG = {
    "print('1 2 3', flush=True)": "run 0, step 0: the program answers 3 numbers, not 4 of a mean",
    "print(*['x'] * 4, flush=True)": "run 0, step 0: the program answers 'x', which is no number",
    "print('1,5', *[1] * 3, flush=True)": "'1,5', which is no number; write a space between",
    "print('1.5,2,3,4', flush=True)": "answers 1 numbers, not 4 of a mean, or 20 of a mean and a",
    "print(*[1] * (4 if number == 3 else 20), flush=True)": (
        "the program answers a mean and a covariance, and before it a mean alone"
    ),
    "print('1_0', *[1] * 3, flush=True)": "step 0: the program answers '1_0', which is no number",
    "print(f'\\n{good}', flush=True)": "step 0: the program answers an empty line",
    "print(*[1] * 6, 2, *[1] * 13, flush=True)": (
        "not symmetric: row 1, column 3 and its mirror image are 2 and 1"
    ),
    "print(*[1] * 6, 'nan', *[1] * 13, flush=True)": "mirror image are nan and 1",
    "print(*[1] * 6, 'inf', *[1] * 13, flush=True)": "mirror image are inf and 1",
    "print(*[1] * 4, 'nan', *[1] * 3, 2, *[1] * 11, flush=True)": "a covariance that is not symmetric",
    "print(f'{good}\\n{good}', flush=True)": "the program answers more than one line",
    "print(f'{good}\\n{good}' if number == 0 else good, flush=True)": "more than one line",
    "print('1 ' * 2**20, end='', flush=True)": "the program answers a line that does not end",
    "[print(1, end=' ', flush=True) or time.sleep(0.3) for _ in line * 9]": "no answer within 1 s",
    "time.sleep(9)": "run 0, step 0: the program gave no answer within 1 s",
    "print(good, end='', flush=True)": "the program gave no answer within 1 s",
    "print(good, flush=True) if number < 3 else sys.exit('out of memory')": (
        "run 0, step 1: the program ended with code 1; its last line on stderr: 'out of memory'"
    ),
    "os.kill(os.getpid(), signal.SIGSEGV)": "the program was ended by the signal SIGSEGV",
}


@pytest.mark.parametrize("answer", WRONG)
def test_a_wrong_answer_is_one_line(answer: str, tmp_path: Path) -> None:
    with pytest.raises(ProgramRunError) as raised:
        track(planar(), script(tmp_path, answer), 2)
    assert WRONG[answer] in str(raised.value)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("first", "what"),
    [
        ("print('error needs Q', flush=True)", "the program refuses this problem: needs Q"),
        ("print('error needs Q', end='\\r\\n', flush=True)", "refuses this problem: needs Q"),
        ("print('error', 'x' * 900_000, flush=True)", "x..."),
        ("print('hello', flush=True)", "answers 'hello' at its start, not `ready`"),
        ("raise ValueError('no such file')", "'ValueError: no such file'"),
    ],
)
def test_a_wrong_start_is_one_line(first: str, what: str, tmp_path: Path) -> None:
    with pytest.raises(ProgramRunError) as raised:
        track(planar(), script(tmp_path, "print(good, flush=True)", first), 2)
    assert what in str(raised.value)
    assert len(str(raised.value)) < 700


def test_a_program_may_end_its_lines_as_on_windows(tmp_path: Path) -> None:
    answer, first = (f"print({what}, end='\\r\\n', flush=True)" for what in ("good", "'ready'"))
    assert (track(planar(), script(tmp_path, answer, first), 2).mean == 1.0).all()


def test_spaces_around_ready_are_no_mistake(tmp_path: Path) -> None:
    tracker = script(tmp_path, "print(good, flush=True)", "print('  ready ', flush=True)")
    assert track(planar(), tracker, 1).mean[0, 0, 0] == 1.0


def test_answers_to_earlier_lines_are_found_in_the_last_run(tmp_path: Path) -> None:
    """The second line of one answer shifts all later ones, and the last one comes late."""
    answer = "time.sleep(0.3 if number == 8 else 0)\n    "
    answer += "print(*[number] * 4, flush=True)\n    "
    answer += "number == 1 and print(*[number] * 4, flush=True)"
    with pytest.raises(ProgramRunError, match=r"answer each line by one line|more than one line"):
        track(planar(), script(tmp_path, answer), 1)


def test_an_error_names_the_number_of_a_training_run(tmp_path: Path) -> None:
    """Training runs count down from -1, so that the third one is -3."""
    first = "inits = 0; print('ready', flush=True)"
    # Each run begins twice, as the program has `init` of all runs before the first step.
    answer = "inits += word == 'init'\n    print('error' if inits == 7 else good, flush=True)"
    tracker = script(tmp_path, answer, first)
    task = BlockTask(planar(), tracker, seed=1, index=-1, width=4, runs_used=4)
    with pytest.raises(ProgramRunError, match="run -3, step "):
        run_block(task)


def test_a_program_gets_each_line_of_a_long_track_once(tmp_path: Path) -> None:
    """Two runs have more steps than other filters make in one call."""
    log = tmp_path / "words"
    first = f"log = open({str(log)!r}, 'w'); print('ready', flush=True)"
    tracker = script(tmp_path, "print(word, file=log, flush=True); print(good, flush=True)", first)
    last = 17_000
    assert 2 * last > run_filter._AT_ONCE
    track(replace(planar(), last=last), tracker, 2)
    external_process.end_all()
    assert log.read_text().split().count("step") == 2 * last


def test_the_end_of_a_long_stderr_is_kept(tmp_path: Path) -> None:
    noise = "[sys.stderr.write(('e' * 99 + '\\n') * 1000) for _ in range(20)]"
    first = f"print('ready', flush=True); {noise}; sys.stderr.flush()"
    tracker = script(tmp_path, "sys.exit('the last words')", first)
    kept = list[int]()

    class Counted(external_process.Program):
        def kill(self) -> None:
            super().kill()
            kept.append(sum(map(len, self._error_lines)))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("trackbench.filters.external_process.Program", Counted)
        with pytest.raises(ProgramRunError, match="'the last words'"):
            track(planar(), tracker, 2)
    assert 50_000 < kept[0] <= 1 << 16


DIGITS = {
    "f'{v:.6g}'": "at most 6 digits",
    "f'{v:.3g}'": "at most 3 digits",
    "f'{v:.4f}'": "at most 4 decimals",
    "f'{v:.9g}'": "the answers have the digits of float32",
    "f'{float32(v):.9g}'": "the answers have the digits of float32",
    "f'{float32(v):.8g}'": "the answers have the digits of float32",
    "f'{float32(v):.17g}'": "the answers have the digits of float32",
    "f'{v:.17g}'": "",
    "repr(v)": "",
}


def test_three_decimals_beside_large_numbers_are_not_the_digits_of_float32() -> None:
    """1000.123 has 7 digits, as float32 has; the small numbers beside it show the decimals."""
    rng = np.random.default_rng(4)
    position = 1000.0 + rng.normal(size=(1, 40))
    velocity = rng.normal(size=(1, 40))
    mean = np.concatenate([position, velocity])
    cov = np.full((2, 2, 40), 0.002)
    digits = digits_of(np.round(mean, 3), cov)
    assert digits == Digits(too_few="at most 3 decimals")
    single = np.float32(mean).astype(float)
    assert digits_of(single, np.float32(cov).astype(float)) == Digits(is_float32=True)
    assert digits_of(mean, cov) == Digits()


@pytest.mark.parametrize("printed", DIGITS)
def test_answers_of_few_digits_are_noticed(printed: str, tmp_path: Path) -> None:
    """Those of float32 are a note, as an embedded filter computes with them by design."""
    numbers = "[float(fields[-1]) * 100 / k for k in (1, 3, 7, 9)]"
    first = (
        "float32 = lambda v: __import__('struct').unpack('f', __import__('struct').pack('f', v))[0]"
    )
    first += "; print('ready', flush=True)"
    tracker = script(tmp_path, f"print(*[{printed} for v in {numbers}], flush=True)", first)
    findings = {f.check: f for f in check_filter(External, tracker)}
    digits = findings["answers have enough digits"]
    is_mistake = DIGITS[printed].startswith("at most")
    assert digits.verdict == ("bad" if is_mistake else "good")
    assert DIGITS[printed] in digits.why
    assert bool(digits.why) == bool(DIGITS[printed])
    assert ("print 17 digits" in digits.why) == is_mistake
    assert findings["shapes"].verdict == "good"


def test_on_takes_the_name_of_a_shipped_experiment(radar_ekf: Path, tmp_path: Path) -> None:
    """As every command that takes a config does."""
    words = ("check", "--contract", radar_ekf, "--on")
    done = trackbench(*words, "tracking-radar", cwd=tmp_path)
    assert "is neither a file nor a shipped experiment" in done.stderr
    done = trackbench(*words, "radar-turns", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert "good  errors and covariance fit reference filters" in done.stdout


LATE_INDEFINITE = """
    P = [[4.0 if i == j else 0.0 for j in range(4)] for i in range(4)]
    if word == 'step' and float(fields[0]) > 70:
        P[0][1] = P[1][0] = 5.0
    print(*good.split(), *[p for row in P for p in row], flush=True)
"""


def test_the_contract_tries_the_whole_length_of_a_config(tmp_path: Path) -> None:
    """A covariance that becomes indefinite after 70 steps; the other checks take at most 34."""
    script(tmp_path, LATE_INDEFINITE.strip())
    on = tmp_path / "own.yaml"
    mine = f"  Mine: {{kind: external, command: [{sys.executable}, filter.py]}}\n"
    found = {}
    for last in (60, 90):
        on.write_text(CONFIG.replace("last: 8", f"last: {last}") + mine)
        findings = check_file(tmp_path / "filter.py", on=on, allow_plugins=True)["Mine"]
        found[last] = next(f for f in findings if f.check.startswith("covariance is symmetric"))
    assert found[60].verdict == "good"
    assert found[60].why == "20 runs of 30 steps and 20 runs of 60 steps of the experiment"
    assert found[90].verdict == "bad"
    assert "not positive definite: the correlations have an eigenvalue -0.25, first at step 71" in (
        found[90].why
    )
    assert "in 20 of 20 runs of 90 steps of the experiment" in found[90].why


def test_rounding_in_float32_is_symmetric_enough(tmp_path: Path) -> None:
    """Estimates get the mean of the two entries; a larger difference is told with its digits."""
    for difference, is_rounding in ((1e-5, True), (1e-4, False)):
        entries = "[[4, 1], [1 + DIFFERENCE, 4]]".replace("DIFFERENCE", str(difference))
        answer = f"P = {entries}; print(1, 1, *P[0], *P[1], flush=True)"
        tracker = script(tmp_path, answer)
        prior = Gaussian(np.ones((2, 1)), np.eye(2)[..., None])
        if is_rounding:
            cov = tracker.init(planar().model, prior, new_rng()).cov
            assert cov[0, 1, 0] == cov[1, 0, 0] == 1.0 + difference / 2
            continue
        with pytest.raises(ProgramRunError) as raised:
            tracker.init(planar().model, prior, new_rng())
        what = str(raised.value)
        assert (
            "row 1, column 2 and its mirror image are 1 and 1.0001, which differ by 2.5e-05" in what
        )
        assert "more than the allowed 1e-05: keep (P + P') / 2 after each update" in what


def test_a_run_notes_answers_of_few_digits(tmp_path: Path) -> None:
    script(tmp_path, "print(*[f'{123456.7 + float(fields[0]) % 50:.6g}'] * 4, flush=True)")
    path = tmp_path / "own.yaml"
    command = f"[{sys.executable}, filter.py]"
    path.write_text(CONFIG + f"  Mine: {{kind: external, command: {command}}}\n")
    report = api.run(path, out=tmp_path / "out", quiet=True, allow_plugins=True, formats=())
    assert any("Mine: answers have at most 6 digits" in note for note in report.notes)


def test_a_kill_at_any_time_is_an_error_or_the_right_numbers(compiled: Path) -> None:
    tracker = external(compiled / "0", **KEYS)
    good, outcomes = track(planar(), tracker, 10).mean, set[bool]()
    for i in range(40):

        def kill(delay: float = i / 40 * 0.01) -> None:
            time.sleep(delay)
            for running in [*external_process._running]:
                os.kill(running._process.pid, signal.SIGKILL)

        thread = threading.Thread(target=kill)
        thread.start()
        try:
            assert np.array_equal(track(planar(), tracker, 10).mean, good)
            outcomes.add(True)
        except ProgramRunError as error:
            assert "SIGKILL" in str(error)  # noqa: PT017 (either outcome is right)
            outcomes.add(False)
        thread.join()
    assert False in outcomes


def test_nothing_is_left_of_a_process_that_is_killed(tmp_path: Path) -> None:
    """Neither the program, which hangs, nor what it started."""
    (tmp_path / "wrapper.sh").write_text(
        "#!/bin/sh\nread hello\necho ready\nsleep 600 &\necho $! >&2\nwait\n"
    )
    (tmp_path / "wrapper.sh").chmod(0o755)
    code = (
        "import os, signal, time\nfrom trackbench.filters.external_process import Program\n"
        "program = Program(['./wrapper.sh'], 'hello', 20.0)\n"
        "while not (text := os.pread(program._errors.fileno(), 99, 0)): time.sleep(0.01)\n"
        "print(program._process.pid, text.decode(), flush=True)\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == -signal.SIGKILL
    deadline = time.monotonic() + 20
    for pid in map(int, done.stdout.split()):
        while Path(f"/proc/{pid}/exe").exists() and time.monotonic() < deadline:
            time.sleep(0.01)
        assert not Path(f"/proc/{pid}/exe").exists()


def test_an_empty_anees_of_a_program_says_why(tmp_path: Path) -> None:
    """The reason is its answer, and not the truth; a filter that failed needs no further reason."""
    answers = {"the mean alone": "print(good, flush=True)", "failed": "print('x', flush=True)"}
    for reason, answer in answers.items():
        folder = tmp_path / reason.replace(" ", "-")
        folder.mkdir()
        script(folder, answer)
        (folder / "own.yaml").write_text(
            "name: own\nruns: 2\nblock: fit\nscenario:\n  kind: tracking\n  last: 4\n"
            "  target: {kind: driven, motion: {kind: cwna, q: 1}}\n"
            "  sensor: {kind: position, sigma: 1}\n"
            "  start: {kind: gaussian, sigma: [1, 1, 1, 1]}\n"
            "filters:\n  Mine: {kind: external, command: [python3, filter.py]}\n"
            "tables: {t: {kind: metrics, columns: {ANEES: anees}}}\nfigures: {}\n"
        )
        done = api.run(
            folder / "own.yaml", out=folder / "out", allow_plugins=True, quiet=True, workers=1
        )
        notes = " ".join(done.results.tables["t"].notes)
        assert reason in notes
        assert "needs a truth" not in notes


def test_notes_are_on_the_programs_that_ran(tmp_path: Path) -> None:
    """One that `only` leaves out takes no time; its code must be allowed all the same."""
    script(tmp_path, "print(good, flush=True)")
    for name in ("Mine", "Other"):
        folder = tmp_path / name
        (tmp_path / "own.yaml").write_text(
            "name: own\nruns: 2\nblock: fit\nscenario:\n  kind: tracking\n  last: 4\n"
            "  target: {kind: driven, motion: {kind: cwna, q: 1}}\n"
            "  sensor: {kind: position, sigma: 1}\n"
            "  start: {kind: gaussian, sigma: [1, 1, 1, 1]}\n"
            "filters:\n  Mine: {kind: external, command: [python3, filter.py]}\n"
            "  Other: {kind: external, command: [python3, filter.py, again]}\n  KF: {kind: kf}\n"
            f"only: [{name}, KF]\n"
        )
        done = api.run(tmp_path / "own.yaml", out=folder, allow_plugins=True, quiet=True, workers=1)
        notes = " ".join(note for table in done.ranking() for note in table.notes)
        assert f"The time of {name} includes the exchange of lines" in notes
    only_kf = api.run(
        tmp_path / "own.yaml", out=folder, allow_plugins=True, quiet=True, set=["only=[KF]"]
    )
    assert not any("exchange" in note for table in only_kf.ranking() for note in table.notes)
    page = (folder / "report.html").read_text()
    assert "External programs" not in page
    assert "--allow-plugins" in page


def test_a_filter_without_covariance_has_errors_and_no_nees(tmp_path: Path) -> None:
    tracker = script(tmp_path, "print(good, flush=True)")
    out = track(planar(), tracker, 3)
    assert (out.mean == 1.0).all()
    assert np.isnan(out.nees).all()
    left_out = [f.why for f in check_filter(External, tracker) if f.verdict == "left out"]
    assert left_out.count("the program answers no covariance") == 3


MEAN_ALONE = """#!{python}
import json, sys
hello = json.loads(sys.stdin.readline().split(" ", 2)[2])
q, r = hello["motion"]["q"], hello["sensors"][0]["R"][0][0]
gain = q / (q + r)  # no good gain, but one of this model
print("ready", flush=True)
for line in sys.stdin:
    word, *fields = line.split()
    if word == "end":
        break
    numbers = [float(field) for field in fields]
    if word == "init":
        x = numbers[2:6]
    elif numbers[1] == numbers[1]:
        x = [a + gain * (numbers[1 + i // 2] - a) if i % 2 == 0 else a for i, a in enumerate(x)]
    print(*x, flush=True)
"""


def test_a_mean_of_the_model_is_not_called_one_of_constants(tmp_path: Path) -> None:
    """Without covariances the estimates were never alike, and no check saw the model's noise."""
    path = tmp_path / "mean"
    path.write_text(MEAN_ALONE.replace("{python}", sys.executable))
    path.chmod(0o755)
    findings = list(check_filter(External, External(command=(str(path),), timeout=20.0)))
    assert not [f for f in findings if "constants of its own" in f.why]


def test_a_script_is_checked_by_its_command_in_a_config(tmp_path: Path) -> None:
    write_new("filter", "mine", tmp_path, "python")
    on = tmp_path / "mine.yaml"
    on.write_text(on.read_text().replace("python3,", f"{sys.executable},"))  # it has numpy
    with pytest.raises(UserError, match="a program is run only with --allow-plugins"):
        check_file(tmp_path / "mine.py", on=on)  # its command has the file and more
    findings = check_file(tmp_path / "mine.py", on=on, allow_plugins=True)["mine"]
    assert [str(f) for f in findings if f.verdict == "bad"] == []
    assert ("errors and covariance fit reference filters", "good") in {f[:2] for f in findings}
    with pytest.raises(UserError, match="--on CONFIG"):
        check_file(tmp_path / "mine.yaml")


CONFIG = """name: own
runs: 20
block: 10
scenario:
  kind: tracking
  last: 8
  target: {kind: driven, motion: {kind: cwna, q: 1}, launch: {x: 10, vx: 1}}
  sensor: {kind: position, sigma: 2}
  start: {kind: gaussian, sigma: [2, 1, 2, 1]}
filters:
  KF: {kind: kf}
"""
MINE = "  Mine: {kind: external, command: [./mine], parameters: {q: 1.0, sigma: 2.0}}\n"


def test_a_config_runs_a_program_with_consent(compiled: Path, tmp_path: Path) -> None:
    shutil.copy(compiled / "0", tmp_path / "mine")
    path = tmp_path / "own.yaml"
    path.write_text(CONFIG + MINE)
    with pytest.raises(
        UserError, match=r"own\.yaml:12:35: filters\.Mine\.command: a program is run only"
    ):
        api.run(path, out=tmp_path / "out", quiet=True)
    report = api.run(path, out=tmp_path / "out", quiet=True, allow_plugins=True, formats=())
    errors = report.per_run[report.per_run["metric"] == "rmse_position"]
    rmse = errors.groupby("filter")["value"].mean()
    assert rmse["Mine"] == pytest.approx(rmse["KF"], rel=1e-9)
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "Mine: the same numbers on the same machine only" in page
    assert "out/config.yaml --allow-plugins" in page
    # A stored config names the program from its own folder.
    assert "command: [../mine]" in (tmp_path / "out" / "config.yaml").read_text()


def test_a_program_of_the_command_line_is_consented_to(compiled: Path, tmp_path: Path) -> None:
    path = tmp_path / "own.yaml"
    path.write_text(CONFIG)
    chosen = [compiled / "0"]
    report = api.run(path, out=tmp_path / "out", quiet=True, filters=chosen, formats=())
    assert report.results.labels == ["KF", "0"]
    with pytest.raises(UserError, match="neither the path of a Python file nor of a program"):
        api.run(path, quiet=True, filters=[path])


def test_words_after_a_program_of_the_command_line_need_consent(
    compiled: Path, tmp_path: Path
) -> None:
    """The program alone is consented to; with arguments it may do anything else."""
    program, path = compiled / "0", tmp_path / "own.yaml"
    entry = "  Mine: {kind: external, command: [WORDS], parameters: {q: 1.0, sigma: 2.0}}\n"
    path.write_text(CONFIG + entry.replace("WORDS", f"{program}, --remove"))
    with pytest.raises(UserError, match=r"filters\.Mine\.command: a program is run only"):
        api.run(path, out=tmp_path / "out", quiet=True, filters=[program])
    path.write_text(CONFIG + entry.replace("WORDS", f"{program}"))
    keys = {"quiet": True, "engine": "serial", "formats": ()}
    report = api.run(path, out=tmp_path / "out", filters=[program], **keys)
    assert report.failed == []


def test_a_program_that_is_changed_while_it_runs_is_an_error(tmp_path: Path) -> None:
    """It rewrites its own file at the last line of a run, and answers all lines well."""
    answer = "word == 'step' and open(__file__, 'a').write('#') and None; print(good, flush=True)"
    with pytest.raises(ProgramRunError, match="the program or its files changed meanwhile"):
        track(planar(), script(tmp_path, answer), 1)


def test_a_program_that_is_built_again_is_started_again(tmp_path: Path) -> None:
    """Of the same content; programs that run already belong to the old file."""
    tracker = script(tmp_path, "print(*[os.getpid()] * 4, flush=True)")
    first, again = (int(track(planar(), tracker, 1).mean[0, 0, 0]) for _ in range(2))
    assert first == again
    path = Path(tracker.command[1])
    path.write_text(path.read_text())
    later = path.stat().st_mtime_ns + 10**9
    os.utime(path, ns=(later, later))
    assert int(track(planar(), tracker, 1).mean[0, 0, 0]) != first


def test_the_time_of_an_ended_program_counts_once(tmp_path: Path) -> None:
    """A pool that is dropped ends its programs, which may have ended before."""
    tracker = script(tmp_path, "print(good, flush=True)", "sum(range(10**7)); print('ready')")
    program = external_process.Program([*tracker.command[:1], "-u", tracker.command[1]], "h", 20.0)
    program.exchange(["init 1 0 1 1"])
    external_process.end_programs([program])
    spent = programs_cpu_s()
    assert program.cpu_s > 0.0
    external_process.end_programs([program])
    assert programs_cpu_s() == spent


@pytest.mark.skipif(sys.platform != "linux", reason="reads the CPU clock of another process")
def test_the_time_of_a_program_is_that_of_its_filter(tmp_path: Path) -> None:
    """It works 20 ms for each answer, and answers the CPU seconds that it has spent by then."""
    work = "end = time.process_time() + 0.02\n    while time.process_time() < end: pass"
    spent_by_then = "time.process_time() if word == 'step' else 0"
    answer = f"{work}\n    print(*[{spent_by_then}] * 4, flush=True)"
    tracker, ready = script(tmp_path, answer), programs_cpu_s()
    output = track(planar(), tracker, 1)
    answers = output.mean[0].size
    spent = programs_cpu_s() - ready
    assert 0.02 * answers < spent < float(output.mean[0].max()) + 0.1
    assert output.cpu_s > 0.02 * answers
    # A program that ends takes no time from the filter that is timed meanwhile.
    external_process.end_all()
    assert spent <= programs_cpu_s() - ready < spent + 0.1


@pytest.mark.skipif(sys.platform != "linux", reason="reads the CPU clock of another process")
def test_the_time_of_a_program_is_known_after_its_end(tmp_path: Path) -> None:
    """Of one that works 20 ms for each answer, also if nobody has asked before it ended."""
    work = "end = time.process_time() + 0.02\n    while time.process_time() < end: pass"
    tracker = script(tmp_path, f"{work}\n    print(good, flush=True)")
    for end in (external_process.end_programs, lambda programs: [one.kill() for one in programs]):
        one, before = external_process.Program(tracker.command, "hello", 20.0), programs_cpu_s()
        one.exchange(["step"] * 5)
        end([one])
        assert 0.1 < programs_cpu_s() - before < 1.0


def test_the_arithmetic_of_the_machine_is_part_of_the_key_of_a_program(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It computes as it likes; a filter of the package has the same numbers on every machine."""
    filters = script(tmp_path, "print(good, flush=True)"), make_filter("kf")
    keys = []
    for machine in ("one", "another"):
        monkeypatch.setattr(arithmetic_digests, "numpy_arithmetic", lambda digest=machine: digest)
        forget_facts()
        keys.append([block_key(BlockTask(planar(), f, 1, 0, 2, 2), 2) for f in filters])
    forget_facts()
    (of_program, of_kf), (elsewhere, of_kf_elsewhere) = keys
    assert of_program != elsewhere
    assert of_kf == of_kf_elsewhere


def test_times_of_equal_steps_have_no_rounding_that_grows(tmp_path: Path) -> None:
    """The program answers the time of each step: a tenth, two tenths, ..., not their sum so far."""
    tracker = script(tmp_path, "print(*[fields[0] if word == 'step' else 0] * 4, flush=True)")
    driven = Driven(motion=WhiteAcceleration(q=1.0), launch=Launch(vx=1.0))
    start = GaussianStart(sigma=(1.0, 1.0, 1.0, 1.0))
    scenario = Tracking(
        T=0.1, target=driven, sensor=PositionSensor(sigma=1.0), start=start, last=60
    )
    times = track(scenario, tracker, 1).mean[0, :, 0]
    np.testing.assert_array_equal(times, np.arange(61) * 0.1)
    assert not np.array_equal(times[1:], np.cumsum(np.full(60, 0.1)))


def test_the_program_and_its_files_are_part_of_the_key(tmp_path: Path) -> None:
    (tmp_path / "own").write_text("1")
    tracker = replace(script(tmp_path, "print(good, flush=True)"), files=(str(tmp_path / "own"),))
    keys = set()
    for _ in range(2):
        keys.add(block_key(BlockTask(planar(), replace(tracker), 1, 0, 2, 2), 2))
        (tmp_path / "own").write_text("2")
    keys.add(block_key(BlockTask(planar(), replace(tracker, parameters={"a": 1}), 1, 0, 2, 2), 2))
    assert len(keys) == 3
    # So are a folder among the files, and a file within a word.
    folder = tmp_path / "weights" / "of"
    folder.mkdir(parents=True)
    keyed = replace(tracker, files=(str(folder.parent),))
    worded = replace(tracker, command=(*tracker.command, f"--c={tmp_path / 'own'}"))
    for text in ("3", "4"):
        (folder / "a").write_text(text)
        (tmp_path / "own").write_text(text)
        for other in (keyed, worded):
            keys.add(block_key(BlockTask(planar(), replace(other), 1, 0, 2, 2), 2))
    assert len(keys) == 7
    Path(tracker.command[1]).write_text("edited meanwhile")
    with pytest.raises(ProgramRunError, match="is not as it was when the run began"):
        track(planar(), tracker, 2)


def test_all_of_a_declared_folder_is_part_of_the_key(tmp_path: Path) -> None:
    """Empty folders, files that may be executed, and folders that links lead to."""
    folder = tmp_path / "app"
    tools = tmp_path / "tools"
    for made in (folder, tools):
        made.mkdir()
    (folder / "helper").write_text("1")
    tracker = replace(script(tmp_path, "print(good, flush=True)"), files=(str(folder),))
    keys = []

    def note_key() -> None:
        keys.append(block_key(BlockTask(planar(), replace(tracker), 1, 0, 2, 2), 2))

    note_key()
    (folder / "empty").mkdir()
    note_key()
    (folder / "helper").chmod(0o755)
    note_key()
    (folder / "tools").symlink_to(tools)
    (tools / "gain").write_text("2")
    note_key()
    (tools / "gain").write_text("3")
    note_key()
    assert len(set(keys)) == 5
    (tools / "round").symlink_to(folder)
    with pytest.raises(InvalidKeyError, match=r"round, a link to .*app, a folder around it"):
        replace(tracker)


def test_a_folder_of_the_command_may_be_among_the_files(tmp_path: Path) -> None:
    """It has two digests, of its path and of its content; the program was called changed."""
    folder = tmp_path / "app"
    folder.mkdir()
    (folder / "gains").write_text("1")
    tracker = script(tmp_path, "print(good, flush=True)")
    command = (*tracker.command, str(folder))
    both = replace(tracker, command=command, files=(str(folder),))
    assert np.isfinite(track(planar(), both, 2).mean).all()


def test_declared_variables_are_part_of_the_key(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the filter's entry, or for all programs of the config; as are the config's folders."""
    script(tmp_path, "print(*[os.environ.get('GAIN', 'nan')] * 4, flush=True)")
    (tmp_path / "weights").mkdir()
    monkeypatch.setenv("TRACKBENCH_CACHE", str(tmp_path / "cache"))
    mine = f"  Mine: {{kind: external, command: [{sys.executable}, filter.py]}}\n"
    declared = "environment: [GAIN]\nfiles: [weights]\n"
    (tmp_path / "all.yaml").write_text(CONFIG + mine + declared)
    (tmp_path / "one.yaml").write_text(CONFIG + mine.replace("}", ", environment: [GAIN]}"))
    for name in ("all", "one"):
        means = []
        for gain in ("0.5", "77.25", "77.25"):
            monkeypatch.setenv("GAIN", gain)
            report = api.run(
                tmp_path / f"{name}.yaml",
                out=tmp_path / "out" / name,
                quiet=True,
                allow_plugins=True,
                formats=(),
                engine="serial",
            )
            errors = report.per_run[report.per_run["filter"] == "Mine"]
            means.append(errors[errors["metric"] == "rmse_position"]["value"].mean())
        assert means[0] != means[1] == means[2]
        assert "environment: [GAIN]" in (tmp_path / "out" / name / "config.yaml").read_text()
    # A variable that changes while programs start is an error, as a file is.
    tracker = replace(script(tmp_path, "print(good, flush=True)"), environment=("GAIN",), copies=1)
    monkeypatch.setenv("GAIN", "3")
    with pytest.raises(ProgramRunError, match="GAIN is not as it was when the run began"):
        track(planar(), tracker, 2)
    (tmp_path / "none.yaml").write_text(CONFIG + declared)
    with pytest.raises(UserError, match="what plugins and programs read"):
        api.run(tmp_path / "none.yaml", quiet=True)


@pytest.mark.parametrize(
    ("command", "files", "unwatched"),
    [
        (("python3", "app"), (), "the folder app are"),
        (("python3", "main.py", "--tables=app"), (), "the folder app are"),
        (("python3", "-m", "json"), (), "'python3 -m json' runs are"),
        (("sh", "-c", "cat x"), (), "'sh -c cat x' runs are"),
        (("python3", "app"), ("app",), ""),
        (("python3", "main.py"), (), ""),
        (("./main.py", "20"), (), ""),
    ],
)
def test_what_of_a_program_is_not_watched_is_noted(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    command: tuple[str, ...],
    files: tuple[str, ...],
    unwatched: str,
) -> None:
    """Changes of a folder, a module or a line of a shell leave the cached blocks as they are."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "app").mkdir()
    (tmp_path / "main.py").write_text("#!/usr/bin/env python3\n")
    (tmp_path / "main.py").chmod(0o755)
    _, *notes = External(command=command, files=files).cautions(planar())
    assert len(notes) == bool(unwatched)
    if unwatched:
        assert f"{unwatched} not noticed" in notes[0]


def test_a_run_notes_digits_that_are_too_few_at_its_coordinates(tmp_path: Path) -> None:
    """Eight digits are as many as those of float32, and do no harm near the origin."""
    path = tmp_path / "own.yaml"
    command = f"[{sys.executable}, filter.py]"
    path.write_text(CONFIG + f"  Mine: {{kind: external, command: {command}}}\n")
    for offset, is_noted in ((300_000, True), (0, False)):
        mean = f"[f'{{{offset} + float(fields[-1]) % 1:.8g}}'] * 4"
        cov = "[0.0123 * (i % 5 == 0) for i in range(16)]"
        script(tmp_path, f"print(*{mean}, *{cov}, flush=True)")
        out = tmp_path / f"out {offset}"
        report = api.run(path, out=out, quiet=True, allow_plugins=True, formats=())
        notes = [note for note in report.notes if note.startswith("Mine: answers of 8 digits")]
        assert len(notes) == is_noted
        for note in notes:
            assert "have a spacing of 0.01 at" in note
            assert "print 17 digits" in note


@pytest.mark.parametrize("end", ["", "; number == 2 and sys.exit(1)"])
def test_an_error_of_a_later_line_is_that_of_the_filter(tmp_path: Path, end: str) -> None:
    """A program may end after it, so that the lines after it have no answer."""
    answer = "print(good if number < 2 else 'error S is singular', flush=True)"
    with pytest.raises(ProgramRunError) as raised:
        track(planar(), script(tmp_path, f"{answer}{end}"), 1)
    assert "run 0, step 2: the program reports an error: S is singular" in str(raised.value)
