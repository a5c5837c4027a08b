"""The shipped files hold every number that the papers print, once per experiment, and can be read."""

import csv
from collections import Counter
from pathlib import Path

import pytest

from tests.conftest import EXPERIMENT_FILES, EXPERIMENTS, PLANE, shipped
from trackbench import api
from trackbench.config.load import load
from trackbench.config.published_numbers_and_claims import picks
from trackbench.config.read_published_files import read_published
from trackbench.errors import UserError
from trackbench.evaluation.metric_expression import measure
from trackbench.verify.verify_folder import verify

FILES = {path.name: path for path in sorted(EXPERIMENTS.glob("*/published/*.csv"))}


def rows(name: str) -> list[dict[str, str]]:
    with FILES[name].open() as file:
        return list(csv.DictReader(file))


def printed(name: str) -> Counter[tuple[str, str]]:
    """How many different numbers each table has, whichever experiment measures them."""
    keys = {(r["paper"], r["table"], r["row"], r["filter"], r["metric"]) for r in rows(name)}
    return Counter((paper, table) for paper, table, *_ in keys)


def test_every_printed_number_is_there() -> None:
    assert printed("hdepf.csv") == {
        ("hdepf", "Table 1"): 10,
        ("hdepf", "Table 2"): 6,
        ("hdepf", "Table 3"): 5,  # six times, as ratios to the first
        ("hdepf", "Text"): 1,
    }
    assert printed("merwe2000.csv") == {("merwe2000", "Table 1"): 16}
    assert printed("banana.csv") == {
        ("banana", "Table 1"): 12,
        ("banana", "Table 2"): 9,  # eight errors, and the ratio of the two times
        ("banana", "Table 3"): 9,
    }


def test_a_number_of_a_printed_table_is_measured_or_listed_as_left_out() -> None:
    """Counts of numbers in the tables of the EKF/UKF Toolbox's manual and in DAPPER's comments."""
    toolbox = {
        **{"ungm": 11, "random-sine": 32, "bearings-two": 13, "reentry": 10},
        **{"cv-ca": 6, "coordinated-turn": 6, "maneuver-bearings": 8},
    }
    dapper = {
        **{"lorenz63": 15, "lorenz96": 18, "lorenz96-40": 33, "double-pendulum": 23},
        **{"lorenz63-variants": 32, "lorenz96-variants": 28},
    }
    for name, count in {**toolbox, **dapper}.items():
        assert sum(printed(name + ".csv").values()) == count, name
    left_out = [r for name in FILES for r in rows(name) if not r.get("label", r.get("left"))]
    assert all(r["note"] for r in left_out)


def test_a_number_is_the_same_wherever_it_is_measured() -> None:
    for names in (["hdepf.csv"], ["merwe2000.csv"], ["banana.csv", "banana-scans.csv"]):
        values: dict[tuple[str, ...], str] = {}
        for r in [row for name in names for row in rows(name)]:
            key = (r["paper"], r["table"], r["row"], r["filter"], r["metric"])
            assert values.setdefault(key, r["value"]) == r["value"], key
            decimals = len(r["value"].partition(".")[2])
            assert int(r["digits"]) == decimals, key


@pytest.mark.parametrize(("written", "digits"), [
    ("0.20,", 2), ("0.20,3", 3), ("17,", 0), ("-3.5,", 1), ("1.5e-3,", 4), ("2.5e3,", 0), ("biased,", 0),
])  # fmt: skip
def test_a_number_has_the_decimals_that_are_written(
    written: str, digits: int, tmp_path: Path
) -> None:
    path = tmp_path / "numbers.csv"
    path.write_text(f"paper,table,filter,metric,value,digits\np,t,f,m,{written}\n")
    (number,) = read_published(tmp_path, [path.name], "x").numbers
    assert number.digits == digits
    path.write_text(f"paper,table,filter,metric,value\np,t,f,m,{written.partition(',')[0]}\n")
    (number,) = read_published(tmp_path, [path.name], "x").numbers
    assert number.digits == (2 if written == "0.20,3" else digits)


def test_claims_of_every_paper() -> None:
    for paper in ("hdepf", "merwe2000", "adaptive-kf", "banana"):
        assert {r["paper"] for r in rows(f"{paper}-claims.csv")} == {paper}


@pytest.mark.parametrize("path", FILES.values(), ids=lambda p: p.name)
def test_every_row_is_well_formed(path: Path) -> None:
    experiments = {name for r in rows(path.name) for name in r["experiment"].split(";") if name}
    assert experiments
    for experiment in experiments:
        found = read_published(path.parent, [path.name], experiment)
        assert found.numbers or found.claims
        for row in [*found.numbers, *found.claims]:
            assert all(measure(str(e)) == e for e in row.expressions), row


