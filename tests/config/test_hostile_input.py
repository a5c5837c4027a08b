"""Input that is out to break something: a line with its place and exit code 2, or simply right."""

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from tests.config.test_malformed import assert_refused, check
from tests.papers import merwe_text
from trackbench import api
from trackbench.config.dump import as_yaml
from trackbench.config.load import load
from trackbench.errors import UserError, WriteError
from trackbench.results.folder_contents import remove_outputs
from trackbench.verify import verify
from trackbench.yaml_source import formula, parse

SCENARIO = merwe_text(T=3)
GOOD = f"name: x\nruns: 2\nscenario: {SCENARIO}\nfilters:\n  PF: {{kind: pf, N: 10}}\n"
RECORDED = (
    "{kind: tracking, target: {kind: measured, axes: 0, measurements: %s}, "
    "sensor: {kind: scalar, sigma: 1}, start: {kind: given, mean: [0], sigma: [1]}, "
    "assume: {motion: {kind: ar1, q: 1}}}"
)
OPTIONS = api.Options(engine="serial", quiet=True, formats=("svg",))


def refused(tmp_path: Path, text: str, **others: str) -> str:
    """What `check` says of a config, which must be refused, beside files of these stems."""
    for stem, content in others.items():
        (tmp_path / f"{stem}.csv").write_text(content)
    path = tmp_path / "c.yaml"
    path.write_text(text)
    code, out, err = check(path)
    assert_refused(code, out, err)
    assert all(re.match(r"\S+?:\d+:\d+: ", line) for line in err.splitlines()), err
    return err.replace(f"{tmp_path}/", "")


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("PF:", r'"P\ud800F":', r"5:3: filters: 'P\ud800F' holds the character U+D800"),
        ("runs: 2", r'title: "a\ud800"', r"2:8: title: 'a\ud800' holds the character U+D800"),
        ("runs: 2", r'title: "a\e[1m"', r"2:8: title: 'a\x1b[1m' holds the character U+001B"),
        ("runs: 2", f"title: {'x' * 10_001}", "2:8: title: has 10001 characters; a text has"),
        ("PF:", r'"a\Nb":', r"5:11: filters.a\x85b: 'a\x85b' is not one line of visible"),
        ("PF:", r'"a\Pb":', r"5:11: filters.a\u2029b: 'a\u2029b' is not one line of visible"),
        ("PF:", r'"a\nb":', r"5:11: filters.a\nb: 'a\nb' is not one line of visible"),
        (
            "PF:",
            '"=1+1":',
            "5:3: filters: '=1+1' begins with =, as a formula of a spreadsheet; put",
        ),
        ("PF:", '"-PF":', "5:3: filters: '-PF' begins with -, as a formula of a spreadsheet"),
        ("runs: 2", 'bound: "@B"', "2:8: bound: '@B' begins with @, as a formula of a spreadsheet"),
        ("N: 10", "n: 10", "5:18: filters.PF.n: unknown key; did you mean N?"),
    ],
)
def test_words_that_are_none(tmp_path: Path, old: str, new: str, expected: str) -> None:
    assert expected in refused(tmp_path, GOOD.replace(old, new))


def test_an_unknown_key_is_not_said_to_be_a_constant_of_the_class(tmp_path: Path) -> None:
    (line,) = refused(tmp_path, GOOD.replace("N: 10", "zzz: 1")).splitlines()
    assert "known: N, " in line
    assert "presets" not in line


def test_many_filters_are_not_too_many_values(tmp_path: Path) -> None:
    """2000 filters with a motion each have 20 000 values and more."""
    each = "{kind: ukf, assume: {motion: {kind: ar1, q: 1, phi: 1, drift: 0}}}"
    filters = "".join(f"  F{i}: {each}\n" for i in range(2000))
    assert len(parse(f"filters:\n{filters}", "c.yaml").data["filters"]) == 2000


def test_too_many_values_are_not_read_to_their_end(tmp_path: Path) -> None:
    text = GOOD + f"medians: [{','.join('a' * 400_000)}]\n"
    assert re.search(r"6:\d{6}: more than 100000 values\n", refused(tmp_path, text))


@given(
    st.dictionaries(st.text("ab \t\n\r\x85\u2028\u2029\ufeff:#-'\"\\{[!&*|>%@1e~._,"), st.text())
)
def test_any_words_can_be_written_and_read_again(words: dict[str, str]) -> None:
    try:
        again = parse(as_yaml(words), "again").data
    except UserError:  # a character that no file may hold, or a key that is a formula
        assert any(not word.isprintable() for word in words.values()) or any(map(formula, words))
    else:
        assert again == words


THINGS: dict[str, Callable[[Path], None]] = {
    "a device or a pipe": os.mkfifo,
    "a folder": Path.mkdir,
    "too many levels": lambda path: path.symlink_to(path.name),
    "no such file": lambda path: None,
}
PLACES = {
    "published": (GOOD + "published: [odd.py]\n", "c.yaml:6:12: published: cannot read "),
    "use": (GOOD.replace(SCENARIO, "odd.py"), "c.yaml:3:11: scenario: cannot read "),
    "data": (GOOD.replace(SCENARIO, RECORDED % "odd.py"), "odd.py:1:1: scenario: "),
    "plugin": (GOOD + "plugins: [odd.py]\n", "c.yaml:6:11: plugins.0: "),
}


