"""Systems in studies:  a system file with its modes' specs in place of their paths, as one document.

Paths of overrides then lead into the specs (`system.brake.spec.plant.time_constant_s.max`), and a worker needs no file
but the system's list of samples.  A mode's own section `validation` and its description say nothing of the system;
they are left out.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from fopi_tune.errors import Problem, SpecError
from fopi_tune.spec.load import contents_reader
from fopi_tune.spec.model import DesignSpec, SystemSpec
from fopi_tune.spec.systems import SYSTEM, read_system
from fopi_tune.spec.validation import FileReader
from fopi_tune.spec.yaml.nodes import MappingNode, Node, Place, ScalarNode, SequenceNode, kind_of
from fopi_tune.spec.yaml.problems import Mark, ProblemCollector
from fopi_tune.study.overrides import Files, node_from_json, plain_value, spec_from_tree

#: sections of a mode's spec that the system does not read
UNREAD = ("validation", "description")
#: a path into the spec of a mode, and the spec itself
IN_MODE_SPEC = re.compile(rf"{SYSTEM}\.([A-Za-z0-9_]+)\.spec(?:\.(.+))?")

#: path as it is written in the system file -> the document there
DocumentLoader = Callable[[str], Place]


class ModeSpecError(ValueError):
    """A mode's spec that cannot be read: where the system names it, and why."""

    def __init__(self, mark: Mark, path: str, message: str) -> None:
        super().__init__(message)
        self.mark, self.path, self.message = mark, path, message


def with_mode_specs(tree: Node, load: DocumentLoader) -> Node:
    """The tree of a system with its modes' specs in place of their paths; what is there already is left.

    Raises:
        ModeSpecError: a file cannot be read.
    """
    if not isinstance(tree, MappingNode) or SYSTEM not in tree.entries:
        return tree
    mark, section = tree.entries[SYSTEM]
    if not isinstance(section, MappingNode):
        return tree
    modes = {key: (at, _with_spec(mode, f"{SYSTEM}.{key}", load)) for key, (at, mode) in section.entries.items()}
    return replace(tree, entries={**tree.entries, SYSTEM: (mark, replace(section, entries=modes))})


def _with_spec(mode: Node, path: str, load: DocumentLoader) -> Node:
    if not isinstance(mode, MappingNode) or "spec" not in mode.entries:
        return mode
    mark, spec = mode.entries["spec"]
    if not isinstance(spec, ScalarNode):
        return mode
    try:
        document = load(spec.text).node
    except SpecError as error:
        message = f"the spec cannot be used: {error.problems[0]}"
        raise ModeSpecError(spec.mark, f"{path}.spec", message) from None
    if isinstance(document, MappingNode):
        document = replace(document, entries={k: v for k, v in document.entries.items() if k not in UNREAD})
    return replace(mode, entries={**mode.entries, "spec": (mark, document)})


def refuse_written_specs(tree: Node) -> None:
    """Refuse a system file that has a spec in place of its path, as every other command does.

    Raises:
        ModeSpecError: where it is.
    """
    section = tree.entries[SYSTEM][1] if isinstance(tree, MappingNode) and SYSTEM in tree.entries else None
    for key, (_, mode) in section.entries.items() if isinstance(section, MappingNode) else ():
        spec = mode.entries["spec"][1] if isinstance(mode, MappingNode) and "spec" in mode.entries else None
        if isinstance(spec, MappingNode | SequenceNode):
            message = f"{kind_of(spec)} is written where text belongs; write the path of the spec"
            raise ModeSpecError(spec.mark, f"{SYSTEM}.{key}.spec", message)


def mode_files(tree: Node) -> dict[str, str]:
    """The paths of the modes' specs as the system file has them, by the names of the modes."""
    section = tree.entries[SYSTEM][1] if isinstance(tree, MappingNode) and SYSTEM in tree.entries else None
    found: dict[str, str] = {}
    for key, (_, mode) in section.entries.items() if isinstance(section, MappingNode) else ():
        spec = mode.entries["spec"][1] if isinstance(mode, MappingNode) and "spec" in mode.entries else None
        if isinstance(spec, ScalarNode):
            found[key] = spec.text
    return found


