"""JSON Schema of an experiment file, for editors: completion, descriptions, defaults."""

from typing import Any, TypeAlias

from trackbench.component_parts import Part
from trackbench.config.experiment_keys import Settings
from trackbench.config.strict_validator import adapter
from trackbench.field_types import hints_of, part_group
from trackbench.help.descriptions import help_texts
from trackbench.models.assume import Assume
from trackbench.registry import Group, kinds

JsonSchema: TypeAlias = dict[str, Any]
"""A JSON Schema, or a part of one."""
_TOP: tuple[Group, ...] = ("filters", "tables", "figures")
_GROUPS: tuple[Group, ...] = ("scenarios", *_TOP, "targets", "motions", "sensors", "starts")


def schema() -> JsonSchema:
    """Build the schema (draft 2020-12): the top level, and every registered kind with its keys."""
    # Step 1: the top level, with a definition of every kind. In place of a component's mapping a config
    # may name a YAML file (`_IN_FILE`).
    top = adapter(Settings, documented=True).json_schema(ref_template="#/$defs/{model}")
    definitions: JsonSchema = top.pop("$defs", {})
    for group in _GROUPS:
        kind_schemas = []
        for kind, cls in kinds(group).items():
            definitions |= _definitions(group, kind, cls)
            kind_schemas.append({"$ref": _ref(f"{group}.{kind}")})
        definitions[group] = {"anyOf": [*_IN_FILE, *kind_schemas]}
    assume = adapter(Assume, documented=True).json_schema(ref_template="#/$defs/assume.{model}")
    for model, definition in assume.pop("$defs", {}).items():
        definitions[f"assume.{model}"] = definition
    _refer_to_components(Assume, assume["properties"])
    definitions["assume"] = assume
    # Step 2: in place of mappings of any keys, refer to the kinds.
    properties = top["properties"]
    _replace_schema(properties, "scenario", {"$ref": _ref("scenarios")})
    # The training scenario has only the keys that differ from the scenario's, and may lack a kind.
    changes_of_scenario = {"anyOf": [_PATH, {"type": "object"}], "default": None}
    _replace_schema(definitions["Tuning"]["properties"], "scenario", changes_of_scenario)
    for group in _TOP:
        by_name = {"type": "object", "additionalProperties": {"$ref": _ref(group)}}
        _replace_schema(properties, group, by_name)
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **top,
        "title": "A trackbench experiment",
        "$defs": definitions,
    }


_PATH: JsonSchema = {"type": "string", "description": "path of a YAML file that holds the mapping"}
_IN_FILE: list[JsonSchema] = [
    _PATH,
    {
        "type": "object",
        "required": ["use"],
        "properties": {"use": {"type": "string", "description": "path of a YAML file"}},
        "description": "the mapping in a YAML file, with other values for some of its keys",
    },
]


def _definitions(group: Group, kind: str, cls: type[Part]) -> JsonSchema:
    """Return the schema of one kind of a group, and of the types that its keys refer to, by name.

    The name of the kind's schema is ``group.kind``. The names of the others begin with it.
    """
    name = f"{group}.{kind}"
    schema = adapter(cls, documented=True).json_schema(ref_template=f"#/$defs/{name}.{{model}}")
    inner_definitions = {}
    for model, definition in schema.pop("$defs", {}).items():
        inner_definitions[f"{name}.{model}"] = definition
    properties = schema.setdefault("properties", {})
    for key, text in help_texts(cls).items():
        properties[key].setdefault("description", text)
    # Keys of components, presets, and `assume` of every filter.
    _refer_to_components(cls, properties)
    if cls.presets:
        # A preset may give any key, and a key of a mapping in it may be changed alone.
        schema = _without_required(schema)
        inner_definitions = {
            model: _without_required(definition) for model, definition in inner_definitions.items()
        }
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
    return {name: schema, **inner_definitions}


def _refer_to_components(cls: type, properties: JsonSchema) -> None:
    """Replace the schemas of the keys of ``cls`` that hold components, in ``properties``.

    ``properties`` has the schemas by key and is changed. Such a key takes the name of a kind, a mapping
    with a kind, or a list of these.
    """
    for key, hint in hints_of(cls).items():
        group = part_group(hint)
        if group is None:
            continue
        word = {"type": "string", "description": "a kind, with all keys at their defaults"}
        component = {"anyOf": [word, {"$ref": _ref(group)}]}
        components = {"type": "array", "items": component}
        _replace_schema(properties, key, {"anyOf": [component, components]})


_SCHEMAS_BY_NAME = ("properties", "patternProperties", "$defs")
"""Keywords whose value has a schema for each name, which the user or the code chose."""
_DATA = ("default", "const", "enum", "examples")
"""Keywords whose value is data and no schema."""


def _without_required(schema: Any) -> Any:
    """Return a schema of which no key is required.

    A key that is itself called `required` or `oneOf` stays, and so do default values.
    """
    if isinstance(schema, list):
        return [_without_required(item) for item in schema]
    if not isinstance(schema, dict):
        return schema
    optional: JsonSchema = {}
    for keyword, value in schema.items():
        if keyword in _SCHEMAS_BY_NAME:
            optional[keyword] = {name: _without_required(inner) for name, inner in value.items()}
        elif keyword in _DATA:
            optional[keyword] = value
        elif keyword == "oneOf":
            # Without a required kind, several schemas may fit.
            optional["anyOf"] = _without_required(value)
        elif keyword not in ("required", "discriminator"):
            # A discriminator chooses a schema by a key, which no longer is required.
            optional[keyword] = _without_required(value)
    return optional


def _replace_schema(properties: JsonSchema, key: str, schema: JsonSchema) -> None:
    """Replace a key's schema in ``properties`` and keep its description."""
    description = properties.get(key, {}).get("description")
    properties[key] = dict(schema)
    if description:
        properties[key]["description"] = description


def _ref(name: str) -> str:
    return f"#/$defs/{name}"
