"""Words, names and folders that look like mistakes and are none, and folders that hold other things."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.bad_input.test_bad_input import LISTS, good_files
from tests.papers import merwe_text
from trackbench import api
from trackbench.config.load import load
from trackbench.config.resolved_config import as_yaml
from trackbench.errors import UserError, WriteError
from trackbench.results.remove_earlier_files import remove_outputs
from trackbench.unsafe_characters import explain_formula
from trackbench.verify.verify_folder import verify
from trackbench.yaml_source import parse

SCENARIO = merwe_text(T=3)
GOOD = f"name: x\nruns: 2\nscenario: {SCENARIO}\nfilters:\n  PF: {{kind: pf, N: 10}}\n"
OPTIONS = api.Options(engine="serial", quiet=True, formats=("svg",))


@settings(suppress_health_check=[HealthCheck.too_slow], deadline=None)  # on a busy machine
@given(
    st.dictionaries(st.text("ab \t\n\r\x85\u2028\u2029\ufeff:#-'\"\\{[!&*|>%@1e~._,"), st.text())
)
def test_any_words_can_be_written_and_read_again(words: dict[str, str]) -> None:
    try:
        again = parse(as_yaml(words), "again").data
    except UserError:  # a character that no file may hold, or a key that is a formula
        assert any(not word.isprintable() for word in words.values()) or any(
            map(explain_formula, words)
        )
    else:
        assert again == words


NUMBERS = "paper,table,filter,metric,value,label,expression\n"
FACTORS = "paper,claim,left,expression,factor,right,point\n"
READINGS = "paper,table,filter,metric,value,label,reading,experiment\n"


def test_declared_readings_and_rows_for_experiments_elsewhere_are_accepted(tmp_path: Path) -> None:
    rows = "p,t,f,m,1, PF ,a,x\np,t,f,m,1,PF,b,x ; x2\np,t,g,m,1,QF,,hdepf;hdepf-9;elsewhere\n"
    (tmp_path / "p.csv").write_text(READINGS.replace(",label", ", label ") + rows)
    path = tmp_path / "c.yaml"
    path.write_text(GOOD + "published: [p.csv]\n")
    assert [row.labels for row in load(path).published.numbers] == [["PF"], ["PF"]]


def test_rows_that_mean_something_are_accepted(tmp_path: Path) -> None:
    (tmp_path / "p.csv").write_text(
        FACTORS + "p,nobody measures,,,,,\np,c,PF,mean(rmse),2,,filters.PF.N=9\n"
    )
    path = tmp_path / "c.yaml"
    path.write_text(GOOD + "published: [p.csv]\ngrid: {filters.PF.N: [9, 10]}\n")
    assert len(load(path).published.claims) == 2
    load(path, overrides=["grid.filters.PF.N=[10]"])  # a point that this time is not there


def test_numbers_below_zero_are_no_formulas(tmp_path: Path) -> None:
    (tmp_path / "p.csv").write_text(NUMBERS + "p,t,-1.5,m,-1.5,,\n")
    (tmp_path / "c.yaml").write_text(GOOD + "published: [p.csv]\ntitle: -1.5 dB\n")
    assert load(tmp_path / "c.yaml").published.numbers[0].value == -1.5


def test_values_of_set_are_read_as_in_a_file(tmp_path: Path) -> None:
    path = tmp_path / "c.yaml"
    path.write_text(GOOD + "bound: B\n")
    typed = ["only=[PF]", 'title=""', "bound=null", "filters.Q={kind: ukf, kappa: 1e-1}"]
    settings = load(path, overrides=typed).settings
    assert (settings.only, settings.title, settings.bound) == (["PF"], "", None)
    assert settings.filters["Q"] == {"kind": "ukf", "kappa": 0.1}
    assert load(path, overrides=["bound=null", "title=a: b # c"]).settings.title == "a: b # c"


def test_a_byte_that_is_no_character_is_named(tmp_path: Path) -> None:
    (tmp_path / "c.yaml").write_text(GOOD)
    with pytest.raises(UserError, match=r"'title=a\\udcff' holds the character U\+DCFF"):
        load(tmp_path / "c.yaml", overrides=["title=a\udcff"])


@pytest.mark.parametrize("what", ["/dev/null", "odd", "odd/below", "x" * 300])
def test_places_where_no_folder_can_be(tmp_path: Path, what: str) -> None:
    (tmp_path / "odd").symlink_to("nowhere")
    (tmp_path / "c.yaml").write_text(GOOD)
    with pytest.raises(UserError, match=r"^--out \S+: \S+(:| is) (a file, not|a link|file name)"):
        api.preview([tmp_path / "c.yaml"], api.Options(out=tmp_path / what))


def test_a_name_of_a_folder_that_is_too_long() -> None:
    for command in (api.plot, api.report, api.compare):
        with pytest.raises(UserError, match="there is no such folder"):
            command("x" * 300)


ODD = r"""name: odd
title: "$\\frac{$\N$"
runs: 2
scenario: MERWE
filters:
  nan: {kind: ekf}
  "$\\frac{$": {kind: ekf}
  "..": {kind: pf, N: 10}
  "e\u0301\u0301/目标": {kind: pf, N: 10}
