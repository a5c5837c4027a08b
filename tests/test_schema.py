"""The schema that editors get accepts what the program accepts, and refuses what it refuses."""

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, cast, get_args

import pytest
from jsonschema import Draft202012Validator

from tests.commands import trackbench
from tests.conftest import EXPERIMENT_FILES
from trackbench.help.json_schema import _definitions, schema
from trackbench.registry import Group, kinds
from trackbench.yaml_source import read


@pytest.fixture(scope="module")
def validator() -> Draft202012Validator:
    found = json.loads(json.dumps(schema()))
    Draft202012Validator.check_schema(found)
    return Draft202012Validator(found)


@pytest.mark.parametrize("path", EXPERIMENT_FILES.values(), ids=lambda p: p.stem)
def test_shipped_experiments_agree_with_it(validator: Draft202012Validator, path: Path) -> None:
    assert [e.message for e in validator.iter_errors(read(path).data)] == []


SENSOR = {"kind": "square-then-line", "R": 1.0}
GOOD: dict[str, Any] = {
    "name": "x",
    "scenario": {
        "kind": "tracking",
        "last": 5,
        "target": {"kind": "driven", "motion": {"kind": "sine-gamma"}},
        "sensor": SENSOR,
        "start": "known",
    },
    "filters": {"PF": {"kind": "pf", "N": 10}, "H": {"kind": "hdepf", "preset": "literal"}},
}


@pytest.mark.parametrize(
    "change",
    [
        {"filters": {"PF": {"kind": "pf", "N": 0}}},
        {"filters": {"PF": {"kind": "pf", "NN": 1}}},
        {"filters": {"PF": {"kind": "nothing"}}},
        {"filters": {"PF": {"kind": "hdepf", "preset": "nothing"}}},
        {"scenario": {"kind": "merwe", "T": 5}},
        {"scenario": {"sensor": SENSOR | {"R": -1}}},
        {"scenario": {"sensor": SENSOR | {"r": 1}}},
        {"scenario": {"target": {"kind": "driven", "motion": {"kind": "cv"}}}},
        {"filters": {"EKF": {"kind": "ekf", "assume": {"motion": {"kind": "cv", "Q": 1}}}}},
        {"filters": {"EKF": {"kind": "ekf", "assume": {"motions": "cv"}}}},
        {"scenario": {"kind": "recorded", "measurements": "m.csv"}},
        {"scenario": 3},
        {"runs": "many"},
        {"bogus": 1},
    ],
)
def test_mistakes_do_not(validator: Draft202012Validator, change: dict[str, Any]) -> None:
    assert not list(validator.iter_errors(GOOD))
    if isinstance(change.get("scenario"), dict) and "kind" not in change["scenario"]:
        change = {"scenario": GOOD["scenario"] | change["scenario"]}
    assert list(validator.iter_errors(GOOD | change))


def test_every_key_has_a_description_and_every_kind_is_there() -> None:
    found = schema()["$defs"]
    for group in get_args(Group):
        for kind in kinds(group):
            for key, keys in found[f"{group}.{kind}"]["properties"].items():
                assert key == "kind" or keys.get("description"), f"{group}.{kind}.{key}"
    assert found["filters.pf"]["properties"]["N"]["default"] == 100


def test_the_command() -> None:
    done = trackbench("schema")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["properties"] == json.loads(json.dumps(schema()))["properties"]
    assert found["$defs"]["filters.pf"]["title"] == "pf"


@dataclass(frozen=True, kw_only=True)
class OfPresets:
    """Filter with presets and a key called as a keyword of JSON Schema."""

    presets: ClassVar[dict[str, dict[str, object]]] = {"strict": {"required": True}}

    gain: float
    """gain, which a preset may set"""
    required: bool = False
    """whether a measurement is required"""
    limits: dict[str, float] = field(default_factory=lambda: {"oneOf": 1.0})
    """limits by name"""


def test_a_key_called_as_a_keyword_stays_in_a_kind_with_presets() -> None:
    found = _definitions("filters", "of-presets", cast(Any, OfPresets))["filters.of-presets"]
    assert found["required"] == ["kind"]
    assert found["properties"]["required"]["type"] == "boolean"
    assert found["properties"]["limits"].get("default", {"oneOf": 1.0}) == {"oneOf": 1.0}
