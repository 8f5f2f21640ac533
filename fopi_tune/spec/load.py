"""Files and text to `DesignSpec`."""

from __future__ import annotations

import contextlib
import hashlib
import os
import posixpath
import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from importlib.resources import files as package_files
from typing import Any

from fopi_tune.errors import DomainError, SpecError
from fopi_tune.spec.digests import content_digest
from fopi_tune.spec.files import read_bytes
from fopi_tune.spec.language import read_spec
from fopi_tune.spec.model import DesignSpec, SystemSpec
from fopi_tune.spec.python.mapping import IN_PYTHON, yaml_of
from fopi_tune.spec.systems import SpecLoader, is_system, read_system
from fopi_tune.spec.validation import MAX_SAMPLES_BYTES, FileReader, UnreadableError
from fopi_tune.spec.yaml.composer import MAX_BYTES, compose, decode, to_bytes
from fopi_tune.spec.yaml.nodes import Place
from fopi_tune.spec.yaml.problems import Mark, ProblemCollector, quoted

#: what messages say of a text that has lines
_LINE = re.compile(r" (?:on|in) line \d+")
#: a spec: the path of its file, its text in YAML, a mapping with its entries, or one that was read already
Source = str | os.PathLike[str] | Mapping[str, Any] | DesignSpec
#: the same for a system
SystemSource = str | os.PathLike[str] | Mapping[str, Any] | SystemSpec


def load_spec(source: Source) -> DesignSpec:
    """The spec in a file, a text or a mapping, and what is in the files that it names.

    Args:
        source: see `Source`; a text of several lines is YAML, one of a single line a path.  A `DesignSpec` is returned
            as it is, one that was made or changed in Python with the hash of what it says in place of the hash of a
            text that says something else.

    Raises:
        SpecError: the file cannot be read, or is not a usable spec; carries every problem found.
        DomainError: something else than a spec.
    """
    if isinstance(source, DesignSpec):
        content = content_digest(source)
        if content == source.content_sha256:
            return source
        return replace(source, text_sha256=content, content_sha256=content, digest=content_digest)
    collector, data = _text_of(source)
    with _of_python(source):
        return _parse(data, collector, folder_reader(_place_of(source)))


def spec(entries: Mapping[str, Any] | None = None, /, **more: Any) -> DesignSpec:
    """A spec from its entries, with the words and checks of YAML; messages have paths in place of lines.

        ft.spec(plant=ft.Lag(1.0, 2.25).uncertain(time_constant_s=(1.6, 3.1)),
                controller={"kp": {"min": 0, "max": 10}, "ki": {"min": 0, "max": 10}, "alpha": 1},
                requirements=[ft.phase_margin_deg >= 60], objective={"maximize": "ki"})

    Args:
        entries: as YAML has them; numbers may be NumPy's, plants, requirements and controllers this package's objects.
        more: the same as keywords; `schema` is 1 and `name` is `spec` where left out.

    Raises:
        SpecError: not a usable spec; carries every problem found.
        DomainError: something else than a mapping.
    """
    if not isinstance(entries, Mapping | None):
        raise DomainError(
            f"an object of type {type(entries).__name__} is no mapping of a spec's entries; give a dict or keywords, "
            "and of a file or a text take load_spec"
        )
    return load_spec({**(entries or {}), **more})


@contextlib.contextmanager
def _of_python(source: object) -> Iterator[None]:
    """Leave out lines and columns of a text that nobody wrote."""
    try:
        yield
    except SpecError as error:
        if not isinstance(source, Mapping):
            raise
        told = (replace(each, line=0, column=0, message=_LINE.sub("", each.message)) for each in error.problems)
        raise SpecError(tuple(told)) from None


def _text_of(source: object) -> tuple[ProblemCollector, bytes]:
    """A spec's text, and where its problems go."""
    if isinstance(source, Mapping):
        collector = ProblemCollector(IN_PYTHON)
        return collector, to_bytes(yaml_of(source), collector)
    if isinstance(source, str) and "\n" in source:
        collector = ProblemCollector("<spec>")
        return collector, to_bytes(source, collector)
    if not isinstance(source, str | os.PathLike):
        raise DomainError(
            f"an object of type {type(source).__name__} is no spec; give the path of a file, its text in YAML, a dict, "
            "or a DesignSpec"
        )
    collector = ProblemCollector(os.fsdecode(source) or "''")
    return collector, _read_file(source, collector)


def _place_of(source: object) -> str:
    """The path of a spec's file; of one that is no file, one in the current folder."""
    return os.fsdecode(source) if isinstance(source, str | os.PathLike) and "\n" not in str(source) else IN_PYTHON


def load_any(source: Source | SystemSource) -> DesignSpec | SystemSpec:
    """The spec or the system in a file, a text or a mapping.

    Args:
        source: see `Source`; an object that was read already is returned as it is.

    Raises:
        SpecError: the file, or a spec that a system names, cannot be read or used; carries every problem found.
        DomainError: something else than a spec or a system.
    """
    if isinstance(source, DesignSpec | SystemSpec):
        return source
    collector, data = _text_of(source)
    place = _place_of(source)
    folder = os.path.dirname(place)
    with _of_python(source):
        return _parse_any(data, collector, lambda path: load_spec(os.path.join(folder, path)), folder_reader(place))


