"""Detection of files with a wrong ending, by their first bytes."""

from __future__ import annotations

import re
from pathlib import Path

_LOOKED_AT = 512  # bytes
_HTML = re.compile(rb"\s*(<!doctype html|<html|<head|<\?xml|<svg)", re.IGNORECASE)


def disguise(path: Path) -> str:
    """What a file really is, and what to do, if its first bytes show it; else empty."""
    try:
        with path.open("rb") as file:
            head = file.read(_LOOKED_AT).removeprefix(b"\xef\xbb\xbf")
    except OSError:
        return ""
    if head.startswith(b"version https://git-lfs"):
        return "found a pointer of Git LFS in place of the file; fetch it with `git lfs pull`"
    if head.startswith(b"\x1f\x8b"):
        return "found a file packed by gzip; unpack it with gunzip"
    if head.startswith((b"BZh", b"\xfd7zXZ\0", b"\x28\xb5\x2f\xfd", b"7z\xbc\xaf")):
        return "found a packed file; unpack it"
    if head.startswith(b"PK\x03\x04"):
        return "found a zip archive; unpack it"
    if _HTML.match(head):
        return "found a page of HTML or XML in place of points; download the file again"
    return ""
