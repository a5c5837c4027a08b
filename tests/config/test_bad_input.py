"""Every mistake is one line with file, line and column; all of them at once; nothing is written."""

from pathlib import Path
from typing import Any

import pytest
from pydantic import TypeAdapter, ValidationError

from tests.papers import banana_text
from trackbench import field_types
from trackbench.config.load import load
from trackbench.errors import UserError
from trackbench.models.motions.scalar import MerweMotion

SCENARIO = (
    "{kind: tracking, first: 1, last: 50, start: known, sensor: {kind: square-then-line, R: 1}, "
    "target: {kind: driven, motion: {kind: sine-gamma, phi1: 0.5}}}"
)
GOOD = f"""name: x
runs: 10
scenario: {SCENARIO}
filters:
  PF:
    kind: pf
    N: 10
"""


def mistakes(tmp_path: Path, text: str, **options: object) -> list[str]:
    path = tmp_path / "c.yaml"
    path.write_text(text)
    with pytest.raises(UserError) as caught:
        load(path, **options)
    return [line.replace(f"{path}:", "") for line in str(caught.value).splitlines()]


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("N: 10", "N: 0", "7:8: filters.PF.N: 0 is less than 2"),
        ("N: 10", 'N: "10"', "7:8: filters.PF.N: '10' is not a whole number"),
        ("N: 10", "N: 10.5", "7:8: filters.PF.N: 10.5 is not a whole number"),
        ("N: 10", "NN: 10", "7:5: filters.PF.NN: unknown key; did you mean N?"),
        ("N: 10", "n: 10", "7:5: filters.PF.n: unknown key; did you mean N?"),
        ("N: 10", "N: true", "7:8: filters.PF.N: true is not a whole number"),
        ("N: 10", "N: [1]", "7:8: filters.PF.N: [1] is not a whole number"),
        (
            "N: 10",
            "weights: exp",
            "7:14: filters.PF.weights: 'exp' is not one of log, naive or floor",
        ),
        (
            "N: 10",
            "ess_threshold: .nan",
            "7:20: filters.PF.ess_threshold: NaN is not a finite number",
        ),
        (
            "N: 10",
            "N: 10\n    N: 20",
            "8:5: filters.PF.N: duplicate key, first given on line 7",
        ),
        (
            "kind: pf",
            "kind: fp",
            "6:11: filters.PF.kind: 'fp' is not a kind of filter; did you mean pf?",
        ),
        ("R: 1}", "R: -1}", "3:98: scenario.sensor.R: -1 is not greater than 0"),
        (
            "last: 50",
            "last: 1",
            "3:44: scenario.last: 1 leaves no step to measure after step 1",
        ),
        (
            "kind: pf\n    N: 10",
            "kind: hdepf\n    CR: 1.4",
            "7:9: filters.PF.CR: 1.4 is greater than 1",
        ),
        ("kind: pf\n    N: 10", "kind: hdepf\n    N: 3", "7:8: filters.PF.N: 3 is less than 4"),
        (
            "kind: pf\n    N: 10",
            "kind: hdepf\n    T0: 0",
            "7:9: filters.PF.T0: 0 is not greater than 0",
        ),
        (
            "kind: pf\n    N: 10",
            "kind: hdepf\n    preset: litteral",
            "7:13: filters.PF.preset: 'litteral' is not a preset of hdepf; did you mean literal?",
        ),
        (
            "kind: pf\n    N: 10",
            "kind: ukf\n    kappa: -3",
            "7:12: filters.PF.kappa: n + kappa must be greater than 0; n = 3",
        ),
        (
            "kind: pf\n    N: 10",
            "kind: ukf\n    start: mucm",
            "7:12: filters.PF.start: needs a start from two scans, such as `start: two-scan`",
        ),
        (
            "kind: pf\n    N: 10",
            "kind: upf\n    kappa: -3.5",
            "7:12: filters.PF.kappa: n + kappa must be greater than 0; n = 3",
        ),
        (
            "kind: pf\n    N: 10",
            "kind: ukf\n    alpha: 1e-200",
            "7:12: filters.PF.alpha: alpha^2 (n + kappa) must be a finite number",
        ),
        ("start: known", "start: ~", "3:55: scenario.start: is not a mapping with a kind"),
        ("start: known", "start: []", "3:55: scenario.start: is not a mapping with a kind"),
        (
            "sensor: {kind: square-then-line, R: 1}",
            "sensor: []",
            "3:70: scenario.sensor: is empty: na",
        ),
        (
            "{kind: driven, motion: {kind: sine-gamma, phi1: 0.5}}",
            "[]",
            "3:110: scenario.target: is not a mapping with a kind",
        ),
        (
            "{kind: sine-gamma, phi1: 0.5}",
            "[{kind: sine-gamma}]",
            "3:133: scenario.target.motion: is not a mapping with a kind",
        ),
        ("name: x", "name: ../x", "1:7: name: '../x' must start with a letter or digit"),
        ("name: x", "name: /etc/x", "1:7: name: '/etc/x' must start with a letter or digit"),
        ("runs: 10", "runs: 0", "2:7: runs: 0 is less than 1"),
        ("runs: 10", "rnus: 10", "2:1: rnus: unknown key; did you mean runs?"),
        ("name: x\n", "", "1:1: name: this key is required"),
        (f"scenario: {SCENARIO}", "scenario: nowhere.yaml", "3:11: scenario: cannot read"),
        (f"scenario: {SCENARIO}", "scenario: {T: 3}", "3:11: scenario: needs a kind"),
        (
            f"scenario: {SCENARIO}",
            "scenario: 3",
            "3:11: scenario: is neither a mapping nor a path",
        ),
        (f"scenario: {SCENARIO}", "scenario: !!python/name:os.system", "3:11: scenario: the tag"),
        ("runs: 10", "runs: {{", "not valid YAML"),
        ("runs: 10", "reference: Exact", "2:12: reference: 'Exact' is not a filter here"),
        ("runs: 10", "grid: {runs: [1, 2]}", "2:8: grid.runs: a grid varies scenario.KEY"),
        (
            "runs: 10",
            "grid: {scenario.sensor.R: [1, -1]}",
            "2:31: scenario.sensor.R: -1 is not greater than 0",
        ),
        (
            "runs: 10",
            "tables: {t: {kind: metrics, columns: {a: mean(rmse)}, filters: [QF]}}",
            "2:65: tables.t.filters.0: 'QF' is not a filter here",
        ),
        (
            "runs: 10",
            "tables: {t: {kind: differences, against: PFF, columns: {a: rmse}}}",
            "2:42: tables.t.against: 'PFF' is not a filter here; did you mean PF?",
        ),
        (
            "runs: 10",
            "tables: {t: {kind: claims, claims: {c: {less: PF, than: PFF, metric: rmse}}}}",
            "2:57: tables.t.claims.c.than: 'PFF' is not a filter here; did you mean PF?",
        ),
        (
            "runs: 10",
            "tables: {t: {kind: metrics, columns: {a: anees}, gain: {of: FP, over: PF}}}",
            "2:61: tables.t.gain.of: 'FP' is not a filter here; did you mean PF?",
        ),
        (
            "runs: 10",
            "figures: {f: {kind: rmse-vs-parameter, metric: mean(rmse)}}",
            "2:14: figures.f.parameter: there is no grid",
        ),
        (
            "runs: 10",
            "figures: {f: {kind: rmse-vs-parameter, metric: mean(rmse), parameter: scenario.sensor.Q}}\n"
            "grid: {scenario.sensor.R: [1, 2]}",
            "2:71: figures.f.parameter: 'scenario.sensor.Q' is no path of the grid; "
            "did you mean scenario.sensor.R?",
        ),
        (
            "runs: 10",
            "figures: {f: {kind: rmse-vs-parameter, metric: mean(rmse)}}\n"
            "grid: {filters.PF.resampling: [systematic, residual]}",
            "2:14: figures.f.parameter: 'systematic' in the grid of filters.PF.resampling is no number",
        ),
        (
            "runs: 10",
            "figures: {f: {kind: heat-map, y: N}}\ngrid: {filters.PF.N: [5, 9]}",
            "2:34: figures.f.y: 'N' is no path of the grid; known: filters.PF.N",
        ),
        (
            "runs: 10",
            "figures: {f: {kind: posterior}}",
            "2:14: figures.f: there is no range and azimuth to show",
        ),
        (
            f"scenario: {SCENARIO}",
            f"scenario: {banana_text()}\nfigures: {{f: {{kind: posterior, point: 2}}}}",
            "4:39: figures.f.point: 2 is more than the number of points, 1",
        ),
        (
            f"scenario: {SCENARIO}",
            f"scenario: {banana_text()}\nfigures: {{f: {{kind: posterior, step: 2}}}}",
            "4:38: figures.f.step: 2 is not one of the steps 3 to 100",
        ),
        (
            "runs: 10",
            "figures: {f: {kind: track}}",
            "2:14: figures.f.components: [0, 2]: the state has components 0 to 0",
        ),
        (
            "runs: 10",
            "figures: {f: {kind: mean-and-std}}",
            "2:14: figures.f: there are no errors in x and y to show",
        ),
        (
            "runs: 10",
            "figures: {t: {kind: rmse-vs-time, floor: PFF}}",
            "2:42: figures.t.floor: 'PFF' is not a filter here; did you mean PF?",
        ),
    ],
)
def test_one_mistake(tmp_path: Path, old: str, new: str, expected: str) -> None:
    assert old in GOOD
    found = mistakes(tmp_path, GOOD.replace(old, new))
    assert any(expected in line for line in found), found
    assert len(found) == 1


