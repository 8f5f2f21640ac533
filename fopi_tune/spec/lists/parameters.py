"""Parameters that the plants of a list share:  `parameters:` beside `plants:` -> those of each plant that uses them.

A number that several plants have, such as a car's mass, is written once.  Requirements hold for every plant on its own,
so that a plant has those shared parameters whose names stand in its expressions, as if they were written in it.
"""

from __future__ import annotations

import re
from dataclasses import replace

from fopi_tune.core.plant import Uncertain
from fopi_tune.spec.parametric.expressions import NAME_PATTERN
from fopi_tune.spec.parametric.plants import names_below
from fopi_tune.spec.parametric.shapes import Parameters
from fopi_tune.spec.plants import uncertain_shape
from fopi_tune.spec.yaml.nodes import MappingNode, Node, Place, ScalarNode, SequenceNode
from fopi_tune.spec.yaml.problems import Mark, key_path

PARAMETERS, PLANTS = "parameters", "plants"
#: in place of a number that could not be read, whose problem is reported
_UNREAD = ScalarNode(Mark(1, 1), "2.718281828459045", plain=True)


def shared_parameters_shape() -> Parameters:
    """The shape of `parameters:` beside `plants:`."""
    return Parameters(uncertain_shape("a number"))


def with_shared_parameters(place: Place) -> Place:
    """The spec with its shared parameters written in each plant that uses them; reports what is wrong with them."""
    if not place.has(PARAMETERS):
        return place
    shared = place.child(PARAMETERS)
    if not place.has(PLANTS):
        assert isinstance(place.node, MappingNode)
        message = "parameters stand here for the plants of a list; write them inside of plant:"
        place.collector.add(place.node.entries[PARAMETERS][0], shared.path, message)
        return _without(place)
    before = len(place.collector.problems)
    read = shared_parameters_shape().read(shared)
    plants = place.child(PLANTS).node
    if read is None or not isinstance(shared.node, MappingNode) or not isinstance(plants, SequenceNode):
        return _without(place)
    good = len(place.collector.problems) == before
    entries = {
        name: (mark, node if good or _is_read(shared.child(name)) else _UNREAD)
        for name, (mark, node) in shared.node.entries.items()
    }
    used: set[str] = set()
    nodes = [_with_used(place.child(PLANTS).item(k), entries, used) for k in range(len(plants.nodes))]
    for name, (mark, _) in entries.items():
        if name not in used and re.fullmatch(NAME_PATTERN, name):
            message = "is not used in any plant; use it in a coefficient or remove it"
            place.collector.add(mark, key_path(shared.path, name), message)
    return _without(place, replace(plants, nodes=tuple(nodes)))


def _is_read(place: Place) -> bool:
    """Whether a parameter is a number, without reporting again that it is none."""
    before = len(place.collector.problems)
    found = uncertain_shape("a number").read(place)
    del place.collector.problems[before:]
    return isinstance(found, Uncertain)


def _without(place: Place, plants: Node | None = None) -> Place:
    """The spec without the key, and with other plants."""
    assert isinstance(place.node, MappingNode)
    entries = {key: entry for key, entry in place.node.entries.items() if key != PARAMETERS}
    if plants is not None:
        entries[PLANTS] = (entries[PLANTS][0], plants)
    return replace(place, node=replace(place.node, entries=entries))


def _with_used(place: Place, shared: dict[str, tuple[Mark, Node]], used: set[str]) -> Node:
    """A plant's node with the shared parameters that it uses."""
    if not isinstance(place.node, MappingNode):
        return place.node
    own = place.child(PARAMETERS).node if place.has(PARAMETERS) else None
    known = own.entries if isinstance(own, MappingNode) else {}
    for name in [name for name in known if name in shared]:
        line = shared[name][0].line
        message = f"is a parameter that all plants may use, from line {line}; give one of them another name"
        place.collector.add(known[name][0], key_path(place.child(PARAMETERS).path, name), message)
        used.add(name)
    names = names_below(place.node) & set(shared)
    used |= names
    found = {name: shared[name] for name in shared if name in names and name not in known}
    if not found:
        return place.node
    mark = place.node.mark if own is None else own.mark
    merged = MappingNode(mark, {**known, **found})
    return replace(place.node, entries={**place.node.entries, PARAMETERS: (mark, merged)})
