"""YAML text to `DesignSpec`, with file:line:column for everything that is wrong."""

from fopi_tune.spec.load import load_spec, parse_spec

__all__ = ["load_spec", "parse_spec"]
