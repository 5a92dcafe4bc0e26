"""Names that become parts of paths."""

from __future__ import annotations

import re
from typing import Annotated

from pydantic import AfterValidator

_NAME = re.compile(r"\w[\w.-]*")


def is_name(text: object) -> bool:
    """Whether a text is a safe file name: letters, digits, `_`, `.` and `-`, not starting with `.` or `-`."""
    return isinstance(text, str) and _NAME.fullmatch(text) is not None


def _checked(text: str) -> str:
    if not is_name(text):
        raise ValueError(f"found {text[:40]!r}, expected letters, digits, '_', '.' and '-', and no '.' or '-' first")
    return text


Name = Annotated[str, AfterValidator(_checked)]
