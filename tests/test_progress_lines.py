"""Lines of progress where stderr is no terminal."""

import pytest

from trackbench import progress_bar
from trackbench.progress_bar import _ProgressLines


def test_short_bars_one_after_the_other_print_lines(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A suite printed nothing for minutes, as the blocks of no problem took ten seconds."""
    now = [100.0]
    monkeypatch.setattr(progress_bar.time, "monotonic", lambda: now[0])
    monkeypatch.setattr(_ProgressLines, "_last_line_s", now[0])
    for name in ("a", "b", "c", "d"):
        with _ProgressLines(total=2, unit="block", desc=name) as bar:
            for _ in range(2):
                now[0] += 2.0
                bar.update()
    assert capsys.readouterr().err == "c: 1 of 2 blocks, 2 s\n"
    with _ProgressLines(total=10, unit="trial", desc="long") as bar:
        for _ in range(10):
            now[0] += 3.0
            bar.update()
    lines = capsys.readouterr().err.splitlines()
    assert lines[-1] == "long: 10 of 10 trials, 30 s"
    assert 7 <= len(lines) <= 10
