"""Turns that a user is unlikely to mean are noted before anything runs."""

from pathlib import Path

import pytest

from trackbench.config.experiment import cautions
from trackbench.config.load import load

TEXT = """
name: turn
scenario:
  kind: tracking
  last: 20
  target: TARGET
  assume: {motion: {kind: cwna, q: 1}}
  sensor: {kind: position, sigma: 10}
  start: {kind: gaussian, sigma: [10, 5, 10, 5]}
filters: {KF: {kind: kf}}
"""
LEGS = "{kind: legs, launch: {x: 0, y: 0, vx: SPEED, vy: 0}, legs: [{start: 5, end: 15, KEYS}]}"
CT = "{kind: driven, launch: {vx: 10}, motion: {kind: ct, turn_rate_deg_s: RATE, q: 0.1}}"


def _notes(folder: Path, target: str) -> list[str]:
    (folder / "turn.yaml").write_text(TEXT.replace("TARGET", target))
    return cautions(load(folder / "turn.yaml").points)


@pytest.mark.parametrize(
    ("speed", "keys", "words"),
    [
        ("10", "turn_rate_deg_s: 3", []),
        ("10", "turn_rate_deg_s: 3000", ["leg 1 turns by 3000 deg between two steps, 1 s apart"]),
        ("0", "turn_rate_deg_s: -9", ["leg 1 turns a target that stands still"]),
        ("0", "ax: 2", []),
    ],
)
def test_a_leg_is_noted(tmp_path: Path, speed: str, keys: str, words: list[str]) -> None:
    notes = _notes(tmp_path, LEGS.replace("SPEED", speed).replace("KEYS", keys))
    assert len(notes) == len(words)
    for note, word in zip(notes, words, strict=True):
        assert note.startswith(word)


@pytest.mark.parametrize(("rate", "noted"), [("3", False), ("-200", True), ("180", False)])
def test_a_driven_turn_is_noted(tmp_path: Path, rate: str, noted: bool) -> None:
    notes = _notes(tmp_path, CT.replace("RATE", rate))
    assert any("between two steps" in note for note in notes) == noted
