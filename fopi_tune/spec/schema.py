"""The spec language as JSON Schema, for editors and other programs."""

from __future__ import annotations

from typing import Any

from fopi_tune.spec.language import SCHEMA_VERSION, spec_shape
from fopi_tune.spec.systems import system_shape


def json_schema() -> dict[str, Any]:
    """The language as JSON Schema, draft 2020-12.

    It is generated from the shapes that read a spec and from the registries of plant models, quantities and objectives.
    What needs two numbers or a plant to see (min > max, contradictions, `equals` over a family) only the tool reports.
    """
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"fopi-tune spec, schema {SCHEMA_VERSION}",
    } | spec_shape().json_schema()


def system_json_schema() -> dict[str, Any]:
    """The language of systems, generated like `json_schema`."""
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"fopi-tune system, schema {SCHEMA_VERSION}",
    } | system_shape().json_schema()