@pytest.mark.parametrize("what", THINGS)
@pytest.mark.parametrize("place", PLACES)
def test_files_that_are_none(tmp_path: Path, place: str, what: str) -> None:
    text, expected = PLACES[place]
    THINGS[what](tmp_path / "odd.py")
    (tmp_path / "c.yaml").write_text(text)
    code, out, err = check(tmp_path / "c.yaml", "--allow-plugins")
    assert_refused(code, out, err)
    (line,) = err.replace(f"{tmp_path}/", "").splitlines()
    assert line.startswith(expected)
    assert what in line


@pytest.mark.parametrize("what", THINGS)
def test_configs_that_are_no_files(tmp_path: Path, what: str) -> None:
    THINGS[what](tmp_path / "c.yaml")
    code, out, err = check(tmp_path / "c.yaml")
    assert_refused(code, out, err)
    assert f"c.yaml:1:1: {'is ' * what.startswith('a ')}{what}" in err


def test_a_device_that_never_ends() -> None:
    code, out, err = check(Path("/dev/zero"))
    assert_refused(code, out, err)
    assert err == "/dev/zero:1:1: is a device or a pipe, not a file\n"


@pytest.mark.parametrize("cell", ["1_000", "١٢", "１", "0x1", "1e999", "inf", "1 0"])
def test_numbers_of_a_csv_that_are_none(tmp_path: Path, cell: str) -> None:
    rows = f"run,step,z\n0,2,1\n0,3,{cell}\n"
    err = refused(tmp_path, GOOD.replace(SCENARIO, RECORDED % "z.csv"), z=rows)
    assert f"z.csv:3:1: scenario: z: '{cell}' is not a" in err


def test_a_csv_without_line_breaks_is_not_read_into_memory(tmp_path: Path) -> None:
    with (tmp_path / "z.csv").open("wb") as file:
        file.truncate(10**12)  # a hole, which takes no room on the disk
    err = refused(tmp_path, GOOD.replace(SCENARIO, RECORDED % "z.csv"))
    assert "z.csv:1:1: scenario: is not a text file" in err


NUMBERS = "paper,table,filter,metric,value,label,expression\n"
CLAIMS = "paper,claim,left,expression,right,right_expression\n"
FACTORS = "paper,claim,left,expression,factor,right,point\n"
EQUAL = "paper,claim,left,expression,relation,factor,tolerance\n"
READINGS = "paper,table,filter,metric,value,label,reading,experiment\n"


@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        (
            "paper,table,filter,metric,value,value\np,t,f,m,1,2\n",
            "p.csv:1:1: value: there are two columns of this name",
        ),
        (NUMBERS + 'p,t,f,m,1,PF,"gain(mean(rmse), QF)"\n', "p.csv:2:14: expression: 'QF' is not"),
        (NUMBERS + "p,t,f,m,1,QF,mean(rmse)\n", "p.csv:2:11: label: 'QF' is not a filter here"),
        (NUMBERS + "p,t,f,m,1_0,PF,mean(rmse)\n", "p.csv:2:9: value: '1_0' is not"),
        (NUMBERS + "p,t,f,a\x07,1,PF,mean(rmse)\n", "p.csv:2:7: metric: 'a\\x07' holds the"),
        (CLAIMS + "p,c,PF,mean(rmse),PF,rmse@\n", "p.csv:2:22: right_expression: 'rmse@' is no"),
        (CLAIMS + "p,c,QF,rmse,QF,\n", "p.csv:2:13: right: 'QF' is not a filter here"),
        (NUMBERS + "p,t,f,=m,1,,\n", "p.csv:2:7: metric: '=m' begins with =, as a formula"),
        (CLAIMS + "p,+c,,,,\n", "p.csv:2:3: claim: '+c' begins with +, as a formula"),
        ("", "p.csv:1:1: there are no headings"),
        ("\n", "p.csv:1:1: there are no headings"),
        (FACTORS + "p,c,,mean(rmse),1,,\n", "p.csv:2:1: left: is empty"),
        (FACTORS + "p,,PF,mean(rmse),1,,\n", "p.csv:2:3: claim: is empty"),
        (FACTORS + "p,c,PF,mean(rmse),,,\n", "p.csv:2:1: factor: is empty, as right is"),
        (
            FACTORS + "p,c,PF,mean(rmse),1,,filters.PF.N=9\n",
            "p.csv:2:22: point: 'filters.PF.N=9' is",
        ),
        (FACTORS + "p,c,PF,mean(rmse),0,PF,\n", "p.csv:2:19: factor: 0 times the right side means"),
        (FACTORS + "p,c,PF,mean(rmse),-1,PF,\n", "p.csv:2:19: factor: -1 times the right side me"),
        (EQUAL + "p,c,PF,mean(rmse),~,0,1\n", "p.csv:2:21: factor: is 0, and `~` allows"),
        (EQUAL + "p,c,PF,mean(rmse),~,1,0\n", "p.csv:2:23: tolerance: is 0, and `~` allows"),
        (NUMBERS + "p,t,f,m,1,PF,mean(rmse)\np,t,f,m,1,PF,rms(rmse)\n", "p.csv:3:1: reading: an"),
        (NUMBERS + "p,t,f,m,1,PF,mean(rmse)\np,t,f ,m,1,PF,rms(rmse)\n", "p.csv:3:1: reading: an"),
        (NUMBERS + "p,t,f,m,1,PF,mean(rmse)\np,t,f,m,2,PF,rms(rmse)\n", "p.csv:3:9: value: is 2.0"),
        (READINGS + "p,t,f,m,1,PF,a,\np,t,f,m,1,PF,a,\n", "p.csv:3:14: reading: an earlier row"),
        (
            READINGS + "p,t,f,m,1,PF,,x\np,t,f,n,1,PF,,mewre2000\n",
            "'mewre2000'; did you mean merw",
        ),
        (
            READINGS + "p,t,f,m,1,PF,,x\np,t,f,n,1,PF,,besde\n",
            "experiment 'besde'; did you mean beside",
        ),
        (
            READINGS + "p,t,f,m,1,PF,,y\n",
            "published: no row is for experiment 'x'; the rows are for y",
        ),
    ],
)
def test_mistakes_in_a_published_file(tmp_path: Path, rows: str, expected: str) -> None:
    (tmp_path / "b.yaml").write_text(GOOD.replace("name: x", "name: beside"))
    assert expected in refused(tmp_path, GOOD + "published: [p.csv]\n", p=rows)


