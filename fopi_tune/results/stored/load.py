"""Results from files:  a folder that a result was written to -> what is stored there, looked at by its schema.

What is read is the document, with the spec beside it and the certificate: its table, its numbers, its gains and their
loop's curves are there again; objects in between, such as a verification, are not, and are computed by `ft.prove`.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fopi_tune.core.controller import FoPi, controller_of
from fopi_tune.errors import DomainError, SpecError
from fopi_tune.proof.certificate import Certificate
from fopi_tune.proof.documents import from_document
from fopi_tune.results.saved.files import json_file, spec_file
from fopi_tune.results.saved.names import (
    CERTIFICATE,
    CHECK,
    DESIGN,
    DIGITAL,
    DIGITAL_CERTIFICATE,
    OPTIMUM,
    SPEC,
    SYSTEM_CERTIFICATE,
    SYSTEM_PROOF,
)
from fopi_tune.results.saved.writing import folder_of
from fopi_tune.results.schema.check import first_problem
from fopi_tune.results.schema.kinds import RESULT_KINDS, result_schema
from fopi_tune.results.views.curves import LoopCurves
from fopi_tune.results.views.shown import Shown
from fopi_tune.spec.digests import is_of_spec
from fopi_tune.spec.files import MAX_CERTIFICATE_BYTES, read_json
from fopi_tune.spec.load import Source, load_spec
from fopi_tune.spec.model import DesignSpec

#: documents that belong to another one
_BESIDE = {
    DESIGN: (CERTIFICATE, OPTIMUM),
    CHECK: (CERTIFICATE,),
    DIGITAL: (DIGITAL_CERTIFICATE,),
    SYSTEM_PROOF: (SYSTEM_CERTIFICATE,),
}
#: kinds that are no result by themselves, but part of one
_PARTS = ("certificate", "optimum", "system_certificate", "study_best")
_AGAIN = "make the result again, or move the file away"


@dataclass(frozen=True, repr=False)
class Stored(Shown):
    """A result that was read from its files: its JSON, and the certificate beside it.

    The objects of the stages, such as `verification` or the candidate, are not written; `ft.prove` makes them again.

    Args:
        kind: a word of `fopi schema --result`.
        document: its JSON.
        beside: documents that belong to it, by the names of their files.
        file: name of its own; of a run that of the design.
    """

    kind: str
    document: Mapping[str, Any]
    beside: Mapping[str, Mapping[str, Any]]
    file: str

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            if name.startswith("_"):
                raise AttributeError(name)
            keys = ", ".join(self.__dict__.get("document", ()))
            raise AttributeError(
                f"a result that was read has no {name!r}: its numbers are in document ({keys}); objects that are not "
                "written, such as a verification, are made again by ft.prove(result.spec, result.gains)"
            )

    @property
    def status(self) -> str:
        """As when it was written; of a run the digital controller's, where the design is solved."""
        own, digital = self.document["status"], self.document.get("digital") if self.kind == "run" else None
        return digital["status"] if own == "solved" and digital is not None else own

    @property
    def certificate(self) -> Certificate | None:
        """The proof; None without one.

        Raises:
            CertificateError: the file is damaged.
        """
        name = DIGITAL_CERTIFICATE if self.kind == "digital" else CERTIFICATE
        return from_document(self.beside[name]) if name in self.beside else None

    def to_dict(self) -> dict[str, Any]:
        """The result's JSON, as it was written."""
        return dict(self.document)

    def data_files(self) -> Iterator[tuple[str, str | bytes]]:
        """As `Shown.data_files`; C code and tables of signals are not read, and not written again."""
        for name, document in self.beside.items():
            yield from json_file(name, document)
        own = dict(self.document)
        if self.kind == "run":
            yield from json_file(DIGITAL, own.pop("digital"))
            del own["digital_problem"]
        yield from json_file(self.file, own)


@dataclass(frozen=True, repr=False)
class StoredLoop(Stored, LoopCurves):
    """A result about one loop with its spec, which has the loop's curves.

    Args:
        kind, document, beside, file: as those of `Stored`.
        spec: the one that the result is of.
        gains: None where there are none; ki in kp's unit times (rad/s)^alpha.
    """

    spec: DesignSpec = field(kw_only=True)
    gains: FoPi | None = field(kw_only=True)

    def data_files(self) -> Iterator[tuple[str, str | bytes]]:
        """As those of `Stored`, after the spec."""
        yield from spec_file(self.spec)
        yield from super().data_files()


