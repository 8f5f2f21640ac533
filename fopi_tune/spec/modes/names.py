"""Names of the two modes of a system:  the section `system` -> (the raising mode's, the lowering mode's).

Every mapping under `system` whose key is no other word of that section is a mode.  The one that is written first
raises the output; `throttle` and `brake` keep their meaning in either order.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence

from fopi_tune.spec.yaml.hints import closest
from fopi_tune.spec.yaml.nodes import MappingNode, Place, ScalarNode
from fopi_tune.spec.yaml.problems import quoted

#: the names that need no order
FAMILIAR = ("throttle", "brake")
#: of a mode; a part of names in C
MODE_PATTERN = "[a-z][a-z0-9_]{0,31}"
#: of the words that say where a mode is entered; no names of modes
THRESHOLD_PATTERN = "to_[a-z0-9_]*_(?:above|below)"
NAME_RULE = "a mode's name is lower-case letters, digits and underscores, at most 32, and begins with a letter"
EXAMPLE = "{throttle: {spec: throttle.yaml}, brake: {spec: brake.yaml}, hysteresis: 0.5}"


def foreign_pattern(reserved: Collection[str]) -> str:
    """Which keys are names of modes other than the familiar ones, as a regular expression of JSON Schema."""
    words = "|".join([*reserved, *FAMILIAR, THRESHOLD_PATTERN])
    return f"^(?!(?:{words})$){MODE_PATTERN}$"


def written_names(place: Place, reserved: Collection[str]) -> tuple[str, str] | None:
    """The names of both modes, the raising one first; None after reporting why there are not two.

    Args:
        place: of the section.
        reserved: its other words.
    """
    if not isinstance(place.node, MappingNode):
        return None
    if words := [key for key in place.node.entries if _is_word_with_a_spec(place, key, reserved)]:
        place.child(words[0]).refuse(f"{words[0]} is a word of this section and no name of a mode; give it another one")
        return None
    found = [key for key in place.node.entries if key not in reserved and _is_mode(place, key)]
    if set(FAMILIAR) & set(found) and len(found) <= 2:
        misspelt = [key for key in found if key not in FAMILIAR and closest(key, FAMILIAR) not in (None, *found)]
        if misspelt:
            place.child(misspelt[0]).refuse(f"the mode is called {closest(misspelt[0], FAMILIAR)}; mend the name")
            return None
    if len(found) != 2:
        _refuse_count(found, place)
        return None
    if set(found) == set(FAMILIAR):
        return FAMILIAR
    for key in found:
        if re.fullmatch(MODE_PATTERN, key) is None:
            place.child(key).refuse(f"{quoted(key)} cannot be the name of a mode: {NAME_RULE}")
            return None
    one, other = found
    if _identifier(one) == _identifier(other):
        place.child(other).refuse(f"{one} and {other} differ by underscores only; write names that are told apart")
        return None
    return one, other


def _is_mode(place: Place, key: str) -> bool:
    """Whether a key that is no other word of the section is meant as a mode."""
    assert isinstance(place.node, MappingNode)
    if re.fullmatch(THRESHOLD_PATTERN, key):
        return False
    return key in FAMILIAR or isinstance(place.node.entries[key][1], MappingNode)


def _is_word_with_a_spec(place: Place, key: str, reserved: Collection[str]) -> bool:
    """Whether a mode is called by another word of the section."""
    assert isinstance(place.node, MappingNode)
    value = place.node.entries[key][1]
    is_word = key in reserved or re.fullmatch(THRESHOLD_PATTERN, key) is not None
    return is_word and isinstance(value, MappingNode) and "spec" in value.entries


def _refuse_count(found: Sequence[str], place: Place) -> None:
    if len(found) > 2:
        place.child(found[2]).refuse(
            f"a third mode is written; two loops take turns: leave two of {', '.join(map(quoted, found))}"
        )
        return
    if found and found[0] in FAMILIAR:
        missing = FAMILIAR[1 - FAMILIAR.index(found[0])]
        place.child(missing).refuse(f"the key is missing; add it, or another mode beside {found[0]}")
        return
    have = f"there is only the mode {found[0]}" if found else "there is no mode"
    assert isinstance(place.node, MappingNode)
    written = [
        key for key, (_, value) in place.node.entries.items()
        if isinstance(value, ScalarNode) and value.text.endswith((".yaml", ".yml"))
    ]  # fmt: skip
    hint = f"; {written[0]} is a mode as {{spec: ...}}" if written else ""
    place.refuse(f"{have}; two loops take turns: write a mapping for each, such as {EXAMPLE}{hint}")


def _identifier(name: str) -> str:
    """What is left of a name in names of files and functions in C."""
    return re.sub("_+", "_", name).strip("_")
