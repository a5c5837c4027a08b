"""Tables as Markdown and LaTeX."""

import shutil
import subprocess
from types import SimpleNamespace

import numpy as np
import pytest

from tests.conftest import PLANE
from trackbench import api
from trackbench.evaluation.metric_expression import measure
from trackbench.report.expressions import Evaluator
from trackbench.report.figures.heat_map import _z_text
from trackbench.report.findings.consistency_words import collapse_words
from trackbench.report.findings.ranking import rankings
from trackbench.report.markdown_table import Text, TextTable
from trackbench.report.rounded_numbers import in_tex, rounded, unsigned_zeros
from trackbench.report.table import Cell, Table
from trackbench.report.tables.best_marks import best_labels
from trackbench.report.tables.metrics import Metrics, _lost_notes
from trackbench.report.tables_and_figures import Results
from trackbench.statistics.estimates import RunEstimate, Share
from trackbench.statistics.sample_statistics import Estimate


def table():
    made = Table("Mean & spread of 100 %", ["Filter"], ["RMSE_x"], digits=4)
    made.add(["A & B_1"], [Cell(Estimate(0.5, 0.01), 100, 0)])
    made.add([r"\input{x} $y$ ~^<>"], [Cell(Estimate(float("nan"), float("nan")), 0, 100)])
    return made


def test_latex_has_booktabs_rules_and_no_live_character():
    text = table().texts().tex()
    columns = r"\begin{tabular}{l S[table-format=1.3(2)] r}"
    for rule in (r"\toprule", r"\midrule", r"\bottomrule", columns):
        assert rule in text
    assert r"A \& B\_1 & 0.500 +- 0.010 & 0 of 100 (0 to 3.6 \%) \\" in text
    assert (
        r"\{x\} \$y\$ \textasciitilde{}\textasciicircum{}\textless{}\textgreater{} & {all runs lost}"
        in text
    )
    assert r"Filter & {RMSE\_x} & Lost runs \\" in text
    assert "resizebox" not in text
    assert r"\textbackslash{}input\{x\} \$y\$ \textasciitilde{}\textasciicircum{}" in text
    assert r"\caption{Mean \& spread of 100 \%}" in text
    assert TextTable("σ ≤ λ²", ["µ"]).tex().count("$") == 8  # pdflatex has none of them in text


def test_formulas_in_heads_stay_latex():
    text = TextTable("t", [r"RMSE of $\hat{x}_k$, m & $5", "$ 5 and 6 $"]).tex()
    assert r"RMSE of $\hat{x}_k$, m \& \$5 & \$ 5 and 6 \$ \\" in text


def test_what_is_no_number_is_said_in_words():
    assert rounded(float("nan"), float("nan"), 4) == "–"
    assert rounded(float("-inf"), 1.0, 4) == "infinite"


def test_a_number_that_is_rounded_to_zero_has_no_sign():
    assert rounded(-0.001, 0.11, 4) == "0.00 ± 0.11"
    assert rounded(-1e-9, 1.0, 4) == "0.0 ± 1.0"
    assert in_tex(-0.001, 0.11, 4) == "0.00 +- 0.11"
    assert [_z_text(z) for z in (-0.04, 0.04, -0.06)] == ["0.0", "0.0", "\N{MINUS SIGN}0.1"]
    assert (
        unsigned_zeros("-0.0; +0.0; -0.1; +10.0; 1e-0.0; -0") == "0.0; 0.0; -0.1; +10.0; 1e-0.0; 0"
    )


def test_markdown_escapes_bars_and_tags():
    text = TextTable("t", ["a"], [[Text("x|y <b>")]]).markdown()
    assert r"| x\|y &lt;b> |" in text
    assert TextTable("", ["P | Q <b>"]).markdown().startswith(r"| P \| Q &lt;b> |")
    assert (
        TextTable("", ["![p](x)", "mean(rmse[a])"])
        .markdown()
        .startswith(r"| ![p]\(x) | mean(rmse[a]) |")
    )


def test_lost_runs_have_a_column_only_where_there_are_any():
    assert "100 of 100" in table().markdown()
    full = Table("", ["Filter"], ["RMSE"], 4)
    full.add(["A"], [Cell(Estimate(1.0, 0.1), 10, 0)])
    assert "Lost" not in full.markdown()


