"""YAML text to `DesignSpec`, with file:line:column for everything that is wrong."""

import sys
from collections.abc import Mapping
from types import ModuleType
from typing import Any

from fopi_tune.spec.load import load_any, load_document, load_spec, load_system, parse_spec, spec
from fopi_tune.spec.model import DesignSpec

__all__ = ["load_any", "load_document", "load_spec", "load_system", "parse_spec", "spec"]


class _CallableModule(ModuleType):
    """`fopi_tune.spec` is this folder, and called, as `ft.spec(...)`, a spec from its entries."""

    def __call__(self, entries: Mapping[str, Any] | None = None, /, **more: Any) -> DesignSpec:
        return spec(entries, **more)


sys.modules[__name__].__class__ = _CallableModule