def test_all_mistakes_at_once(tmp_path: Path) -> None:
    text = GOOD.replace("N: 10", "N: 0\n    bogus: 1").replace("runs: 10", "runs: x")
    found = mistakes(tmp_path, text.replace("R: 1}", "phi2: -1}"))
    assert len(found) == 4
    assert [line.split(":")[0] for line in found] == ["2", "3", "7", "8"]


@pytest.mark.parametrize(("key", "hides"), [("bogus", False), ("titel", False), ("refrence", True)])
def test_an_unknown_key_hides_other_mistakes_if_they_may_hang_on_it(
    tmp_path: Path, key: str, hides: bool
) -> None:
    text = f"{GOOD}\n{key}: PF\ntables: {{t: {{kind: metrics, columns: {{X: mean(rsme)}}}}}}\n"
    found = mistakes(tmp_path, text)
    assert any(f"{key}: unknown key" in line for line in found)
    assert any("'rsme' is no metric here" in line for line in found) is not hides


def test_a_mistake_in_a_used_file_names_that_file(tmp_path: Path) -> None:
    part = tmp_path / "part.yaml"
    part.write_text("kind: pf\nN: -3\n")
    found = mistakes(tmp_path, GOOD.replace("    kind: pf\n    N: 10", "    use: part.yaml"))
    assert found == [f"{part}:2:4: filters.PF.N: -3 is less than 2"]


