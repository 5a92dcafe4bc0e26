import json
from datetime import UTC, datetime

import pytest
from pydantic import ValidationError

from schemas.manifest import Failure, Manifest

CONTENT = {
    "stage": "flow",
    "version": 1,
    "dataset": "scans",
    "sequence": "box",
    "key": "0123456789abcdef",
    "parameters": {},
    "config": {"seed": 0},
    "upstream": {"ingest": "fedcba9876543210"},
    "seed": 0,
    "created": "2026-01-01T00:00:00Z",
    "seconds": {"read": 0.1, "compute": 1e-9},
    "packages": {"numpy": "2"},
    "arrays": [
        {"name": "flow", "dtype": "float64", "shape": [2, 3], "dims": ["matches", "3"], "unit": "1", "digest": "ab"}
    ],
    "payload": {"energy": float("inf")},
    "files": {"arrays.zarr/zarr.json": "cd"},
    "digest": "ef",
}


def test_a_manifest_survives_json_with_infinite_numbers():
    manifest = Manifest.model_validate(CONTENT)
    assert Manifest.model_validate_json(manifest.model_dump_json()) == manifest
    assert Manifest.model_validate(json.loads(json.dumps(manifest.model_dump(mode="json")))) == manifest


@pytest.mark.parametrize("field", sorted(CONTENT))
def test_no_field_of_a_manifest_may_be_missing(field):
    with pytest.raises(ValidationError, match=field):
        Manifest.model_validate({name: value for name, value in CONTENT.items() if name != field})


@pytest.mark.parametrize("change", [{"schema_version": 2}, {"surprise": 1}, {"arrays": [{"name": "x"}]}])
def test_other_manifests_are_refused(change):
    with pytest.raises(ValidationError):
        Manifest.model_validate(CONTENT | change)


def test_a_failure_survives_json():
    failure = Failure(
        stage="flow", key="0", error="ValueError", message="why", bad_input=False, time=datetime.now(UTC), log="x.log"
    )
    assert Failure.model_validate_json(failure.model_dump_json()) == failure
