"""The JSON schema of configs, made of what is installed: for editors, and for ``trailmark plugins show``.

Each part is an if/then over its ``plugin``: an editor then complains about a key of the plugin that is named,
where a ``oneOf`` would say that none of thirty branches matches.
"""

from __future__ import annotations

import re
from typing import Any

from pydantic.errors import PydanticInvalidForJsonSchema, PydanticSchemaGenerationError

from trailmark.config.base import PluginConfig, SourceConfig, sensor_roles
from trailmark.config.document import NAMED_SECTIONS, SINGLE_SECTIONS
from trailmark.config.faults import PerturbOptions
from trailmark.config.host import DEFAULT_PLUGINS, HOST_OPTIONS, RunSettings, SensorSection
from trailmark.errors import PluginError
from trailmark.plugins import Kind, Plugins, Registry, Spec

__all__ = ["part_schema", "run_config_schema"]

Schema = dict[str, Any]

_NAME_PATTERN = "^[a-z][a-z0-9_]*$"


def run_config_schema(plugins: Plugins) -> Schema:
    """Return the JSON schema (2020-12) of a run config, with the descriptions that the plugins give.

    A plugin whose config cannot be imported is named and left open.
    """
    schema = RunSettings.model_json_schema(by_alias=True)
    defs: Schema = schema.setdefault("$defs", {})
    registry = plugins.registry
    defs["perturb"] = _perturb_schema(registry, defs)
    for kind in (*NAMED_SECTIONS.values(), *SINGLE_SECTIONS, "sink"):
        defs[kind] = _kind_schema(kind, registry, defs)
    properties = schema["properties"]
    for section, kind in NAMED_SECTIONS.items():
        properties[section] = _constraints_of(properties[section]) | {
            "type": "object",
            "propertyNames": {"pattern": _NAME_PATTERN},
            "additionalProperties": {"$ref": f"#/$defs/{kind}"},
        }
    for kind in SINGLE_SECTIONS:
        choices = [{"$ref": f"#/$defs/{kind}"}, {"type": "null"}]
        properties[kind] = _constraints_of(properties[kind]) | {"anyOf": choices}
    properties["sinks"] = _constraints_of(properties["sinks"]) | {"type": "array", "items": {"$ref": "#/$defs/sink"}}
    properties["sensors"] |= {"additionalProperties": {"$ref": "#/$defs/sensor"}}
    defs["sensor"] = _sensor_schema(defs)
    return {"$schema": "https://json-schema.org/draft/2020-12/schema"} | schema | {"title": "Trailmark run"}


def part_schema(spec: Spec, ref_prefix: str = "#/$defs/") -> Schema:
    """Return the JSON schema of one part's keys: its plugin's own and those of the host.

    Parameters
    ----------
    spec : Spec
        The part.
    ref_prefix : str
        Where models within the config are found; they stand under ``$defs`` of the answer.

    Raises
    ------
    PluginLoadError
        If its config cannot be imported.
    """
    model = SourceConfig if spec.kind == "source" and spec.config is None else spec.load_config()
    template = ref_prefix + "{model}"
    schema = model.model_json_schema(by_alias=True, ref_template=template)
    options = HOST_OPTIONS.get(spec.kind)
    host = {} if options is None else options.model_json_schema(by_alias=True, ref_template=template)
    own = schema.get("properties", {})
    _tell_roles(model, own)
    plugin = {} if spec.kind == "fault" else {"plugin": {"type": "string", "description": "The plugin."}}
    return {
        "title": f"{spec.kind} {spec.name}",
        "description": ". ".join(part for part in (spec.summary, spec.reference) if part),
        "type": "object",
        "properties": plugin | own | host.get("properties", {}),
        "additionalProperties": False,
        "required": schema.get("required", []),
        "$defs": schema.get("$defs", {}) | host.get("$defs", {}),
    }


def _tell_roles(model: type[PluginConfig], properties: Schema) -> None:
    for name, role in sensor_roles(model).items():
        kinds = f"a sensor of kind {' or '.join(role.kinds)}" if role.kinds else "any sensor"
        if model.model_fields[name].is_required():
            kinds += "; left out: the only one"
        told = properties[name].get("description", "")
        properties[name]["description"] = f"{told} ({kinds})".strip()