grid: {filters.nan.kind: [ukf, ekf]}
tables:
  CON: {kind: metrics, title: "a\nb|c\Nd", columns: {"a|b\n$": rms(rmse)}}
figures:
  f: {kind: rmse-vs-time, log: true, title: "$\\frac{$", y_label: $x^2$, x_label: $5 or $\6}
  g: {kind: bars, log: true, title: 目标, metric: rms(rmse)}
""".replace("MERWE", merwe_text(T=3, R=1e308))


@pytest.fixture(scope="module")
def odd(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("odd")
    (folder / "c.yaml").write_text(ODD)
    api.run(folder / "c.yaml", OPTIONS, out=folder / "out")
    return folder / "out"


def test_odd_words_and_kinds_are_stored_as_they_are(odd: Path) -> None:
    assert parse((odd / "config.yaml").read_text(), "").data["title"] == "$\\frac{$\x85$"
    results = api.load(odd).results
    assert (
        set(results.summary["filter"]) == set(results.labels) == set(yaml.safe_load(ODD)["filters"])
    )
    assert all(("nan", "rmse") in results.runs(point) for point in results.points())


def test_odd_words_are_drawn_and_verified(odd: Path) -> None:
    assert len(api.plot(odd, formats=("png",))) == 2
    assert r"$\frac{$" in (odd / "figures" / "f.svg").read_text()  # as written: it is no formula
    assert [path.name for path in api.report(odd)] == ["report.html"]
    assert api.compare(odd).rows == []
    assert verify(odd, 2) == []


FAILS = '''from dataclasses import dataclass
from trackbench.registry import register


@register("filters", "always-fails")
@dataclass(frozen=True, kw_only=True)
class Fails:
    """Raises."""

    def init(self, model, prior, rng):
        raise RuntimeError("two\\n lines \\x1b[31m")

    def step(self, model, state, z, k, rng):
        return state

    def estimate(self, state):
        return state
'''


def test_figures_and_reasons_where_every_filter_fails(tmp_path: Path) -> None:
    (tmp_path / "fails.py").write_text(FAILS)
    kinds = ["rmse-vs-time", "rmse-vs-time, log: true", "rmse-per-run", "estimates", "bars"]
    kinds += ["bias, rows: {a: bias}", "rmse-vs-parameter, metric: mean(rmse)", "heat-map"]
    kinds += ["critical-difference"]
    figures = "".join(f"  f{i}: {{kind: {kind}}}\n" for i, kind in enumerate(kinds))
    text = GOOD.replace("kind: pf, N: 10", "kind: always-fails") + "plugins: [fails.py]\n"
    text += f"grid: {{scenario.sensor.R: [1, 2]}}\nfigures:\n{figures}"
    (tmp_path / "c.yaml").write_text(text)
    options = api.Options(engine="serial", quiet=True, formats=("svg",), allow_plugins=True)
    report = api.run(tmp_path / "c.yaml", options, out=tmp_path / "out")
    said = r"failed: fails.py:11: RuntimeError: two lines \x1b[31m (first state; runs 0 to 1)"
    assert report.failed[0] == f"PF at scenario.sensor.R = 1 {said}"
    assert len(api.plot(tmp_path / "out", formats=("svg",))) == 8  # of estimates there are none


def test_a_results_folder_with_other_things_in_it(odd: Path, tmp_path: Path) -> None:
    """Where a folder of figures is to be, a file; a manifest that is nested, or a pipe."""
    folder = shutil.copytree(odd, tmp_path / "out")
    shutil.rmtree(folder / "figures")
    (folder / "figures").write_text("")
    with pytest.raises(WriteError, match=r"cannot write .*/figures: file exists"):
        api.plot(folder)
    (folder / "manifest.json").write_text("[" * 100_000)
    with pytest.raises(UserError, match=r"manifest\.json cannot be read"):
        api.plot(folder)
    (folder / "manifest.json").unlink()
    os.mkfifo(folder / "manifest.json")
    with pytest.raises(UserError, match="is half-written"):
        api.plot(folder)
    remove_outputs(folder, keep=())  # does not wait for somebody to write into the pipe
    assert not (folder / "summary.csv").exists()


def test_a_folder_whose_name_is_not_utf_8(tmp_path: Path) -> None:
    folder = tmp_path / os.fsdecode(b"caf\xe9")
    try:
        folder.mkdir()
    except OSError:
        pytest.skip("this file system takes no such name")
    (folder / "c.yaml").write_text(GOOD)
    words = [sys.executable, "-m", "trackbench", "check", str(folder / "c.yaml")]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.endswith(r"caf\udce9/c.yaml: good, 1 filter" + "\n")
    (folder / "c.yaml").write_text(good_files(LISTS["scalar_recordings"])["c.yaml"])
    with pytest.raises(UserError, match=r"4:11: scenario.target: the name of a folder it lies in"):
        load(folder / "c.yaml")