def system_from_tree(tree: Node, collector: ProblemCollector, read: FileReader, sha256: str = "") -> SystemSpec | None:
    """The system of a tree that holds its modes' specs, or None after reporting its problems."""
    specs, failed = _specs_of_modes(tree, collector, read)
    own = ProblemCollector(collector.file)

    def loader(path: str) -> DesignSpec:
        if path in specs:
            return specs[path]
        # told already, with its place in the spec
        raise SpecError((Problem(collector.file, 1, 1, "", path),))

    system = read_system(Place(_with_names_of_specs(tree, [*specs, *failed]), "", own), sha256, loader, read)
    collector.problems += [each for each in own.problems if each.path not in failed.values()]
    return None if collector.problems else system


def _specs_of_modes(
    tree: Node, collector: ProblemCollector, read: FileReader
) -> tuple[dict[str, DesignSpec], dict[str, str]]:
    """The specs of the modes by their names, and where those lie that have problems, which are reported."""
    specs: dict[str, DesignSpec] = {}
    failed: dict[str, str] = {}
    section = tree.entries[SYSTEM][1] if isinstance(tree, MappingNode) and SYSTEM in tree.entries else None
    for name, (_, mode) in section.entries.items() if isinstance(section, MappingNode) else ():
        if not isinstance(mode, MappingNode) or "spec" not in mode.entries:
            continue
        node, path = mode.entries["spec"][1], f"{SYSTEM}.{name}.spec"
        if isinstance(node, ScalarNode):
            continue
        inner = ProblemCollector(collector.file)
        sha256 = hashlib.sha256(_json(_sorted(plain_value(node))).encode()).hexdigest()
        spec = spec_from_tree(node, inner, read, sha256, path)
        collector.problems += inner.problems
        if spec is None:
            failed[name] = path
        else:
            specs[name] = spec
    return specs, failed


def _with_names_of_specs(tree: Node, names: list[str]) -> Node:
    """The tree with the names of modes in place of their specs, as a file has paths there."""
    if not names:
        return tree
    assert isinstance(tree, MappingNode)
    mark, section = tree.entries[SYSTEM]
    assert isinstance(section, MappingNode)
    modes = dict(section.entries)
    for name in names:
        at, mode = modes[name]
        assert isinstance(mode, MappingNode)
        key_mark, _ = mode.entries["spec"]
        named = ScalarNode(key_mark, name, plain=False)
        modes[name] = (at, replace(mode, entries={**mode.entries, "spec": (key_mark, named)}))
    return replace(tree, entries={**tree.entries, SYSTEM: (mark, replace(section, entries=modes))})


def system_text(tree: Node, system: SystemSpec) -> str:
    """The canonical text of a system's tree: keys sorted, but for the modes, whose order says which one raises."""
    value = plain_value(tree)
    value.pop("description", None)
    value = _sorted(value)
    section = value[SYSTEM]
    modes = {mode.name: section[mode.name] for mode in system.modes}
    return _json({**value, SYSTEM: {**modes, **section}})


def system_from_text(text: str, name: str = "<cell>", files: Files = ()) -> SystemSpec:
    """The system of a canonical text.

    Args:
        text: the system with its modes' specs.
        name: what messages call it.
        files: names and contents of the files that it names.

    Raises:
        SpecError: not a usable system.
    """
    collector = ProblemCollector(name)
    sha256 = hashlib.sha256(text.encode()).hexdigest()
    system = system_from_tree(node_from_json(json.loads(text)), collector, contents_reader(dict(files)), sha256)
    if system is None:
        raise collector.error()
    return system


def _sorted(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _sorted(value[key]) for key in sorted(value)}
    return [_sorted(each) for each in value] if isinstance(value, list) else value


def _json(value: Any) -> str:
    return json.dumps(value, separators=(",", ":"), ensure_ascii=False)
