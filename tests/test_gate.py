"""`trackbench gate` in a real repository, as docs/your-filter-in-ci.md shows it."""

import json
import re
import shlex
import subprocess
from pathlib import Path

import pytest
import yaml

from docs.site.blocks import blocks
from tests.commands import trackbench
from tests.conftest import PLANE, ROOT
from trackbench import api
from trackbench.statistics.student_t import t_of_normal

PAGE = blocks((ROOT / "docs" / "your-filter-in-ci.md").read_text(encoding="utf-8"))
TUNED = "sigma: Positive = 20.0", "sigma: Positive = 60.0"
AUTHOR = ("-c", "user.name=a", "-c", "user.email=a@example.org")


def git(folder: Path, *words: str) -> str:
    command = ["git", "-C", str(folder), *AUTHOR, *words]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


@pytest.fixture(scope="module")
def repository(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page's repository with its two commits; the second one makes the filter worse."""
    home = tmp_path_factory.mktemp("repository") / "filter"
    home.mkdir()
    for command in PAGE[0].commands:
        program, *words = shlex.split(command)
        if program == "git":
            git(home, *words)
        else:
            assert trackbench(*words, cwd=home).returncode == 0
    text = (home / "my_own.py").read_text()
    assert TUNED[0] in text
    (home / "my_own.py").write_text(text.replace(*TUNED))
    git(home, "commit", "--all", "--message=Trust measurements less")
    git(home, "branch", "old", "HEAD~1")
    return home


def gate(folder: Path, *words: object, code: int) -> str:
    done = trackbench("gate", "my_own.yaml", *words, "--workers", 1, cwd=folder)
    assert done.returncode == code, done.stderr + done.stdout
    if code == 2:
        return done.stderr
    return done.stdout


def test_a_worse_commit_fails_and_an_equal_one_passes(repository: Path) -> None:
    before = git(repository, "status", "--porcelain"), git(repository, "worktree", "list")
    out = gate(repository, "--against-ref", "old", "--allow-plugins", "--md", "g.md", code=1)
    assert out.startswith("my-own is worse: ")
    assert [line.split() for line in out.splitlines()] == [
        line.split() for line in PAGE[2].text.replace("main", " old").splitlines()
    ]
    comment = (repository / "g.md").read_text()
    assert comment.startswith("**my-own is worse: ")
    assert re.search(r"\| my-own \| rmse_position \(m\) \| .* \| worse \|", comment)
    assert "KF, IMM: unchanged in all compared numbers." in comment.splitlines()
    (repository / "g.md").unlink()
    unchanged = gate(repository, "--against-ref", "HEAD", "--allow-plugins", "--md", "g.md", code=0)
    assert unchanged.splitlines()[0] == PAGE[3].text.strip()
    assert len((repository / "g.md").read_text().splitlines()) <= 3
    (repository / "g.md").unlink()
    assert before == (git(repository, "status", "--porcelain"), git(repository, "worktree", "list"))


def test_the_page_explains_the_z_of_its_first_row(repository: Path) -> None:
    """Ratio to the standard error, its correction for skewness, and the degrees of freedom."""
    out = gate(repository, "--against-ref", "old", "--allow-plugins", "--json", code=1)
    rows = [json.loads(line) for line in out.splitlines()]
    row = next(r for r in rows if (r["filter"], r["metric"]) == ("my-own", "rmse_position"))
    corrected = t_of_normal(row["z"], freedom=row["runs"] - 1)
    page = " ".join((ROOT / "docs" / "your-filter-in-ci.md").read_text(encoding="utf-8").split())
    ratio = f"{row['difference'] / row['stderr']:.0f}"
    assert f"the difference is {ratio} times its standard error, but `z` is {row['z']:.1f}" in page
    assert f"turns {ratio} into {round(corrected / 1000)} 000" in page
    assert f"Student's t has {row['runs'] - 1} degrees of freedom" in page
    # Numbers without a row, because both versions have the same.
    for metric in ("lost", "diverged"):
        values = [(r["a"], r["b"]) for r in rows if r["metric"] == metric]
        assert values == [(0.0, 0.0)] * 4


def test_the_page_names_the_filters_of_the_config(repository: Path) -> None:
    config = yaml.safe_load((repository / "my_own.yaml").read_text())
    page = (ROOT / "docs" / "your-filter-in-ci.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `([^`]+)` \| (?:your|trackbench's) ", page, re.MULTILINE)
    assert rows == [*config["filters"]]
    default_q = re.search(r"q: Positive = (\S+)", (repository / "my_own.py").read_text())
    assert default_q is not None
    assert config["filters"]["my-own, q = 10"]["q"] == 10.0 * float(default_q[1])
    assert f"has {config['runs']} runs" in page


def test_the_workflow_of_the_page_runs_the_gate(repository: Path) -> None:
    """Its step is the command that fails, against the branch that the pull request is for."""
    workflow = yaml.safe_load(next(b.text for b in PAGE if b.language == "yml"))
    steps = workflow["jobs"]["gate"]["steps"]
    (command,) = (s["run"] for s in steps if "trackbench gate" in s.get("run", ""))
    words = shlex.split(command.replace("origin/${{ github.base_ref }}", "old"))
    done = trackbench(*words[1:], cwd=repository)
    assert done.returncode == 1, done.stderr
    assert sum("gate.md" in s.get("run", "") for s in steps) == 3  # written, summed up, sent
    (repository / "gate.md").unlink()


def test_against_stored_results(repository: Path, tmp_path: Path) -> None:
    """A folder, or the folder of the experiments' folders; a filter of another file beside."""
    few = ("--allow-plugins", "--workers", 1, "--runs", 20)
    main = tmp_path / "main"
    words = ("run", "my_own.yaml", *few, "--set", "figures={}", "--out", main / "my-own")
    assert trackbench(*words, cwd=repository).returncode == 0
    few = ("--against", main, "--allow-plugins", "--runs", 20)
    gate(repository, *few, code=0)
    text = (repository / "my_own.py").read_text()
    edited = text.replace("= 60.0", "= 90.0")
    (repository / "my_own.py").write_text(edited)
    assert "my-own is worse" in gate(repository, *few, code=1)
    gate(repository, *few, "--worse", "3sigma,300%", "--only", "my-own", code=0)
    found = [json.loads(line) for line in gate(repository, *few, "--json", code=1).splitlines()]
    assert {row["verdict"] for row in found if row["filter"] == "KF"} == {"equal"}
    broken = edited.replace("return self.x, self.P", "raise ValueError('no')")
    (repository / "my_own.py").write_text(broken)
    assert "my-own failed: my_own.py:" in gate(repository, *few, code=1)
    (repository / "my_own.py").write_text(text)


@pytest.mark.parametrize(
    ("line", "word"), [("    deterministic = True\n", "worse"), ("", "untested")]
)
def test_a_recording_judges_a_filter_for_one_run_that_is_deterministic(
    line: str, word: str, tmp_path: Path
) -> None:
    """By the line of docs/your-filter-in-ci.md in the class that `new filter --per-run` writes."""
    rows = [f"{t},{5 * t + (-1) ** t},{3 * t - t % 3}" for t in range(1, 40)]
    (tmp_path / "r.csv").write_text("time,x,y\n" + "\n".join(rows) + "\n")
    (tmp_path / "r.yaml").write_text(
        "name: r\nseed: 1\nscenario:\n  kind: tracking\n"
        "  target: {kind: measured, measurements: r.csv}\n"
        "  sensor: {kind: position, sigma: 2}\n  start: two-scan\n"
        "  assume: {motion: {kind: cwna, q: 1}}\nfilters: {KF: {kind: kf}}\n"
    )
    assert trackbench("new", "filter", "my-own", "--per-run", cwd=tmp_path).returncode == 0
    file = tmp_path / "my_own.py"
    text = file.read_text()
    head = '"""One line for `trackbench list`: the Kalman filter of straight flight."""\n'
    assert head in text
    file.write_text(text.replace(head, f"{head}\n{line}"))
    words = ("r.yaml", "--filter", file, "--workers", 1)
    done = trackbench("run", *words, "--out", "main/r", "--set", "figures={}", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    file.write_text(file.read_text().replace("= 20.0", "= 500.0"))
    done = trackbench("gate", *words, "--against", "main", "--json", cwd=tmp_path)
    found = [json.loads(line) for line in done.stdout.splitlines()]
    words_on_filter = {row["verdict"] for row in found if row["filter"] == "my-own"}
    assert words_on_filter == {word, "equal"}, done.stdout  # no run is lost on either side
    assert done.returncode == int(word == "worse")


@pytest.mark.parametrize(
    ("words", "what"),
    [
        (("--against-ref", "nowhere"), "--against-ref nowhere: "),
        (("--against", "nowhere"), "nowhere: there is no such folder"),
        (("--against-ref", "old", "--worse", "much"), "--worse much: is no limit such as 3sigma"),
        (("--against-ref", "old", "--filter", "no.py"), "--filter no.py: "),
        (("--against-ref", "old", "--only", "Nobody"), "'Nobody' is not a filter here"),
    ],
)
def test_mistakes_are_one_line(repository: Path, words: tuple[str, ...], what: str) -> None:
    text = gate(repository, *words, "--allow-plugins", code=2)
    assert what in text
    assert text.count("\n") == 1


def test_a_revision_without_the_file_is_said(repository: Path) -> None:
    git(repository, "checkout", "--orphan", "empty", "--quiet")
    git(repository, "rm", "--cached", "-r", "--quiet", ".")
    git(repository, "commit", "--allow-empty", "--message=Nothing")
    git(repository, "checkout", "--force", "--quiet", "main")
    text = gate(repository, "--against-ref", "empty", "--allow-plugins", code=2)
    assert text == "--against-ref empty: has no file my_own.yaml\n"


def test_costs_are_compared_on_one_machine_beyond_the_ratio(tmp_path: Path) -> None:
    """Evaluations grow with the particles; CPU times of another machine are no cost."""
    (tmp_path / "c.yaml").write_text(
        f"name: c\nseed: 1\nruns: 10\nblock: fit\n{PLANE}filters: {{PF: {{kind: pf, N: 50}}}}\n"
        "tables: {cost: {kind: metrics, columns: {Time: cpu_s_per_run}}}\n"
    )
    options = api.Options(engine="serial", quiet=True, formats=())
    stored = api.run(tmp_path / "c.yaml", options, out=tmp_path / "out").folder
    machine = stored / "run" / "machine.json"
    facts = json.loads(machine.read_text())
    words = ("c.yaml", "--against", stored, "--workers", 1, "--set", "filters.PF.N=500")
    assert "likelihoods" not in trackbench("gate", *words, cwd=tmp_path).stdout
    here = trackbench("gate", *words, "--cost", 3, cwd=tmp_path)
    assert here.returncode == 1
    assert "likelihoods of PF (+900 %)" in here.stdout
    assert "cpu_s_per_run" in trackbench("gate", *words, "--cost", 0.01, cwd=tmp_path).stdout
    machine.write_text(json.dumps(facts | {"processor": "another"}))
    elsewhere = trackbench("gate", *words, "--cost", 0.01, cwd=tmp_path)
    assert "cpu_s_per_run" not in elsewhere.stdout
    assert trackbench("gate", *words, "--cost", 20, cwd=tmp_path).returncode == 0


def test_a_filter_that_fails_fails_the_gate_unless_it_failed_before(tmp_path: Path) -> None:
    """By a program that is ready, and ends at the first run."""
    config = f"name: c\nseed: 1\nruns: 10\n{PLANE}filters:\n  KF: {{kind: kf}}\n"
    (tmp_path / "c.yaml").write_text(f"{config}  Old: {{kind: ekf}}\n")
    options = api.Options(engine="serial", quiet=True, formats=(), allow_plugins=True)
    stored = api.run(tmp_path / "c.yaml", options, out=tmp_path / "out").folder
    words = ("c.yaml", "--against", stored, "--workers", 1, "--allow-plugins")
    broken = "{kind: external, command: [sh, -c, 'read line; echo ready']}"
    (tmp_path / "c.yaml").write_text(f"{config}  Old: {{kind: ekf}}\n  New: {broken}\n")
    new = trackbench("gate", *words, cwd=tmp_path)
    assert new.returncode == 1
    assert "New failed: " in new.stdout
    both_fail = api.run(tmp_path / "c.yaml", options, out=tmp_path / "failed").folder
    again = trackbench(*("gate", "c.yaml", "--against", both_fail, *words[3:]), cwd=tmp_path)
    assert again.returncode == 0, again.stdout + again.stderr
    assert "New: failed in the earlier results, not compared" in again.stdout.splitlines()
    (tmp_path / "c.yaml").write_text(f"{config}  Old: {broken}\n")
    old = trackbench("gate", *words, cwd=tmp_path)
    assert old.returncode == 1
    assert "Old failed: " in old.stdout
    lines = trackbench("gate", *words, "--json", cwd=tmp_path).stdout.splitlines()
    failed = json.loads(lines[-1])
    assert (failed["filter"], failed["verdict"]) == ("Old", "failed")
    assert failed["reason"]


STILL = """
from trackbench.adapters import PerRun


class Still(PerRun, kind="still"):
    loses: bool = False

    def start(self, mean, cov):
        self.mean, self.cov = mean, cov

    def step(self, z, dt):
        return self.mean * (float("nan") if self.loses else 1.0), self.cov
"""


def test_a_filter_that_loses_every_run_fails_the_gate(tmp_path: Path) -> None:
    """With five runs the share of lost runs is not significantly larger (p = 0.03)."""
    (tmp_path / "still.py").write_text(STILL)
    config = f"name: c\nseed: 1\nruns: 5\nplugins: [still.py]\n{PLANE}filters:\n"
    path = tmp_path / "c.yaml"
    path.write_text(config + "  Still: {kind: still}\n")
    options = api.Options(engine="serial", quiet=True, formats=(), allow_plugins=True)
    stored = api.run(path, options, out=tmp_path / "out").folder
    path.write_text(config + "  Still: {kind: still, loses: true}\n")
    words = ("gate", "c.yaml", "--workers", 1, "--allow-plugins", "--against")
    done = trackbench(*words, stored, cwd=tmp_path)
    assert done.returncode == 1, done.stdout + done.stderr
    assert "Still failed: every run is lost" in done.stdout
    lost = api.run(path, options, out=tmp_path / "lost").folder
    again = trackbench(*words, lost, cwd=tmp_path)
    assert "failed" not in again.stdout


def test_a_filter_may_fail_again_at_a_point_where_it_failed_before(tmp_path: Path) -> None:
    """At another point of the grid it may not."""
    (tmp_path / "f.py").write_text(
        "from trackbench.adapters import PerRun\n\n\n"
        'class Limited(PerRun, kind="limited"):\n'
        '    """It stays where it is, and fails if q is large."""\n\n'
        "    q: float = 1.0\n"
        '    """any number"""\n\n'
        "    def start(self, mean, cov):\n"
        "        self.x, self.P = mean, cov\n\n"
        "    def step(self, z, dt):\n"
        "        if self.q > 5.0:\n"
        "            raise ValueError('too large')\n"
        "        return self.x, self.P\n"
    )
    config = f"name: c\nseed: 1\nruns: 10\nplugins: [f.py]\n{PLANE}"
    config += "filters: {L: {kind: limited}}\ngrid: {filters.L.q: [1, 10]}\n"
    (tmp_path / "c.yaml").write_text(config)
    options = api.Options(engine="serial", quiet=True, formats=(), allow_plugins=True)
    stored = api.run(tmp_path / "c.yaml", options, out=tmp_path / "out").folder
    words = ("c.yaml", "--against", stored, "--workers", 1, "--allow-plugins")
    again = trackbench("gate", *words, cwd=tmp_path)
    assert again.returncode == 0, again.stdout + again.stderr
    lines = again.stdout.splitlines()
    assert "L, q = 10: failed in the earlier results, not compared" in lines
    (tmp_path / "f.py").write_text((tmp_path / "f.py").read_text().replace("5.0", "0.0"))
    worse = trackbench("gate", *words, cwd=tmp_path)
    assert worse.returncode == 1
    assert worse.stdout.startswith("c is worse: L failed: f.py:")


def test_a_filter_of_a_file_joins_a_config_without_plugins(
    repository: Path, tmp_path: Path
) -> None:
    """At the revision it is read, too; an added filter is a note, and a removed one a failure."""
    text = (repository / "my_own.yaml").read_text()
    config = re.sub(r'  my-own: .*\n|  "my-own, q = 10": .*\n|plugins: .*\n', "", text)
    (repository / "plain.yaml").write_text(config.replace("runs: 50", "runs: 10"))
    git(repository, "add", "plain.yaml")
    git(repository, "commit", "--message=A config without the filter")
    words = ("gate", "plain.yaml", "--against-ref", "HEAD", "--workers", 1)
    out = trackbench(*words, "--filter", "my_own.py", cwd=repository)
    assert out.stdout.splitlines()[-1] == "KF, IMM, my-own: unchanged in all compared numbers."
    new = repository / "new_one.py"
    new.write_text((repository / "my_own.py").read_text().replace("my-own", "new-one"))
    out = trackbench(*words, "--filter", new, cwd=repository)
    assert (out.returncode, out.stdout.splitlines()[-1]) == (0, "new-one: new, not compared")
    new.unlink()
    (repository / "plain.yaml").write_text(config.replace("  KF:", "  Kalman:"))
    out = trackbench(*words, "--runs", 10, cwd=repository)
    assert out.returncode == 1, out.stderr
    lines = out.stdout.splitlines()
    assert lines[0] == "my-own is incomplete: removed KF"
    assert lines[-2:] == ["IMM: unchanged in all compared numbers.", "Kalman: new, not compared"]
    found = trackbench(*words, "--runs", 10, "--json", cwd=repository).stdout.splitlines()
    removed = {"point": None, "filter": "KF", "metric": None, "verdict": "removed", "reason": ""}
    assert json.loads(found[-1]) == removed
    out = trackbench(*words, "--runs", 10, "--allow-removed", cwd=repository)
    assert out.returncode == 0, out.stderr
    lines = out.stdout.splitlines()
    assert lines[0] == "my-own is unchanged: IMM"
    assert lines[-2:] == ["Kalman: new, not compared", "KF: removed"]
    # Numbers and points of the grid that are gone are no pass either.
    (repository / "plain.yaml").write_text(
        config + "metrics: [rmse_position, rmse_velocity, nees, anees]\n"
    )
    out = trackbench(*words, "--runs", 10, cwd=repository)
    assert out.returncode == 1, out.stderr
    assert "removed rmse_x of KF" in out.stdout.splitlines()[0]
    found = trackbench(*words, "--runs", 10, "--json", cwd=repository).stdout.splitlines()
    lines_of_removed = [line for line in map(json.loads, found) if line["verdict"] == "removed"]
    assert removed | {"metric": "rmse_x"} in lines_of_removed
    git(repository, "reset", "--hard", "--quiet", "HEAD~1")
