"""Content keys: the same key means the same input, the same settings and the same code."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any

KEY_DIGITS = 16


def canonical_json(value: Any) -> str:
    """JSON with one spelling for one value: keys sorted, no spaces, ASCII."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"))


def artifact_key(
    *,
    stage: str,
    version: int,
    config: Mapping[str, Any],
    parameters: Mapping[str, Any],
    upstream: Mapping[str, str],
    seed: int,
) -> str:
    """The key of what a stage writes, from everything that its output depends on.

    `config` is the stage's own slice of the configuration and `upstream` the keys of what it reads, so
    that a changed setting gives new keys to its own stage and to all that follow, and to no other.
    """
    identity = [stage, version, config, parameters, upstream, seed]
    return hashlib.sha256(canonical_json(identity).encode()).hexdigest()[:KEY_DIGITS]
