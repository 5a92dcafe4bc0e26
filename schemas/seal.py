"""Files that hold their own digest, so that any changed byte is detected."""

from __future__ import annotations

import hashlib
from pathlib import Path

BLANK = "0" * 64  # placeholder for the digest while it is computed


def sha256(content: bytes) -> str:
    """The digest of a file's bytes."""
    return hashlib.sha256(content).hexdigest()


def file_sha256(path: Path) -> str:
    """The digest of a file, which may be large. Raises OSError."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def sealed(content: bytes) -> bytes:
    """Replace the first BLANK in the content by the content's digest."""
    return content.replace(BLANK.encode(), sha256(content).encode(), 1)


def intact(content: bytes, digest: str) -> bool:
    """Whether sealed content, which holds `digest`, is unchanged."""
    return sha256(content.replace(digest.encode(), BLANK.encode(), 1)) == digest
