"""Files that are no text, no file or broken somewhere: a line, soon and in little memory."""

import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from tests.bad_input.test_bad_input import LISTS, MAIN, good_files
from tests.commands import trackbench
from tests.conftest import EXPERIMENT_FILES, EXPERIMENTS
from trackbench.yaml_source import parse

GOOD = good_files(LISTS["config"])[MAIN]
RECORDED = good_files(LISTS["scalar_recordings"])[MAIN]
SHIPPED = {name: path.read_text() for name, path in EXPERIMENT_FILES.items()}


def assert_refused(code: int, out: str, err: str) -> None:
    assert code == 2, (code, out, err)
    assert re.search(r"^\S.*:\d+:\d+: .", err, re.MULTILINE), err
    assert "Traceback" not in out + err
    assert "pydantic" not in err


WRONG = ["[1, [2]]", "{a: {b: 1}}", "null", ".nan", ".inf", "-.inf", '"1"', "-1e308", "true", "~x"]
BREAKS: dict[str, tuple[str, list[str]]] = {
    "unknown key": (r"^(\s*)[\w-]+: ?\S.*$", [r"\1bogus: 1\n\g<0>"]),
    "unknown key in braces": (r"\{(?=kind: )", ["{bogus: 1, "]),
    "wrong value": (r"(?<=\w: )-?[\d.]+(?:e-?\d+)?(?=[,}\s])", WRONG),
    "duplicate key": (r"^\s*[\w-]+: \S.*$", [r"\g<0>\n\g<0>"]),
    "tab": (r"^  +(?=\S)", [r"\t"]),
    "misspelt kind": (r"(?<=kind: )[\w-]+", [r"\g<0>x"]),
    "missing file": (r"\.yaml", [".yml"]),
    "without a key": (r"^(name|scenario):.*\n", [""]),
    "odd character": (r"(?s).", [re.escape(c) for c in "\0\x07}]{[:&*!|>%@`"]),
    "list for mapping": (r"^(filters|tables|figures):\n(?:[ \n].*\n?)*", [r"\1: [1, 2]\n"]),
    "cut": (r"(?s).", [""]),
}
"""Words of a config, one of which is replaced, and what takes their place; a cut takes the rest."""
ALWAYS_WRONG = {
    *("unknown key in braces", "duplicate key", "misspelt kind", "missing file", "without a key")
}
harmless: list[str] = []


@settings(
    max_examples=60,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.filter_too_much],
)
@given(st.sampled_from(sorted(SHIPPED)), st.sampled_from([*BREAKS]), st.integers(0, 10_000))
def test_a_broken_shipped_config(
    tmp_path_factory: pytest.TempPathFactory, name: str, how: str, n: int
) -> None:
    pattern, words = BREAKS[how]
    text = re.sub(r"^\s*#.*\n", "", SHIPPED[name], flags=re.MULTILINE)
    places = [*re.finditer(pattern, text, re.MULTILINE)]
    assume(places)
    place = places[n % len(places)]
    rest = "" if how == "cut" else text[place.end() :]
    experiments = tmp_path_factory.mktemp("broken")
    for neighbor in EXPERIMENTS.iterdir():
        (experiments / neighbor.name).symlink_to(neighbor)
    folder = experiments / "own"
    folder.mkdir()
    for part in EXPERIMENT_FILES[name].parent.iterdir():
        if part.is_dir():
            (folder / part.name).symlink_to(part)
    (folder / MAIN).write_text(text[: place.start()] + place.expand(words[n % len(words)]) + rest)
    done = trackbench("check", MAIN, cwd=folder)
    if done.returncode:
        assert_refused(done.returncode, done.stdout, done.stderr)
        return
    assert how not in ALWAYS_WRONG, (how, n)
    harmless.append(how)  # a cut at the end, a true for a true


def test_most_broken_configs_are_refused() -> None:
    assert len(harmless) < 20


ALIASES = "".join(
    f"{c}: &{c} [{', '.join([f'*{p}'] * 9)}]\n" for p, c in zip("abcdefgh", "bcdefghi", strict=True)
)
DOUBLED = "".join(
    f"{c}: &{c} {{p: *{p}, q: *{p}, r: *{p}}}\n"
    for p, c in zip("abcdefghijklm", "bcdefghijklmn", strict=True)
)
CONTENTS: dict[str, tuple[str | bytes, str]] = {
    "an alias bomb": ("a: &a [x, x, x, x, x, x, x, x, x]\n" + ALIASES + GOOD, "more than 100000"),
    "an alias bomb of mappings": ("a: &a {x: 1}\n" + DOUBLED, "more than 100000 values"),
    "deep lists": ("a: " + "[" * 5000 + "]" * 5000 + "\n", "is nested too deeply"),
    "deep mappings": ("".join(" " * i + "a:\n" for i in range(500)), "is nested too deeply"),
    "more than a megabyte": ("# " + "x" * 1_100_000 + "\n" + GOOD, "may have 1 MB at most"),
    "every byte": (bytes(range(256)), "is not a text file"),
    "nulls": (b"\0" * 1000, "not valid YAML"),
    "utf-16": (GOOD.encode("utf-16"), "is not a text file"),
    "latin-1": (
        GOOD.replace("name: x", "name: x\ntitle: é").encode("latin-1"),
        "is not a text file",
    ),
    "ten billion particles": (GOOD.replace("N: 10", "N: 10000000000"), "memory"),
    "a python object": (GOOD + "title: !!python/object/apply:os.system [touch ran]\n", "title"),
    "a use of itself": (GOOD.replace("{kind: ukf}", f"{{use: {MAIN}}}"), "in a circle"),
}