def _kind_schema(kind: Kind, registry: Registry, defs: Schema) -> Schema:
    specs = registry.specs(kind)
    patterns = {spec: _pattern(spec, specs) for spec in specs}
    names = {_written_name(spec, specs): spec for spec in specs}
    rules = [_rule(pattern, _define_part(spec, specs, defs)) for spec, pattern in patterns.items()]
    default = next((spec for spec in specs if spec.name == DEFAULT_PLUGINS.get(kind)), None)
    if default is not None:
        without = {"not": {"required": ["plugin"]}}
        rules.append({"if": without, "then": {"$ref": _define_part(default, specs, defs)}})
    plugin = {
        "description": f"One of the installed {kind}s, or distribution:name.",
        "anyOf": [
            {"enum": list(names), "enumDescriptions": [spec.summary for spec in names.values()]},
            {"type": "string", "pattern": f"^.+:({'|'.join(sorted({spec.name for spec in specs}))})$"},
        ],
    }
    return {
        "type": ["object", "string"],
        "if": {"type": "string"},
        "then": plugin,
        "else": {
            "properties": {"plugin": plugin},
            "required": [] if default is not None else ["plugin"],
            "allOf": rules,
        },
    }


def _perturb_schema(registry: Registry, defs: Schema) -> Schema:
    """Return the schema of ``perturb``: its own keys, those of the default fault, and every other fault by its name."""
    specs = registry.specs("fault")
    properties: Schema = dict(PerturbOptions.model_json_schema(by_alias=True)["properties"])
    for spec in specs:
        reference = _define_part(spec, specs, defs)
        if spec.name == DEFAULT_PLUGINS["fault"]:
            properties |= defs[reference.rpartition("/")[2]].get("properties", {})
        else:
            choices = [{"$ref": reference}, {"type": "null"}]
            properties[_written_name(spec, specs)] = {"description": spec.summary, "anyOf": choices}
    return {"type": "object", "properties": properties, "additionalProperties": False}


def _rule(pattern: str, reference: str) -> Schema:
    named = {"properties": {"plugin": {"type": "string", "pattern": pattern}}, "required": ["plugin"]}
    return {"if": named, "then": {"$ref": reference}}


def _define_part(spec: Spec, specs: tuple[Spec, ...], defs: Schema) -> str:
    """Put the schema of a part among the definitions, once; return the reference to it."""
    key = f"{spec.kind}.{_written_name(spec, specs)}"
    if key not in defs:
        prefix = f"{key}."
        try:
            schema = part_schema(spec, f"#/$defs/{prefix}")
        except (PluginError, PydanticInvalidForJsonSchema, PydanticSchemaGenerationError) as error:
            defs[key] = {"type": "object", "description": f"{spec.summary} (its keys are not known: {error})"}
        else:
            defs.update({prefix + name: inner for name, inner in schema.pop("$defs").items()})
            if spec.kind == "source":
                schema["properties"]["perturb"] |= {"anyOf": [{"$ref": "#/$defs/perturb"}, {"type": "null"}]}
            defs[key] = schema
    return f"#/$defs/{key}"


def _written_name(spec: Spec, specs: tuple[Spec, ...]) -> str:
    is_alone = sum(other.name == spec.name for other in specs) == 1
    return spec.name if is_alone else f"{spec.distribution}:{spec.name}"


def _pattern(spec: Spec, specs: tuple[Spec, ...]) -> str:
    is_alone = sum(other.name == spec.name for other in specs) == 1
    prefix = f"({re.escape(spec.distribution)}:)" + ("?" if is_alone else "")
    return f"^{prefix}{re.escape(spec.name)}$"


def _sensor_schema(defs: Schema) -> Schema:
    schema = SensorSection.model_json_schema(by_alias=True)
    defs.update(schema.pop("$defs", {}))
    return schema


def _constraints_of(schema: Schema) -> Schema:
    return {key: schema[key] for key in ("description", "title") if key in schema}