def load_system(source: Source | SystemSource) -> SystemSpec:
    """The system in a file, a text or a mapping.

    Args:
        source: see `Source`; a `SystemSpec` is returned as it is.

    Raises:
        SpecError: as for `load_any`, or the file is a spec.
    """
    found = source if isinstance(source, SystemSpec) else load_any(source)
    if isinstance(found, SystemSpec):
        return found
    collector = ProblemCollector(found.name if isinstance(source, SystemSpec | DesignSpec) else _place_of(source))
    collector.add(Mark(1, 1), "", "this is a spec, no system; a system has a section `system`")
    with _of_python(source):
        raise collector.error()


def load_document(source: str | os.PathLike[str]) -> tuple[Place, str]:
    """A YAML file as a place, for other languages that are read with the same shapes.

    Args:
        source: path of the file.

    Returns:
        The document, and the SHA-256 of the file's bytes.

    Raises:
        SpecError: the file cannot be read, or is not YAML as it is allowed here.
    """
    collector = ProblemCollector(os.fsdecode(source))
    data = _read_file(source, collector)
    return Place(compose(decode(data, collector), collector), "", collector), hashlib.sha256(data).hexdigest()


def parse_spec(text: str | bytes, file: str = "<spec>", files: Mapping[str, bytes] | None = None) -> DesignSpec:
    """The spec in a text; reads no disk.

    Args:
        text: YAML.
        file: what messages call it.
        files: contents of the files that the spec names, by the names it gives them.

    Raises:
        SpecError: not a usable spec; carries every problem found.
        DomainError: something else than a text.
    """
    if not isinstance(text, str | bytes):
        raise DomainError(f"{text!r:.100} is no text of a spec; give it in YAML; load_spec takes a path or a dict")
    collector = ProblemCollector(file)
    return _parse(to_bytes(text, collector), collector, contents_reader(files or {}))


def packaged_spec(package: str, path: str) -> DesignSpec:
    """The spec in a file that comes with a package.

    Args:
        package: its name.
        path: from the package's folder, with "/".
    """
    return parse_spec(_packaged(package, path), path)


def packaged_system(package: str, path: str) -> SystemSpec:
    """The system in a file that comes with a package, its specs beside it; arguments as for `packaged_spec`."""

    def load_beside(name_in_system: str) -> DesignSpec:
        return packaged_spec(package, posixpath.normpath(posixpath.join(posixpath.dirname(path), name_in_system)))

    collector = ProblemCollector(path)
    return load_system(
        _parse_any(to_bytes(_packaged(package, path), collector), collector, load_beside, contents_reader({}))
    )


def _packaged(package: str, path: str) -> bytes:
    return package_files(package).joinpath(*path.split("/")).read_bytes()


def _parse_any(
    data: bytes, collector: ProblemCollector, loader: SpecLoader, read: FileReader
) -> DesignSpec | SystemSpec:
    place = Place(compose(decode(data, collector), collector), "", collector)
    if not is_system(place):
        return _parse(data, ProblemCollector(collector.file), read)
    found = read_system(place, hashlib.sha256(data).hexdigest(), loader, read)
    if found is None:
        raise collector.error()
    return found


def _parse(data: bytes, collector: ProblemCollector, read: FileReader) -> DesignSpec:
    document = compose(decode(data, collector), collector)
    spec = read_spec(Place(document, "", collector), hashlib.sha256(data).hexdigest(), read)
    if spec is None:
        raise collector.error()
    found = replace(spec, source=data, content_sha256=content_digest(spec), digest=content_digest)
    found = replace(found, as_read=found)
    # not an argument of the class: `dataclasses.replace` leaves it at False
    object.__setattr__(found, "is_as_read", True)
    return found


def _read_file(path: str | os.PathLike[str], collector: ProblemCollector) -> bytes:
    try:
        data = read_bytes(path, MAX_BYTES)
    except FileNotFoundError:
        collector.stop(Mark(1, 1), "", "there is no such file; check the path, or write one with `fopi init`")
    except IsADirectoryError:
        collector.stop(Mark(1, 1), "", "this is a directory; give the spec file in it")
    except OSError as error:
        collector.stop(Mark(1, 1), "", f"cannot be read ({_reason(error)}); check the path and its permissions")
    return to_bytes(data, collector)


def folder_reader(spec: str | os.PathLike[str]) -> FileReader:
    """A reader of files whose paths are relative to a spec's folder."""
    folder = os.path.dirname(os.fsdecode(spec))

    def read(name: str) -> bytes:
        path = os.path.join(folder, name)
        try:
            return read_bytes(path, MAX_SAMPLES_BYTES)
        except FileNotFoundError:
            raise UnreadableError(f"there is no file {path!r}; write its path as seen from the spec's folder") from None
        except OSError as error:
            raise UnreadableError(f"{path!r} cannot be read ({_reason(error)}); give a CSV file") from None

    return read


def contents_reader(files: Mapping[str, bytes]) -> FileReader:
    """A reader of contents that are given by the names that a spec uses."""

    def read(name: str) -> bytes:
        if name in files:
            return files[name]
        raise UnreadableError(
            f"{quoted(name)} is not there: a spec that is no file has no folder; load it from a file, or give `files`"
        )

    return read


def _reason(error: OSError) -> str:
    return error.strerror or str(error)