def load(folder: str | os.PathLike[str], kind: str | None = None, spec: Source | None = None) -> Stored:
    """Read a result from the folder that `save` or the command line wrote it to.

    What is there again: `document` and `to_dict()`, `status`, `rows()`, `to_pandas()`, `certificate`, and with the spec
    `spec`, `gains`, `controller` and the loop's curves.  The objects of the stages, such as `verification`, are not
    written: `ft.prove(result.spec, result.gains)` computes them again.

    Args:
        folder: of the results.
        kind: a word of `fopi schema --result`, where several results are there.  Without it a design is read, as a run
            with its digital controller where that is of the same gains, else the only result.
        spec: of the result, where `spec.yaml` is not in the folder or names files that are not there.

    Returns:
        What is stored; with its spec a `StoredLoop`.

    Raises:
        DomainError: there is no such result, it is damaged, or the spec is of another result; says which file.
        SpecError: the spec that is given cannot be read.
    """
    path = folder_of(folder)
    files = _files_there(path)
    if kind is None:
        kind = _only_kind(path, files)
    if not isinstance(kind, str) or kind not in files:
        known = ", ".join(sorted(files)) or "none"
        raise DomainError(f"there is no result of the kind {kind!r} in {path}; those that are there: {known}")
    document, name = _read(path, kind, files[kind]), files[kind]
    beside = {other: _read(path, _part(other), other) for other in _names_beside(kind, name) if (path / other).exists()}
    known = _spec_of(path, document, spec)
    if known is None:
        return Stored(kind, document, beside, name)
    try:
        gains = None if document["gains"] is None else controller_of(document["gains"])
    except DomainError as error:
        raise DomainError(f"{path / name}: {error}; {_AGAIN}") from None
    return StoredLoop(kind, document, beside, name, spec=known, gains=gains)


def _files_there(folder: Path) -> dict[str, str]:
    """The kinds of results in a folder, and the file of each."""
    found: dict[str, str] = {}
    for kind, each in RESULT_KINDS.items():
        there = [name for name in each.files if (folder / name).is_file()]
        if there and kind not in _PARTS and _is_of_kind(folder / there[0], kind):
            found[kind] = there[0]
    if "design" in found and "digital" in found:
        found["run"] = found["design"]
    return found


def _is_of_kind(path: Path, kind: str) -> bool:
    """Which of a loop and a system a file is about that both have; damaged ones are told when they are read."""
    if kind.removeprefix("system_") not in ("evidence", "simulation"):
        return True
    try:
        gains = read_json(path)["gains"]
        of_modes = all(isinstance(each, Mapping) for each in gains.values())
    except (OSError, DomainError, KeyError, TypeError, AttributeError):
        of_modes = False
    return of_modes == kind.startswith("system_")


def _only_kind(folder: Path, files: Mapping[str, str]) -> str:
    if "design" in files:
        return "run" if "run" in files and _is_one_run(folder) else "design"
    if len(files) == 1:
        return next(iter(files))
    if not files:
        raise DomainError(f"there is no result in {folder}; give the folder that a result was saved to")
    raise DomainError(f"there are {len(files)} results in {folder}; say which with kind=: {', '.join(sorted(files))}")


def _is_one_run(folder: Path) -> bool:
    design, digital = _read(folder, "design", DESIGN), _read(folder, "digital", DIGITAL)
    same = (digital["gains"], digital["stamp"]["digests"]) == (design["gains"], design["stamp"]["digests"])
    return same and design["status"] == "solved"


def _names_beside(kind: str, name: str) -> tuple[str, ...]:
    return (*_BESIDE.get(name, ()), *(_BESIDE[DIGITAL] if kind == "run" else ()))


def _part(name: str) -> str:
    return next(kind for kind, each in RESULT_KINDS.items() if name in each.files)


def _read(folder: Path, kind: str, name: str) -> dict[str, Any]:
    """A document, looked at by its schema."""
    path = folder / name
    if kind == "run":
        return {**_read(folder, "design", DESIGN), "digital": _read(folder, "digital", DIGITAL), "digital_problem": ""}
    try:
        found = read_json(path, MAX_CERTIFICATE_BYTES)
    except OSError as error:
        raise DomainError(f"{path} cannot be read ({error.strerror or error}); check it") from None
    except DomainError as error:
        raise DomainError(f"{path} {error}; {_AGAIN}") from None
    problem = first_problem(found, result_schema(kind))
    if problem is not None:
        raise DomainError(f"{path} is no result of the kind {kind!r}: {problem}; {_AGAIN}")
    return found


def _spec_of(folder: Path, document: Mapping[str, Any], given: Source | None) -> DesignSpec | None:
    """The spec of a result about one loop; None where it is not there."""
    gains = document.get("gains") or {}
    if "points" in document or any(isinstance(each, Mapping) for each in gains.values()):
        return None
    if given is not None:
        spec = load_spec(given)
        if not is_of_spec(document["stamp"], spec):
            raise DomainError(f"the result in {folder} is of another spec than {spec.name!r}; give its own")
        return spec
    try:
        spec = load_spec(folder / SPEC)
    except SpecError:
        return None
    return spec if is_of_spec(document["stamp"], spec) else None
