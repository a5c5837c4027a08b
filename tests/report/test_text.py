"""Tables as Markdown and LaTeX."""

from trackbench import api
from trackbench.evaluation.statistics import Estimate
from trackbench.report.table import Cell, Table, rounded
from trackbench.report.text import Text, TextTable


def table():
    made = Table("Mean & spread of 100 %", ["Filter"], ["RMSE_x"], digits=4)
    made.add(["A & B_1"], [Cell(Estimate(0.5, 0.01), 100, 0)])
    made.add([r"\input{x} $y$ ~^<>"], [Cell(Estimate(float("nan"), float("nan")), 0, 100)])
    return made


def test_latex_has_booktabs_rules_and_no_live_character():
    text = table().texts().tex()
    for rule in (r"\toprule", r"\midrule", r"\bottomrule", r"\begin{tabular}{lrr}"):
        assert rule in text
    assert r"A \& B\_1 & 0.500 $\pm$ 0.010 & 0 of 100 (0 to 3.6 \%) \\" in text
    assert r"\textbackslash{}input\{x\} \$y\$ \textasciitilde{}\textasciicircum{}" in text
    assert r"\caption{Mean \& spread of 100 \%}" in text


def test_what_is_no_number_is_said_in_words():
    assert rounded(float("nan"), float("nan"), 4) == "–"
    assert rounded(float("-inf"), 1.0, 4) == "infinite"


def test_markdown_escapes_bars_and_tags():
    text = TextTable("t", ["a"], [[Text("x|y <b>")]]).markdown()
    assert r"| x\|y &lt;b> |" in text


def test_lost_runs_have_a_column_only_where_there_are_any():
    assert "100 of 100" in table().markdown()
    full = Table("", ["Filter"], ["RMSE"], 4)
    full.add(["A"], [Cell(Estimate(1.0, 0.1), 10, 0)])
    assert "Lost" not in full.markdown()


def test_a_run_writes_latex_on_request(folder, tmp_path):
    options = api.Options(
        engine="serial", quiet=True, out=tmp_path / "o", runs=4, only=["PF"], formats=("tex",)
    )
    api.run(folder / "config.yaml", options)
    assert r"\toprule" in (tmp_path / "o" / "tables" / "table1.tex").read_text()
    assert not (tmp_path / "o" / "figures").exists()
