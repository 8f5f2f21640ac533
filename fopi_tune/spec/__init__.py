"""YAML text to `DesignSpec`, with file:line:column for everything that is wrong."""

from fopi_tune.spec.load import load_any, load_document, load_spec, load_system, parse_spec

__all__ = ["load_any", "load_document", "load_spec", "load_system", "parse_spec"]
