"""Runs that are killed, damaged or starved: nothing finished is lost, nothing wrong is used."""

import os
import random
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest

from tests.commands import trackbench
from tests.papers import merwe_text
from trackbench import api
from trackbench.execution.engines import cpu_count
from trackbench.results.manifest import read_manifest

FILES = ("per_run.csv", "per_step.csv", "summary.csv")

CONFIG = """
name: long
seed: 3
runs: 200
block: 10
scenario: MERWE
filters:
  PF: {kind: pf, N: 20}
  HDEPF: {kind: hdepf, G: 40}
tables:
  errors: {kind: metrics, columns: {RMSE: mean(rmse)}}
figures: {}
""".replace("MERWE", merwe_text(T=20))


def write(folder: Path, text: str = CONFIG) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "long.yaml"
    path.write_text(text)
    return path


def start(config: Path, *words: str, **keys: object) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [sys.executable, "-m", "trackbench", "run", str(config), "--format", "png", *words],
        cwd=config.parent,
        env={**os.environ, "TRACKBENCH_CACHE": str(config.parent / "cache")},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        **{"preexec_fn": _heed_ctrl_c, **keys},
    )


def _heed_ctrl_c() -> None:
    """A shell's background job, as a suite may be, hands on that Ctrl-C is ignored."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def finish_here(config: Path) -> "tuple[int, str]":
    """In this process."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TRACKBENCH_CACHE", str(config.parent / "cache"))
        words = ("run", config, "--format", "png", "--workers", 1)
        done = trackbench(*words, cwd=config.parent)
    return done.returncode, done.stderr


def same_results(one: Path, other: Path) -> None:
    for name in FILES:
        assert (one / name).read_bytes() == (other / name).read_bytes(), name


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    config = write(tmp_path_factory.mktemp("undisturbed"))
    code, stderr = finish_here(config)
    assert code == 0, stderr
    return config.parent / "results" / "long"


def descendants(pid: int) -> list[int]:
    """Every process below ``pid``."""
    found = []
    for task in Path(f"/proc/{pid}/task").glob("*/children"):
        for child in map(int, task.read_text().split()):
            found += [child, *descendants(child)]
    return found


def command(pid: int) -> str:
    """Empty, if it has ended meanwhile."""
    with suppress(FileNotFoundError):
        return Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode()
    return ""


def workers(pid: int) -> list[int]:
    """Pool workers: children of the fork server, which the program itself started."""
    servers = [c for c in descendants(pid) if "forkserver" in command(c)]
    return [w for s in servers for w in descendants(s) if w not in servers] or servers[1:]


def kept_blocks(config: Path) -> int:
    return len(list((config.parent / "cache").rglob("*.block")))


def wait_for(condition: Callable[[], object], seconds: float = 30.0) -> None:
    until = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < until, "this did not happen in time"
        time.sleep(0.005)


