"""Files that hold their own digest: whatever byte of them is changed, it is noticed."""

from __future__ import annotations

import hashlib
from pathlib import Path

BLANK = "0" * 64  # what stands in the digest's place while it is taken


def sha256(content: bytes) -> str:
    """The digest of a file's bytes."""
    return hashlib.sha256(content).hexdigest()


def file_sha256(path: Path) -> str:
    """The digest of a file, which may be large. Raises OSError."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def sealed(content: bytes) -> bytes:
    """The content with its digest in place of the first BLANK."""
    return content.replace(BLANK.encode(), sha256(content).encode(), 1)


def intact(content: bytes, digest: str) -> bool:
    """Whether the content, which holds this digest, is as it was sealed."""
    return sha256(content.replace(digest.encode(), BLANK.encode(), 1)) == digest