def test_a_run_writes_latex_on_request(folder, tmp_path):
    options = api.Options(
        engine="serial", quiet=True, out=tmp_path / "o", runs=4, only=["PF"], formats=("tex",),
        set=["figures={time: {kind: rmse-vs-time}}"],
    )  # fmt: skip
    api.run(folder / "config.yaml", options)
    text = (tmp_path / "o" / "tables" / "table1.tex").read_text()
    assert r"\toprule" in text
    assert r"\label{tab:small-table1}" in text
    assert (tmp_path / "o" / "figures" / "time.pdf").stat().st_size > 5000
    assert b"/Type3" not in (tmp_path / "o" / "figures" / "time.pdf").read_bytes()
    assert [p.suffix for p in api.plot(tmp_path / "o", ["tex"], ["time"])] == [".pdf"]


def test_latex_has_one_exponent_for_value_and_error():
    assert in_tex(5.96e-6, 9.9e-7, 3) == "5.96 +- 0.99 e-6"
    assert in_tex(1.2e-9, 3.4e-8, 3) == "0.1 +- 3.4 e-8"
    assert in_tex(2.5e7, float("nan"), 3) == "2.50 e7"
    assert in_tex(0.5, 0.01, 4) == "0.500 +- 0.010"


@pytest.mark.parametrize(("value", "stderr", "text"), [
    (1234567.8, 0.17, "1.235 e6"), (123456.0, 5000.0, "1.235 +- 0.050 e5"),
    (1.0012346, 1e-9, "1.001"), (2365.5, 0.5, "2366"), (999.96, 0.2, "1000"),
    (0.46410162, 3.2e-5, "0.4641"), (0.004099, 1.1e-5, "0.004099 +- 0.000011"),
    (9999.8, 0.2, "1.000 e4"), (12800.0, float("nan"), "12800"), (0.0, 0.0, "0.000"),
])  # fmt: skip
def test_latex_has_four_digits_and_no_error_below_them(value, stderr, text):
    assert in_tex(value, stderr, 4) == text


def test_a_table_in_latex_says_what_it_needs_and_compiles_alone(tmp_path):
    """It is a document of its own unless a document reads it."""
    made = Table("Errors", ["Filter"], ["RMSE", "Of some"], digits=4, best={(0, 0), (0, 1)})
    made.add(["A"], [Cell(Estimate(2365.5, 0.5), 9, 0), Cell(Estimate(1e-9, 1e-10), 5, 0)])
    some = Cell(Estimate(2.0, 0.1), 5, 0, suffix=" (5 of 9 runs)")
    made.add(["B"], [Cell(Estimate(-1.5, 0.1), 9, 0), some])
    text = made.texts().tex("small-errors")
    assert text.startswith(r"% In a paper: \usepackage{booktabs, siunitx}")
    assert text.count(r"\label{tab:small-errors}") == 1
    assert "l S[table-format=-4.2(2)] S[table-format=1.2(2)e-9]" in text
    assert r"A & \bfseries 2366 & \bfseries 1.00 +- 0.10 e-9 \\" in text
    assert r"B & -1.50 +- 0.10 & {\num{2.00 +- 0.10} (5 of 9 runs)} \\" in text
    assert "A number without a standard error has one below half of its last digit." in text
    if not shutil.which("pdflatex"):
        return
    (tmp_path / "table.tex").write_text(text)
    head = "\\documentclass{article}\n\\usepackage{booktabs, siunitx}\n\\begin{document}\n"
    (tmp_path / "paper.tex").write_text(f"{head}\\input{{table}}\n\\end{{document}}\n")
    for name in ("table", "paper"):
        words = ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", f"{name}.tex"]
        subprocess.run(words, cwd=tmp_path, check=True, capture_output=True, timeout=120)
        assert (tmp_path / f"{name}.pdf").stat().st_size > 5000


