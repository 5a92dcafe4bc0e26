"""Content keys. The same key means the same input, settings and code."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any

KEY_DIGITS = 16


def canonical_json(value: Any) -> str:
    """Serialise to JSON with one form for each value: sorted keys, no spaces, ASCII."""
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
    """The key of a stage's artifact, from everything that the artifact depends on.

    `config` is the stage's own section of the configuration, and `upstream` the keys of the artifacts that it reads. So
    a changed setting gives new keys to its own stage and to all later ones, and to no others.
    """
    identity = [stage, version, config, parameters, upstream, seed]
    return hashlib.sha256(canonical_json(identity).encode()).hexdigest()[:KEY_DIGITS]
