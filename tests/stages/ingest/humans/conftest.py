from __future__ import annotations

import os
from importlib.util import find_spec

import pytest

from stages.ingest.humans.shape import Shape
from stages.ingest.humans.skeleton import Body


@pytest.fixture(scope="session")
def body() -> Body:
    """A grown person. The tests are skipped without the body model, but not in CI, where it is to be there."""
    if find_spec("anny") is None and not os.environ.get("REQUIRE_BODIES"):
        pytest.skip("the package anny is not installed")
    return Body.of(Shape())
