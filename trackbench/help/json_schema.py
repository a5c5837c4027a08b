"""JSON Schema of an experiment file, for editors: completion, descriptions, defaults."""

from typing import Any, TypeAlias

from trackbench.config.build import adapter, help_texts, hints_of
from trackbench.config.experiment import Settings
from trackbench.extension_points import Part
from trackbench.field_types import part_group
from trackbench.models.sensors.base import Assume
from trackbench.registry import Group, kinds

JsonSchema: TypeAlias = dict[str, Any]
"""A JSON Schema, or a part of one."""
_TOP: tuple[Group, ...] = ("filters", "tables", "figures")
_GROUPS: tuple[Group, ...] = ("scenarios", *_TOP, "targets", "motions", "sensors", "starts")


def schema() -> JsonSchema:
    """Build the schema (draft 2020-12): the top level, and every registered kind with its keys."""
    # Step 1: the top level, with a definition of every kind.
    top = adapter(Settings, documented=True).json_schema(ref_template="#/$defs/{model}")
    definitions: JsonSchema = top.pop("$defs", {})
    for group in _GROUPS:
        names = []
        for kind, cls in kinds(group).items():
            names.append(f"{group}.{kind}")
            definitions |= _definitions(group, kind, cls)
        definitions[group] = {"anyOf": [*_ELSEWHERE, *({"$ref": _ref(name)} for name in names)]}
    assume = adapter(Assume, documented=True).json_schema(ref_template="#/$defs/assume.{model}")
    definitions |= {f"assume.{model}": part for model, part in assume.pop("$defs", {}).items()}
    _refer_to_parts(Assume, assume["properties"])
    definitions["assume"] = assume
    # Step 2: in place of mappings of any keys, refer to the kinds.
    properties = top["properties"]
    _replace(properties, "scenario", {"$ref": _ref("scenarios")})
    laid_over = {"anyOf": [_ELSEWHERE[0], {"type": "object"}]}
    _replace(definitions["Tuning"]["properties"], "scenario", laid_over | {"default": None})
    for group in _TOP:
        several = {"type": "object", "additionalProperties": {"$ref": _ref(group)}}
        _replace(properties, group, several)
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **top,
        "title": "A trackbench experiment",
        "$defs": definitions,
    }


_ELSEWHERE: list[JsonSchema] = [
    {"type": "string", "description": "path of a YAML file that holds the mapping"},
    {
        "type": "object",
        "required": ["use"],
        "properties": {"use": {"type": "string", "description": "path of a YAML file"}},
        "description": "the mapping in a YAML file, with other values for some of its keys",
    },
]


def _definitions(group: Group, kind: str, cls: type[Part]) -> JsonSchema:
    """Define one kind and the types that its keys refer to."""
    name = f"{group}.{kind}"
    schema = adapter(cls, documented=True).json_schema(ref_template=f"#/$defs/{name}.{{model}}")
    inner = {f"{name}.{model}": part for model, part in schema.pop("$defs", {}).items()}
    properties = schema.setdefault("properties", {})
    for key, text in help_texts(cls).items():
        properties[key].setdefault("description", text)
    # Keys of components, presets, and `assume` of every filter.
    _refer_to_parts(cls, properties)
    if cls.presets:
        # A preset may give any key, and a key of a mapping in it may be changed alone.
        schema, inner = _without_required(schema), _without_required(inner)
        properties = schema["properties"]
        text = "named set of keys to start from"
        properties["preset"] = {"enum": list(cls.presets), "description": text}
    if group == "filters":
        text = "motion and sensor that this filter assumes"
        properties["assume"] = {"$ref": _ref("assume"), "description": text}
        text = "what becomes of measurements that arrive late"
        properties["late"] = {"$ref": f"{_ref('assume')}/properties/late", "description": text}
    schema["properties"] = {"kind": {"const": kind}, **properties}
    schema["required"] = ["kind", *schema.get("required", [])]
    schema["title"] = kind
    schema["description"] = " ".join((cls.__doc__ or "").split("\n\n")[0].split())
    return {name: schema, **inner}


def _refer_to_parts(cls: type, properties: JsonSchema) -> None:
    for key, hint in hints_of(cls).items():
        group = part_group(hint)
        if group is not None:
            word = {"type": "string", "description": "a kind, with all keys at their defaults"}
            one = {"anyOf": [word, {"$ref": _ref(group)}]}
            _replace(properties, key, {"anyOf": [one, {"type": "array", "items": one}]})


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


def _replace(properties: JsonSchema, key: str, by: JsonSchema) -> None:
    """Replace a key's schema and keep its description."""
    description = properties.get(key, {}).get("description")
    properties[key] = by | ({"description": description} if description else {})


def _ref(name: str) -> str:
    return f"#/$defs/{name}"
