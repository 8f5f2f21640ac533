"""Pieces of a result's files:  its spec, and its documents as strict JSON."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from typing import Any

from fopi_tune.errors import DomainError
from fopi_tune.results.saved.names import SPEC
from fopi_tune.results.saved.writing import to_json
from fopi_tune.spec.model import DesignSpec


def spec_file(spec: DesignSpec) -> Iterator[tuple[str, str | bytes]]:
    """The file of a spec; none of one that was made in Python and has no words."""
    # results of a spec without words are kept all the same; where they are read again the spec is asked for
    with contextlib.suppress(DomainError):
        yield SPEC, spec.to_yaml()


def json_file(name: str, document: Mapping[str, Any] | None) -> Iterator[tuple[str, str]]:
    """The file of a document; none where there is no document."""
    if document is not None:
        yield name, to_json(document) + "\n"
