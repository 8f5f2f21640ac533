"""Bytes or text to text that YAML may contain, with a message for what is not UTF-8."""

from __future__ import annotations

import re

from fopi_tune.spec.yaml.report import Mark, Report

MAX_BYTES = 128 * 1024
# what YAML 1.2.2's production [1] c-printable leaves out, and U+FEFF
_NOT_PRINTABLE = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x84\x86-\x9f\ud800-\udfff\ufeff\ufffe\uffff]")
_BYTE_ORDER_MARKS = {b"\xef\xbb\xbf": "UTF-8", b"\xff\xfe": "UTF-16", b"\xfe\xff": "UTF-16"}


def to_bytes(text: str | bytes, report: Report) -> bytes:
    """The bytes of a spec, no more than `MAX_BYTES`.

    Raises:
        SpecError: too many, or `text` holds half of a surrogate pair.
    """
    if isinstance(text, str):
        try:
            text = text.encode("utf-8")
        except UnicodeEncodeError as error:
            message = f"contains the character U+{ord(text[error.start]):04X}, which is not text; remove it"
            report.stop(_place(text[: error.start]), "", message)
    if len(text) > MAX_BYTES:
        message = f"the file is larger than {MAX_BYTES // 1024} KiB; a spec is a few KiB: is this the right file?"
        report.stop(Mark(1, 1), "", message)
    return text


def decode(data: bytes, report: Report) -> str:
    """UTF-8 without byte order mark to text.

    Raises:
        SpecError: another encoding, or a control character.
    """
    for byte_order_mark, encoding in _BYTE_ORDER_MARKS.items():
        if data.startswith(byte_order_mark):
            message = f"begins with a byte order mark ({encoding}); save the file as UTF-8 without byte order mark"
            report.stop(Mark(1, 1), "", message)
    try:
        text = data.decode("utf-8")
    except UnicodeDecodeError as error:
        before = data[: error.start].decode("utf-8")
        message = f"byte 0x{data[error.start]:02x} is not UTF-8; save the file as UTF-8"
        report.stop(_place(before), "", message)
    if bad := _NOT_PRINTABLE.search(text):
        message = f"contains the control character U+{ord(bad.group()):04X}; remove it, or save the file as UTF-8"
        report.stop(_place(text[: bad.start()]), "", message)
    return text


def _place(before: str) -> Mark:
    """The place right after `before`."""
    lines = re.split("\r\n|\r|\n", before)
    return Mark(len(lines), len(lines[-1]) + 1)
