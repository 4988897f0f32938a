"""The JSON schema that editors use: that of the Config, loosened where one file need not say everything.

A file may extend another, and then gives only what differs; a base file such as ``paper.yaml`` has no scene.
So a key that another file can supply is required only of a file that stands alone: one that has ``bodies``
and no ``extends``. What lies in a list is replaced as a whole and stays required.
"""

from typing import Any

from taichi_slm.config.schema import Config

EXTENDS = {
    "type": "string",
    "pattern": r"\.ya?ml$",
    "description": "file whose keys this one takes over and changes, beside it or below",
}


def editor_schema() -> dict[str, Any]:
    """JSON schema (draft 2020-12) of a config file."""
    schema = Config.model_json_schema()
    definitions: dict[str, Any] = schema["$defs"]
    in_lists = _below_lists(schema, definitions)
    alone: dict[str, Any] = {"required": schema.pop("required"), "properties": {}}
    for key, value in schema["properties"].items():
        section = definitions.get(_target(value) or "", {})
        if section.get("required"):
            alone["properties"][key] = {"if": {"type": "object"}, "then": {"required": section["required"]}}
    for name, definition in definitions.items():
        if name not in in_lists:
            definition.pop("required", None)
    schema["properties"] = {"extends": EXTENDS, **schema["properties"]}
    schema["if"] = {"required": ["bodies"], "not": {"required": ["extends"]}}
    schema["then"] = alone
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}


def _target(value: dict[str, Any]) -> str | None:
    """The definition that a property refers to, through `| None` too."""
    for option in (value, *value.get("anyOf", ())):
        if "$ref" in option:
            return str(option["$ref"]).rpartition("/")[2]
    return None


def _below_lists(schema: Any, definitions: dict[str, Any]) -> set[str]:
    """Names of the definitions that some list holds, directly or deeper down."""
    found: set[str] = set()

    def walk(part: Any, in_list: bool) -> None:
        if isinstance(part, list):
            for each in part:
                walk(each, in_list)
        elif isinstance(part, dict):
            name = str(part["$ref"]).rpartition("/")[2] if "$ref" in part else None
            if in_list and name is not None and name not in found:
                found.add(name)
                walk(definitions[name], True)
            for key, each in part.items():
                walk(each, in_list or key in ("items", "prefixItems"))

    walk({key: value for key, value in schema.items() if key != "$defs"}, False)
    for definition in list(definitions.values()):
        walk(definition, False)
    return found