def gone(pid: int) -> bool:
    """Whether the process has ended (a zombie that nobody waits for has, too)."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except OSError:
        return True


@pytest.mark.skipif(not Path("/proc").exists(), reason="looks for processes in /proc")
def test_kill_the_program_at_random_moments(undisturbed: Path, tmp_path: Path) -> None:
    config = write(tmp_path)
    for _ in range(2):
        process, before = start(config, "--workers", "2"), kept_blocks(config)
        wait_for(lambda p=process, n=before: kept_blocks(config) > n or p.poll() is not None)
        time.sleep(random.uniform(0.0, 0.3))
        below = descendants(process.pid)
        process.send_signal(signal.SIGKILL)
        process.communicate()
        wait_for(lambda below=below: all(gone(pid) for pid in below), 10)
    assert kept_blocks(config) > 0
    code, stderr = finish_here(config)
    assert code == 0, stderr
    same_results(config.parent / "results" / "long", undisturbed)
    assert not list((config.parent / "results").rglob("*.part"))


@pytest.mark.skipif(cpu_count() < 2, reason="needs worker processes")
def test_a_killed_worker_costs_nothing_but_time(undisturbed: Path, tmp_path: Path) -> None:
    config = write(tmp_path)
    process = start(config, "--workers", "2")
    wait_for(lambda: kept_blocks(config) > 3)
    for _ in range(2):
        # After a death there is none for a moment, while what it left behind is still being kept.
        wait_for(lambda: workers(process.pid) or process.poll() is not None)
        os.kill(workers(process.pid)[0], signal.SIGKILL)
        now = kept_blocks(config)
        wait_for(lambda now=now: kept_blocks(config) > now or process.poll() is not None)
    _, stderr = process.communicate(timeout=120)
    assert process.returncode == 0, stderr
    assert "a worker died" in stderr
    same_results(config.parent / "results" / "long", undisturbed)


@pytest.mark.parametrize(
    ("number", "workers"), [(signal.SIGINT, "1"), (signal.SIGINT, "2"), (signal.SIGTERM, "2")]
)
def test_an_interrupted_run_says_how_to_go_on(
    undisturbed: Path, tmp_path: Path, number: signal.Signals, workers: str
) -> None:
    config = write(tmp_path)
    process = start(config, "--fresh", "--workers", workers, start_new_session=True)
    wait_for(lambda: kept_blocks(config) > 3)
    # Ctrl-C reaches every process of the terminal, a polite kill only the program.
    target = os.killpg if number == signal.SIGINT else os.kill
    target(process.pid, number)
    stdout, stderr = process.communicate(timeout=10)
    assert process.returncode == 130
    command = f"trackbench run {config} --format png --workers {workers}"
    assert f"interrupted; finished blocks are kept, to go on: {command}\n" in stderr
    assert "Traceback" not in stdout + stderr
    kept = kept_blocks(config)
    code, stderr = finish_here(config)
    assert code == 0
    assert f"reused {kept} of 40 blocks" in stderr
    same_results(config.parent / "results" / "long", undisturbed)


def test_without_a_finished_block_nothing_is_said_to_be_kept(tmp_path: Path) -> None:
    text = CONFIG.replace("runs: 200\nblock: 10", "runs: 40000\nblock: 40000")
    config = write(tmp_path, text)
    process = start(config, "--fresh", "--workers", "1", start_new_session=True)
    wait_for(lambda: (tmp_path / "cache" / ".trackbench-cache").exists())
    time.sleep(0.5)
    os.killpg(process.pid, signal.SIGINT)
    _, stderr = process.communicate(timeout=10)
    assert process.returncode == 130
    assert kept_blocks(config) == 0
    # The command begins anew, as the first one did.
    command = f"trackbench run {config} --format png --fresh --workers 1"
    assert f"interrupted; to begin again: {command}\n" in stderr
    assert "kept" not in stderr


def test_an_early_ctrl_c_is_no_traceback(tmp_path: Path) -> None:
    """While the process that workers are forked from is still importing, too."""
    process = start(write(tmp_path), start_new_session=True)
    time.sleep(random.uniform(0.2, 1.0))
    os.killpg(process.pid, signal.SIGINT)
    stdout, stderr = process.communicate(timeout=10)
    assert process.returncode in (130, -signal.SIGINT)  # before Python hears signals, too
    assert "interrupted" in stderr or process.returncode != 130
    assert "Traceback" not in stdout + stderr


def small(folder: Path) -> Path:
    return write(folder, CONFIG.replace("runs: 200", "runs: 40").replace("T: 20", "T: 6"))


def quietly(config: Path, **options: object) -> api.Report:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TRACKBENCH_CACHE", str(config.parent / "cache"))
        out = config.parent / "out"
        return api.run(config, workers=1, quiet=True, formats=(), out=out, **options)


def truncate(content: bytes) -> bytes:
    return content[: len(content) // 2]


def flip(content: bytes) -> bytes:
    i = len(content) - 100
    return content[:i] + bytes([content[i] ^ 1]) + content[i + 1 :]


def flip_header(content: bytes) -> bytes:
    return content[:60] + bytes([content[60] ^ 4]) + content[61:]


def test_damaged_blocks_are_computed_again(tmp_path: Path) -> None:
    config = small(tmp_path)
    good = quietly(config).folder.rename(tmp_path / "good")
    blocks = sorted((tmp_path / "cache").rglob("*.block"))
    other = blocks[0].read_bytes()
    damages: list[Callable[[bytes], bytes]] = [
        *(truncate, flip, flip_header, lambda c: b"", lambda c: c[:10], lambda c: b"\x80" * len(c)),
        *(lambda c: c + b"x", lambda c: other),
    ]
    for block, damage in zip(blocks, damages, strict=False):
        block.write_bytes(damage(block.read_bytes()))
    again = quietly(config).folder
    same_results(again, good)
    assert read_manifest(again)["blocks"] == {"computed": 8, "reused": 0}
    quietly(config)
    assert read_manifest(again)["blocks"] == {"computed": 0, "reused": 8}


def test_another_version_of_the_code_and_fresh_compute_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from trackbench.execution import cache, clear_cache

    config = small(tmp_path)
    good = quietly(config).folder.rename(tmp_path / "good")
    monkeypatch.setattr(cache, "code_digest", lambda: "0" * 64)
    monkeypatch.setattr(clear_cache, "code_digest", lambda: "0" * 64)
    again = quietly(config).folder
    assert read_manifest(again)["blocks"] == {"computed": 8, "reused": 0}
    same_results(again, good)
    size = clear_cache.cache_size(tmp_path / "cache")
    assert (size.blocks.number, size.old_blocks.number) == (8, 8)
    clear_cache.clear_cache(tmp_path / "cache", old_only=True)
    size = clear_cache.cache_size(tmp_path / "cache")
    assert (size.blocks.number, size.old_blocks.number) == (8, 0)
    again = quietly(config, fresh=True).folder
    assert read_manifest(again)["blocks"] == {"computed": 8, "reused": 0}
    same_results(again, good)


def test_a_block_is_the_same_computed_and_read(tmp_path: Path) -> None:
    from trackbench.config.load import load
    from trackbench.evaluation.run_blocks_side_by_side import run_whole_block
    from trackbench.execution.block_file import decode, encode, pack
    from trackbench.execution.plan import make_plan

    experiment = load(small(tmp_path))
    for task in make_plan(experiment, save_tracks=True).unique[:2]:
        for result in run_whole_block(task).values():
            content = encode(pack(result), "key")
            read = decode(content, "key")
            assert read is not None
            assert encode(read, "key") == content
            assert decode(content, "other") is None
            of_another_format = b"TBBLOCK0" + content[8:]
            assert decode(of_another_format, "key") is None


def test_no_space_for_a_block(tmp_path: Path) -> None:
    """A limit on the size of files stands for a full disk: the write itself fails."""
    config = small(tmp_path)
    process = start(
        config,
        *("--workers", "2"),
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000)),
    )
    _, stderr = process.communicate(timeout=60)
    assert process.returncode == 1
    errors = [line for line in stderr.splitlines() if line.startswith("error: ")]
    assert len(errors) == 1
    assert "file too large" in errors[0]
    assert "Traceback" not in stderr
    assert finish_here(config)[0] == 0
    same_results(config.parent / "results" / "long", quietly(config).folder)


def test_no_space_for_the_results(tmp_path: Path) -> None:
    config = small(tmp_path)
    assert finish_here(config)[0] == 0
    table = tmp_path / "results" / "long" / "per_run.csv"
    good = table.read_bytes()
    _, most = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, most))
    try:
        code, stderr = finish_here(config)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))
    assert code == 1
    assert "error: cannot write results/long/per_run.csv: file too large" in stderr
    assert "Traceback" not in stderr
    assert not table.exists()  # deleted first: old tables do not stand beside new figures
    assert not (tmp_path / "results" / "long" / "manifest.json").exists()
    assert finish_here(config)[0] == 0
    assert table.read_bytes() == good  # from the blocks that were kept
    assert not list((tmp_path / "results").rglob("*.part"))


def test_two_runs_at_once_wait_for_each_other(undisturbed: Path, tmp_path: Path) -> None:
    config = write(tmp_path)
    first = start(config, "--workers", "1")
    wait_for(lambda: kept_blocks(config) > 0)
    code, stderr = finish_here(config)
    assert f"results/long/ is in use by process {first.pid}; waiting" in stderr
    assert "reused 40 of 40 blocks" in stderr
    first.communicate(timeout=60)
    assert (first.returncode, code) == (0, 0)
    same_results(config.parent / "results" / "long", undisturbed)
    assert not (config.parent / "results" / "long" / ".lock").exists()
