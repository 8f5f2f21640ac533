"""The language of studies as JSON Schema, for editors and other programs."""

from __future__ import annotations

from typing import Any

from fopi_tune.spec.language import SCHEMA_VERSION
from fopi_tune.study.language import study_shape


def study_json_schema() -> dict[str, Any]:
    """The language as JSON Schema, draft 2020-12, generated from the shapes that read a study.

    What an override makes of a spec only the tool judges.
    """
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"fopi-tune study, schema {SCHEMA_VERSION}",
    } | study_shape().json_schema()
