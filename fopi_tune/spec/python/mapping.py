"""Mappings to the text of a spec:  a dict with numbers, text, lists and this package's objects -> YAML.

The text is then read as one that a person wrote: the same words, the same checks.
"""

from __future__ import annotations

import io
import os
from collections.abc import Mapping
from enum import Enum
from numbers import Integral, Real
from typing import Any, NoReturn, Protocol, runtime_checkable

import numpy as np

from fopi_tune.core.controller import FoPi, FoPid, Pid, numbers_of
from fopi_tune.core.plant import Plant, Uncertain
from fopi_tune.core.terms.measurement_filter import FILTER_NAMES
from fopi_tune.errors import Problem, SpecError
from fopi_tune.spec.yaml.problems import item_path, key_path

#: what messages call a spec that is no file
IN_PYTHON = "spec"
_MOST_NESTED = 32
#: whole numbers up to here are written with all their digits
_LARGEST_WHOLE = 1e100


@runtime_checkable
class Written(Protocol):
    """What knows how a spec writes it."""

    def as_mapping(self) -> Mapping[str, Any]:
        """The entry of a spec."""
        ...


def yaml_of(entries: Mapping[str, Any]) -> str:
    """The text of a spec, in YAML.

    Args:
        entries: as a spec has them; `schema` is 1 and `name` is `spec` where left out.

    Raises:
        SpecError: something that a spec cannot hold; the message has its path.
    """
    from ruamel.yaml import YAML

    whole = {"schema": 1, "name": IN_PYTHON, **_plain(entries, "", 0)}
    writer = YAML()
    # innermost lists and mappings on one line, as people write them
    writer.default_flow_style = None
    writer.width = 120
    text = io.StringIO()
    writer.dump(whole, text)
    return text.getvalue()


def read_entries(text: bytes) -> dict[str, Any]:
    """The entries of a text that was read as a spec already."""
    from ruamel.yaml import YAML

    return YAML(typ="safe", pure=True).load(text)


def _plain(value: Any, path: str, depth: int) -> Any:
    """What YAML has: mappings, lists, text, numbers, True and False."""
    if depth > _MOST_NESTED:
        _refuse(path, "is nested too deeply")
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value.item()
    if isinstance(value, Written):
        value = value.as_mapping()
    elif isinstance(value, FoPi):
        value = _controller(value)
    elif isinstance(value, Uncertain):
        value = value.nominal if value.is_exact else {"nominal": value.nominal, "min": value.min, "max": value.max}
    elif isinstance(value, Plant):
        numbers = {"numerator": value.numerator, "denominator": value.denominator, "dead_time_s": value.dead_time_s}
        value = {"model": "transfer_function", **numbers}
    if isinstance(value, Mapping):
        for key in value:
            if not isinstance(key, str):
                _refuse(path, f"the key {key!r} is no text; write it in quotes")
        return {str(key): _plain(entry, key_path(path, key), depth + 1) for key, entry in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [_plain(entry, item_path(path, index), depth + 1) for index, entry in enumerate(value)]
    if isinstance(value, Enum):
        value = value.value
    return _scalar(value, path)


def _controller(gains: FoPi) -> dict[str, Any]:
    """A controller with all its numbers exact."""
    numbers: dict[str, Any] = {k: v for k, v in numbers_of(gains).items() if k not in FILTER_NAMES}
    if isinstance(gains, Pid):
        del numbers["alpha"]
    if isinstance(gains, FoPid):
        numbers = {"structure": "pid" if isinstance(gains, Pid) else "fopid", **numbers}
    filtered = gains.measurement_filter
    if filtered is not None:
        numbers["measurement_filter"] = {"order": filtered.order, "time_constant_s": filtered.time_constant_s}
    return numbers


def _scalar(value: Any, path: str) -> str | bool | int | float:
    if isinstance(value, str | os.PathLike):
        return os.fsdecode(value)
    if isinstance(value, bool | np.bool_):
        return bool(value)
    if isinstance(value, Real):
        try:
            size = abs(float(value))
        except OverflowError:
            _refuse(path, "the number is too large to be computed with; write at most 1e100")
        # Python refuses to write out whole numbers of many digits
        return int(value) if isinstance(value, Integral) and size <= _LARGEST_WHOLE else float(value)
    if value is None:
        _refuse(path, "None is no value of a spec; leave the key out")
    return _refuse(
        path,
        f"an object of type {type(value).__name__} is no value of a spec; write a number, text, a list or a mapping",
    )


def _refuse(path: str, message: str) -> NoReturn:
    raise SpecError((Problem(IN_PYTHON, 0, 0, path, message),))