# The program as it is, in one folder after the other: exit code, largest memory so far.
MEASURED = """
import os, sys
from trackbench.cli.app import main

for folder in sys.argv[1:]:
    os.chdir(folder)
    sys.argv = ["trackbench", "run", "c.yaml"]
    try:
        main()
        code = 0
    except SystemExit as end:
        code = end.code
    status = open("/proc/self/status").read()
    print(code, status.partition("VmHWM:")[2].split()[0], flush=True)
    print("end of", folder, file=sys.stderr, flush=True)
"""


@pytest.mark.skipif(not Path("/proc").exists(), reason="reads its memory from /proc")
def test_contents_that_are_no_config_end_soon_and_in_little_memory(tmp_path: Path) -> None:
    folders = [tmp_path / what.replace(" ", "-") for what in CONTENTS]
    for folder, (content, _) in zip(folders, CONTENTS.values(), strict=True):
        folder.mkdir()
        (folder / MAIN).write_bytes(content if isinstance(content, bytes) else content.encode())
    done = subprocess.run(
        [sys.executable, "-c", MEASURED, *folders],
        capture_output=True,
        text=True,
        env={**os.environ, "TRACKBENCH_CACHE": str(tmp_path / "cache")},
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    errors = re.split(r"^end of .*\n", done.stderr, flags=re.MULTILINE)[:-1]
    expected = (words for _, words in CONTENTS.values())
    measured = done.stdout.splitlines()
    for folder, line, err, words in zip(folders, measured, errors, expected, strict=True):
        code, kilobytes = line.split()
        assert_refused(int(code), "", err)
        assert re.fullmatch(f".*{words}.*\n", err)
        assert int(kilobytes) < 500_000, folder
        assert [path.name for path in folder.iterdir()] == [MAIN]
    assert not (tmp_path / "cache").exists()


def test_too_many_values_are_not_read_to_their_end(tmp_path: Path) -> None:
    (tmp_path / MAIN).write_text(GOOD + f"medians: [{','.join('a' * 400_000)}]\n")
    done = trackbench("check", MAIN, cwd=tmp_path)
    assert done.returncode == 2
    assert re.fullmatch(r"c\.yaml:7:\d{6}: more than 100000 values\n", done.stderr)


def test_many_filters_are_not_too_many_values() -> None:
    """1000 filters with a motion each have 10 000 values and more."""
    each = "{kind: ukf, assume: {motion: {kind: ar1, q: 1, phi: 1, drift: 0}}}"
    filters = "".join(f"  F{i}: {each}\n" for i in range(1000))
    assert len(parse(f"filters:\n{filters}", MAIN).data["filters"]) == 1000


THINGS: dict[str, Callable[[Path], None]] = {
    "a device or a pipe": os.mkfifo,
    "a folder": Path.mkdir,
    "too many levels": lambda path: path.symlink_to(path.name),
    "no such file": lambda path: None,
}
PLACES = {
    "a published file": (GOOD + "published: [odd.py]\n", "c.yaml:7:12: published: cannot read "),
    "a used file": (re.sub("scenario: .*", "scenario: odd.py", GOOD), "c.yaml:3:11: scenario: "),
    "a recording": (RECORDED.replace("m.csv", "odd.py"), "odd.py:1:1: scenario: "),
    "a plugin": (GOOD + "plugins: [odd.py]\n", "c.yaml:7:11: plugins.0: "),
    "a config": (GOOD, "odd.py:1:1: "),
}


@pytest.mark.parametrize("thing", THINGS)
@pytest.mark.parametrize("place", PLACES)
def test_files_that_are_none(tmp_path: Path, place: str, thing: str) -> None:
    text, expected = PLACES[place]
    THINGS[thing](tmp_path / "odd.py")
    (tmp_path / MAIN).write_text(text)
    config = "odd.py" if place == "a config" else MAIN
    done = trackbench("check", config, "--allow-plugins", cwd=tmp_path)
    assert_refused(done.returncode, done.stdout, done.stderr)
    (line,) = done.stderr.replace(f"{tmp_path}/", "").splitlines()
    assert line.startswith(expected)
    assert thing in line


def test_a_device_that_never_ends() -> None:
    done = trackbench("check", "/dev/zero")
    assert_refused(done.returncode, done.stdout, done.stderr)
    assert done.stderr == "/dev/zero:1:1: is a device or a pipe, not a file\n"


@pytest.mark.parametrize("content", [b"\0\1\2", b"\xff\xfe\x00", None])
def test_recordings_that_are_no_text(tmp_path: Path, content: bytes | None) -> None:
    (tmp_path / MAIN).write_text(RECORDED)
    with (tmp_path / "m.csv").open("wb") as file:
        if content is None:
            file.truncate(10**12)  # a hole, which takes no room on the disk
        else:
            file.write(content)
    done = trackbench("check", MAIN, cwd=tmp_path)
    assert_refused(done.returncode, done.stdout, done.stderr)
    assert "m.csv:1:1: scenario: is not a text file" in done.stderr