def test_a_mistake_in_an_override_names_the_option(tmp_path: Path) -> None:
    assert mistakes(tmp_path, GOOD, overrides=["filters.PF.N=-1"]) == [
        "--set filters.PF.N=-1: filters.PF.N: -1 is less than 2"
    ]
    assert mistakes(tmp_path, GOOD, overrides=["filters.PF.N"]) == [
        "--set filters.PF.N: write PATH=VALUE"
    ]
    assert "did you mean PF" in mistakes(tmp_path, GOOD, only=["pf"])[0]


@pytest.mark.parametrize("shape", [30, 200])
def test_gamma_noise_that_the_quadrature_cannot_resolve(tmp_path: Path, shape: int) -> None:
    text = GOOD.replace("kind: pf\n    N: 10", "kind: grid")
    text = text.replace("phi1: 0.5", f"gamma_shape: {shape}")
    what = "6:5: filters.PF: grid is exact for gamma noise of a shape up to 20 only"
    assert mistakes(tmp_path, text) == [what]


def test_a_filter_that_cannot_run_on_the_model(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:

    monkeypatch.delattr(MerweMotion, "jacobian")
    found = mistakes(tmp_path, GOOD.replace("kind: pf\n    N: 10", "kind: ekf"))
    assert found == [
        "6:11: filters.PF: `ekf` works only with a motion with a Jacobian; "
        "take another filter or motion"
    ]


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b"", "is empty"),
        (b"\x80\x81", "not a text file"),
        (b"- 1\n- 2\n", "an experiment is a mapping"),
        (b"a: \t1\n\tb: 2\n", "not valid YAML"),
        (
            b"a: &a [x,x,x,x,x,x,x,x,x]\n"
            + b"".join(
                f"{c}: &{c} [{','.join([f'*{p}'] * 9)}]\n".encode()
                for p, c in zip("abcdefgh", "bcdefghi", strict=True)
            ),
            "more than 100000 values",
        ),
        (b"a: " + b"[" * 300 + b"]" * 300, "nested"),
        (b"\x00\x01", "not valid YAML"),
    ],
)
def test_files_that_are_no_config(tmp_path: Path, content: bytes, expected: str) -> None:
    path = tmp_path / "c.yaml"
    path.write_bytes(content)
    with pytest.raises(UserError, match=expected):
        load(path)


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"none\.yaml:1:1: no such file"):
        load(tmp_path / "none.yaml")


TINY, HUGE = 5e-324, 1.7976931348623157e308
INF, NAN = float("inf"), float("nan")


@pytest.mark.parametrize(
    ("kind", "taken", "refused"),
    [
        ("Positive", (TINY, HUGE), (0.0, -TINY, INF, NAN)),
        ("NonNegative", (0.0, HUGE), (-TINY, INF, NAN)),
        ("Finite", (-HUGE, HUGE), (-INF, INF, NAN)),
        ("Share", (0.0, 1.0), (-TINY, 1.0 + 2**-52, NAN)),
        ("OpenShare", (TINY, 1.0 - 2**-53), (0.0, 1.0, NAN)),
        ("Count", (1, 10**15), (0, 10**15 + 1, 1.5)),
        ("Steps", (1, 100_000), (0, 100_001)),
        ("Natural", (0,), (-1,)),
        ("Digits", (1, 15), (0, 16)),
    ],
)
def test_numbers_of_a_key_end_where_their_type_does(kind: str, taken: Any, refused: Any) -> None:
    validator = TypeAdapter(getattr(field_types, kind))
    assert [validator.validate_python(x) for x in taken] == [*taken]
    for x in refused:
        with pytest.raises(ValidationError):
            validator.validate_python(x)
    assert [field_types.is_number(x) for x in (0, 0.5, True, "1")] == [True, True, False, False]
