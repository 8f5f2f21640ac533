"""Files and text to `DesignSpec`; the only module of the library, besides the command line, that reads the disk."""

from __future__ import annotations

import hashlib
import os

from fopi_tune.spec.encoding import MAX_BYTES, decode, to_bytes
from fopi_tune.spec.language import read_spec
from fopi_tune.spec.model import DesignSpec, SystemSpec
from fopi_tune.spec.nodes import compose
from fopi_tune.spec.places import Place
from fopi_tune.spec.report import Mark, Report
from fopi_tune.spec.systems import is_system, read_system


def load_spec(source: str | os.PathLike[str] | DesignSpec) -> DesignSpec:
    """The spec in a file.

    Args:
        source: path of a YAML file; a `DesignSpec` is returned as it is.

    Raises:
        SpecError: the file cannot be read, or is not a usable spec; carries every problem found.
    """
    if isinstance(source, DesignSpec):
        return source
    report = Report(os.fsdecode(source))
    return _parse(_read_file(source, report), report)


def load_any(source: str | os.PathLike[str] | DesignSpec | SystemSpec) -> DesignSpec | SystemSpec:
    """The spec or the system in a file.

    Args:
        source: path of a YAML file; what is read already is returned as it is.

    Raises:
        SpecError: the file, or a spec that a system names, cannot be read or used; carries every problem found.
    """
    if isinstance(source, DesignSpec | SystemSpec):
        return source
    report = Report(os.fsdecode(source))
    data = _read_file(source, report)
    place = Place(compose(decode(data, report), report), "", report)
    if not is_system(place):
        return _parse(data, Report(report.file))
    folder = os.path.dirname(report.file)
    found = read_system(place, hashlib.sha256(data).hexdigest(), lambda path: load_spec(os.path.join(folder, path)))
    if found is None:
        raise report.error()
    return found


def load_system(source: str | os.PathLike[str] | SystemSpec) -> SystemSpec:
    """The system in a file.

    Args:
        source: path of a YAML file; a `SystemSpec` is returned as it is.

    Raises:
        SpecError: as for `load_any`, or the file is a spec.
    """
    found = source if isinstance(source, SystemSpec) else load_any(source)
    if isinstance(found, SystemSpec):
        return found
    report = Report(found.name if isinstance(source, SystemSpec | DesignSpec) else os.fsdecode(source))
    report.refuse(Mark(1, 1), "", "this is a spec, no system; a system has a section `system`")
    raise report.error()


def load_document(source: str | os.PathLike[str]) -> tuple[Place, str]:
    """A YAML file as a tree of places, for languages that are read with the shapes of this one.

    Returns:
        The document, and the SHA-256 of the file's bytes.

    Raises:
        SpecError: the file cannot be read, or is not YAML as it is allowed here.
    """
    report = Report(os.fsdecode(source))
    data = _read_file(source, report)
    return Place(compose(decode(data, report), report), "", report), hashlib.sha256(data).hexdigest()


def parse_spec(text: str | bytes, file: str = "<spec>") -> DesignSpec:
    """The spec in a text.

    Args:
        text: YAML.
        file: what messages call it.

    Raises:
        SpecError: not a usable spec; carries every problem found.
    """
    report = Report(file)
    return _parse(to_bytes(text, report), report)


def _parse(data: bytes, report: Report) -> DesignSpec:
    document = compose(decode(data, report), report)
    spec = read_spec(Place(document, "", report), hashlib.sha256(data).hexdigest())
    if spec is None:
        raise report.error()
    return spec


def _read_file(path: str | os.PathLike[str], report: Report) -> bytes:
    try:
        with open(path, "rb") as file:
            data = file.read(MAX_BYTES + 1)  # one more than allowed shows that there is more
    except FileNotFoundError:
        report.stop(Mark(1, 1), "", "there is no such file; check the path, or write one with `fopi init`")
    except IsADirectoryError:
        report.stop(Mark(1, 1), "", "is a directory; give the spec file in it")
    except (OSError, ValueError) as error:  # ValueError: a NUL in the path
        reason = (error.strerror if isinstance(error, OSError) else None) or str(error)
        report.stop(Mark(1, 1), "", f"cannot be read ({reason}); check the path and its permissions")
    return to_bytes(data, report)