def test_a_quote_that_is_not_closed_is_said_with_its_line(tmp_path: Path) -> None:
    path = tmp_path / "p.csv"
    path.write_text('paper,table,filter,metric,value\nx,y,z,m,1\nx,y,"' + "q" * 140_000)
    with pytest.raises(UserError, match=r"p\.csv:3:1: not a CSV: field larger than"):
        read_published(tmp_path, [path.name], "x")


def test_experiments_that_measure_something_name_the_file() -> None:
    named = set()
    for path in EXPERIMENT_FILES.values():
        experiment = shipped(path.stem)
        name = experiment.settings.name
        for file in FILES:
            if any(name in r["experiment"].split(";") for r in rows(file)):
                assert file in experiment.published.files, f"{path.name} misses {file}"
                named.add(file)
    assert named == {*FILES}


def test_a_point_of_a_label_with_an_equals_sign() -> None:
    values = {"filters.EnKF (N=10).inflation": 1.2, "runs": 5}
    assert picks("filters.EnKF (N=10).inflation=1.2; runs = 5", values)
    assert not picks("filters.EnKF (N=10).inflation=1.3", values)
    assert not picks("filters.EnKF (N=10)=1.2", values)


@pytest.mark.parametrize(
    ("expression", "mistake"),
    [
        ("rms(rmse_position)", ""),
        ("rmse_position@8", ""),
        ("rmse_position@3..last", ""),
        ("gain(rms(rmse_position[late]), EKF)", ""),
        ("ratio(cpu_s_per_run, EKF)", ""),
        ("anees", ""),
        ("rms(rmse_positon)", "'rmse_positon' is no metric here; did you mean rmse_position?"),
        ("rms(rmse_position[lat])", "'rmse_position[lat]' is no metric here; did you mean"),
        ("rmse_position@9", "'rmse_position@9': the last step of a run is 8"),
        ("gain(rmse_position@90, EKF)", "the last step of a run is 8"),
    ],
)
def test_a_claim_names_a_metric_window_and_step_that_exist(
    tmp_path: Path, expression: str, mistake: str
) -> None:
    (tmp_path / "claims.csv").write_text(
        f'paper,claim,experiment,left,expression,factor\nme,small,c,KF,"{expression}",1\n'
    )
    (tmp_path / "c.yaml").write_text(
        f"name: c\n{PLANE}  score: {{windows: [{{name: late, first: 5}}]}}\n"
        "filters: {KF: {kind: kf}, EKF: {kind: ekf}}\npublished: [claims.csv]\n"
    )
    if not mistake:
        load(tmp_path / "c.yaml")
        return
    with pytest.raises(UserError) as error:
        load(tmp_path / "c.yaml")
    (problem,) = error.value.problems
    assert str(problem).startswith(f"{tmp_path / 'claims.csv'}:2:15: expression: ")
    assert mistake in str(problem)
    # An option that shortens the run, or changes its windows, makes no mistake of the file.
    load(tmp_path / "c.yaml", overrides=["scenario.last=7"])


def test_results_of_a_shortened_run_can_be_verified(tmp_path: Path) -> None:
    """Their config has the value of the option, and the published row a step beyond it."""
    (tmp_path / "claims.csv").write_text(
        "paper,claim,experiment,left,expression,factor\nme,small,c,KF,rmse_position@8,1\n"
    )
    (tmp_path / "c.yaml").write_text(
        f"name: c\nruns: 4\n{PLANE}filters: {{KF: {{kind: kf}}}}\npublished: [claims.csv]\n"
        "tables: {t: {kind: metrics, columns: {E: rmse_position@8}}}\n"
    )
    options = api.Options(engine="serial", quiet=True, times=False, formats=())
    api.run(tmp_path / "c.yaml", options, set=["scenario.last=6"], out=tmp_path / "out")
    assert load(tmp_path / "out" / "config.yaml").published.claims
    assert verify(tmp_path / "out", 4) == []


def test_a_step_beyond_the_end_is_a_mistake_of_a_table(tmp_path: Path) -> None:
    text = (
        f"name: c\n{PLANE}filters: {{KF: {{kind: kf}}}}\n"
        "tables: {t: {kind: metrics, columns: {E: rmse_position@STEP}}}\n"
    )
    (tmp_path / "c.yaml").write_text(text.replace("STEP", "8"))
    load(tmp_path / "c.yaml")
    load(tmp_path / "c.yaml", overrides=["scenario.last=7"])
    (tmp_path / "c.yaml").write_text(text.replace("STEP", "9"))
    with pytest.raises(UserError, match=r"columns.E: 'rmse_position@9': the last step of"):
        load(tmp_path / "c.yaml")