def test_latex_numbers_its_tables_by_itself_and_marks_the_best():
    made = Table("Table 2. Errors", ["R", "Filter"], ["RMSE", "N"], 3, best={(1, 0)})
    for R, label, value in (("1", "A", 2.0), ("1", "B", 1.0), ("1", "Bound", 0.5), ("2", "A", 0.9)):
        cell = Cell(Estimate(value, 0.1), 10, 0)
        made.add([R, label], [cell, cell])
    text = made.texts().tex("errors")
    assert r"\caption{Errors}" in text
    assert r"\label{tab:errors}" in text
    assert text.count(r"\bfseries") == 1
    assert r"1 & B & \bfseries 1.00 +- 0.10 & 1.00 +- 0.10 \\" in text


@pytest.mark.parametrize("text", ["mean(rmse)", "ratio(mean(rmse), PF)"])
def test_all_that_do_not_differ_significantly_from_the_best_are_marked(folder, tmp_path, text):
    results = Results(folder)
    evaluator = Evaluator(results, {})
    (standing,) = rankings(results)
    best = [c.label for c in standing.among_the_best]
    labels = [label for label in results.labels if label != "Exact"]
    assert best_labels(evaluator, labels, measure(text)) == best
    # A copy of the best with other noise of no mean is no worse; its double is.
    runs = evaluator.runs
    values = runs[best[0], "rmse"]
    noise = np.where(np.arange(len(values)) % 2, 0.1, -0.1)
    evaluator.__dict__["runs"] = {
        ("A", "rmse"): values, ("B", "rmse"): values + 0.001 + noise, ("C", "rmse"): 2.0 * values
    }  # fmt: skip
    assert best_labels(evaluator, ["A", "B", "C"], measure("mean(rmse)")) == ["A", "B"]


def test_the_best_is_marked_where_runs_have_no_values_and_never_of_a_gain(folder, tmp_path):
    results = Results(folder)
    evaluator, labels = Evaluator(results, {}), results.filters
    for text, number in {
        "rmse@last": 1, "cpu_s_per_run": 1, "win_rate(rmse, PF)": 0, "gain(mean(rmse), PF)": 0
    }.items():  # fmt: skip
        assert len(best_labels(evaluator, labels, measure(text))) == number
    table = Metrics(columns={"Mean": measure("mean(rmse)")}).table(results)
    assert table.best
    assert all(table.keys[row] != ["Exact"] for row, _ in table.best)  # the reference is no rival


def test_a_collapsed_run_is_counted_and_not_averaged(made):
    evaluator = Evaluator(Results(made), {})
    nees = np.ones(40)
    nees[:3] = 1e12
    evaluator.__dict__["runs"] = {("PF", "nees"): nees}
    words = {m: collapse_words(evaluator, measure(m).of("PF")) for m in ("anees", "mean(nees)")}
    assert set(words.values()) == {"collapsed in 3 of 40 runs"}
    assert collapse_words(evaluator, measure("median(nees)").of("PF")) == ""
    table = Table("", ["Filter"], ["ANEES"], 3)
    table.add(["PF"], [Cell.of(RunEstimate(7.5e10, 1e10, None, 40), words["anees"])])
    table.add(["KF"], [Cell.of(RunEstimate(1.0, 0.1, None, 40))])
    assert "| PF | collapsed in 3 of 40 runs |" in table.markdown()
    assert "e+10" not in table.texts().tex()
    assert table.csv_rows()[0][1] == 7.5e10  # the file keeps the number
    assert sum(note.startswith("A collapsed run") for note in table.notes) == 1
    # An infinite NEES of a covariance that is not positive definite is named so.
    first = np.full(40, np.nan)
    first[:2] = 17.0
    evaluator.__dict__["runs"] = {
        ("PF", "nees"): np.where(first > 0.0, np.inf, nees),
        ("PF", "first_indefinite_step"): first,
    }
    words_of_indefinite = collapse_words(evaluator, measure("anees").of("PF"))
    assert words_of_indefinite == "not positive definite in 2 of 40 runs"
    table.add(["C"], [Cell.of(RunEstimate(np.inf, np.nan, None, 40), words_of_indefinite)])
    assert sum("Joseph form" in note for note in table.notes) == 1


