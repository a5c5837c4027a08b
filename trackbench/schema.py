"""The JSON Schema of an experiment file, for editors: completion, descriptions, defaults."""

from typing import Any

from trackbench.experiment.definition import Settings
from trackbench.experiment.validate import described, help_texts
from trackbench.registry import Group, kinds

_GROUPS: tuple[Group, ...] = ("scenarios", "filters", "tables", "figures")


def schema() -> dict[str, Any]:
    """Draft 2020-12 schema: the top level, and every registered kind with its keys."""
    top = described(Settings).json_schema(ref_template="#/$defs/{model}")
    definitions: dict[str, Any] = top.pop("$defs", {})
    for group in _GROUPS:
        names = []
        for kind, cls in kinds(group).items():
            names.append(f"{group}.{kind}")
            definitions |= _definitions(group, kind, cls)
        definitions[group] = {"anyOf": [*_ELSEWHERE, *({"$ref": _ref(name)} for name in names)]}
    properties = top["properties"]
    _replace(properties, "scenario", {"$ref": _ref("scenarios")})
    for group in _GROUPS[1:]:
        several = {"type": "object", "additionalProperties": {"$ref": _ref(group)}}
        _replace(properties, group, several)
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **top,
        "title": "A trackbench experiment",
        "$defs": definitions,
    }


_ELSEWHERE: list[dict[str, Any]] = [
    {"type": "string", "description": "path of a YAML file that holds the mapping"},
    {
        "type": "object",
        "required": ["use"],
        "properties": {"use": {"type": "string", "description": "path of a YAML file"}},
        "description": "the mapping in a YAML file, with other values for some of its keys",
    },
]


def _definitions(group: Group, kind: str, cls: type[Any]) -> dict[str, Any]:
    """The definition of one kind, and of the types its keys refer to."""
    name = f"{group}.{kind}"
    own = described(cls).json_schema(ref_template=f"#/$defs/{name}.{{model}}")
    inner = {f"{name}.{model}": part for model, part in own.pop("$defs", {}).items()}
    properties = own.setdefault("properties", {})
    for key, text in help_texts(cls).items():
        properties[key].setdefault("description", text)
    for key, part in getattr(cls, "parts", {}).items():
        _replace(properties, key, {"$ref": _ref(part)})
        own["required"] = [*own.get("required", []), key]
    if getattr(cls, "presets", None):
        # A preset may give any key, and a key of a mapping in it may be changed alone.
        own, inner = _without_required(own), _without_required(inner)
        properties = own["properties"]
        text = "named set of keys to start from"
        properties["preset"] = {"enum": list(cls.presets), "description": text}
    own["properties"] = {"kind": {"const": kind}, **properties}
    own["required"] = ["kind", *own.get("required", [])]
    own["title"] = kind
    own["description"] = " ".join((cls.__doc__ or "").split("\n\n")[0].split())
    return {name: own, **inner}


def _without_required(schema: Any) -> Any:
    if isinstance(schema, list):
        return [_without_required(part) for part in schema]
    if not isinstance(schema, dict):
        return schema
    renamed = {"oneOf": "anyOf"}  # without a required kind, several may fit
    return {
        renamed.get(key, key): _without_required(part)
        for key, part in schema.items()
        if key not in ("required", "discriminator") or not isinstance(part, list | dict)
    }


def _replace(properties: dict[str, Any], key: str, by: dict[str, Any]) -> None:
    """Another schema for a key, under the key's own description."""
    description = properties.get(key, {}).get("description")
    properties[key] = by | ({"description": description} if description else {})


def _ref(name: str) -> str:
    return f"#/$defs/{name}"