def test_a_published_nan_is_one_line(tmp_path: Path) -> None:
    err = refused(tmp_path, GOOD + "published: [p.csv]\n", p=NUMBERS + "p,t,f,m,NaN,,\n")
    what = "'NaN' is not a number and not one of biased or unbiased"
    assert err == f"p.csv:2:9: value: {what}\n"


def test_declared_readings_and_rows_for_experiments_elsewhere_are_accepted(tmp_path: Path) -> None:
    rows = "p,t,f,m,1, PF ,a,x\np,t,f,m,1,PF,b,x ; x2\np,t,g,m,1,QF,,hdepf;hdepf-9;elsewhere\n"
    (tmp_path / "p.csv").write_text(READINGS.replace(",label", ", label ") + rows)
    path = tmp_path / "c.yaml"
    path.write_text(GOOD + "published: [p.csv]\n")
    assert [row.labels for row in load(path).published.numbers] == [["PF"], ["PF"]]


def test_rows_that_mean_something_are_accepted(tmp_path: Path) -> None:
    (tmp_path / "p.csv").write_text(
        FACTORS + "p,nobody measures,,,,,\np,c,PF,rmse,2,,filters.PF.N=9\n"
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


@pytest.mark.parametrize(
    ("typed", "expected"),
    [
        ("only=[QF]", "only.0: 'QF' is not a filter here; did you mean PF?"),
        ("filters.PF={kind: pf, n: 1}", "filters.PF.n: unknown key; did you mean N?"),
        ("title=[", "title: not valid YAML: "),
        ("title=a\udcff", "'title=a\\udcff' holds the character U+DCFF"),
        ("only.²=PF", "only.²: no such item"),
    ],
)
def test_mistakes_in_what_is_set(tmp_path: Path, typed: str, expected: str) -> None:
    (tmp_path / "c.yaml").write_text(GOOD + "only: [PF]\n")
    with pytest.raises(UserError) as caught:
        load(tmp_path / "c.yaml", overrides=[typed])
    (line,) = str(caught.value).splitlines()
    assert expected in line


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
    kinds += ["bias, rows: {a: bias}", "rmse-vs-parameter, metric: mean(rmse)"]
    figures = "".join(f"  f{i}: {{kind: {kind}}}\n" for i, kind in enumerate(kinds))
    text = GOOD.replace("kind: pf, N: 10", "kind: always-fails") + "plugins: [fails.py]\n"
    text += f"grid: {{scenario.sensor.R: [1, 2]}}\nfigures:\n{figures}"
    (tmp_path / "c.yaml").write_text(text)
    options = api.Options(engine="serial", quiet=True, formats=("svg",), allow_plugins=True)
    report = api.run(tmp_path / "c.yaml", options, out=tmp_path / "out")
    said = r"failed: fails.py:11: RuntimeError: two lines \x1b[31m (runs 0 to 1)"
    assert report.failed[0] == f"PF at scenario.sensor.R = 1 {said}"
    assert len(api.plot(tmp_path / "out", formats=("svg",))) == 6  # of estimates there are none


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
    (folder / "c.yaml").write_text(GOOD.replace(SCENARIO, RECORDED % "z.csv"))
    with pytest.raises(UserError, match=r"3:36: scenario.target: the name of a folder it lies in"):
        load(folder / "c.yaml")