def test_one_lost_run_is_no_runs():
    codes = {("A", "lost"): np.array([0.0, 1.0, 2.0, 2.0])}
    results = SimpleNamespace(runs=lambda point: codes, point_heading=lambda point: "q = 1 m²/s³")
    notes = list(_lost_notes(results, {"q": 1}, ["A"]))
    assert notes[0].startswith("A at q = 1 m²/s³: 1 run lost because")
    assert notes[1].startswith("A at q = 1 m²/s³: 2 runs lost because")


def test_a_label_with_a_comma_is_quoted_in_a_sentence_about_it():
    codes = {("A, tuned", "lost"): np.array([0.0, 1.0])}
    results = SimpleNamespace(runs=lambda point: codes, point_heading=lambda point: "q = 1 m²/s³")
    (note,) = _lost_notes(results, {"q": 1}, ["A, tuned"])
    assert note.startswith("“A, tuned” at q = 1 m²/s³: 1 run lost because")


def test_an_error_keeps_a_digit_however_small():
    assert rounded(2293.6, 0.034, 4) == "2293.60 ± 0.03"
    assert rounded(-2293.4, 0.96, 4) == "-2293.4 ± 1.0"
    assert rounded(0.46410162, 3.2e-5, 4) == "0.46410 ± 0.00003"
    assert rounded(0.46410162, 1e-16, 4) == "0.4641 ± 0.0000"  # rounding, of equal values
    assert rounded(1234567.8, 0.17, 4) == "1.234568e+06 ± 1.7e-01"
    assert rounded(1.14e-3, 9.7e-8, 3) == "1.140000e-03 ± 9.7e-08"
    assert rounded(0.3164, 0.0123, 4) == "0.316 ± 0.012"
    assert rounded(1.0, 0.0, 4) == "1.000 ± 0.000"


def test_an_event_that_no_run_had_is_no_certainty():
    """``0.000 +- 0.000`` would be one."""
    no_run, some = (Share(events / 20, 0.1 * bool(events), None, 20) for events in (0, 4))
    made = Table("", ["Filter"], ["Strayed"], 4)
    made.add(["A"], [Cell.of(no_run)])
    made.add(["B"], [Cell.of(some)])
    assert "| A | 0 of 20 (0 to 17 %) |" in made.markdown()
    assert "| B | 0.20 ± 0.10 |" in made.markdown()
    assert r"A & {0 of 20 (0 to 17 \%)}" in made.texts().tex()


def test_a_row_of_a_comparison_counts_the_lost_runs_of_its_own_filter(tmp_path):
    """Of all runs, and not of those that both filters have; a note counts those of the other filter."""
    comparisons = "{R: 'ratio(rms(rmse_position), Far)', W: 'win_rate(rmse_position, Far)'}"
    (tmp_path / "lost.yaml").write_text(
        f"name: lost\nseed: 3\nruns: 30\n{PLANE}  score: {{lost_beyond: 5}}\n"
        "filters:\n  KF: {kind: kf}\n"
        "  Far: {kind: kf, assume: {sensor: {kind: position, sigma: 15}}}\n"
        "tables:\n  own: {kind: metrics, columns: {E: rms(rmse_position)}}\n"
        f"  compared: {{kind: metrics, columns: {comparisons}}}\n"
        "  differences: {kind: differences, against: Far, columns: {E: rmse_position}}\n"
        "  back: {kind: differences, against: KF, columns: {E: rmse_position}}\n"
    )
    options = api.Options(engine="serial", quiet=True, times=False, formats=())
    results = api.run(tmp_path / "lost.yaml", options, out=tmp_path / "out").results
    cells = {}
    for name, table in results.tables.items():
        rows = table.texts().rows
        cells[name] = {row[0].text: row[-1].text for row in rows}
    lost = {label: int((results.runs({})[label, "lost"] > 0).sum()) for label in ("KF", "Far")}
    assert 0 < lost["KF"] < lost["Far"]
    for label in ("KF", "Far"):
        assert cells["own"][label].startswith(f"{lost[label]} of 30 (")
        assert cells["compared"][label] == cells["own"][label]
    assert cells["differences"] == {"KF": cells["own"]["KF"]}
    assert cells["back"] == {"Far": cells["own"]["Far"]}
    (note,) = results.tables["differences"].notes
    assert note.startswith(f"Far: {lost['Far']} of 30 runs lost, which every difference leaves out")
