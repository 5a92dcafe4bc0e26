import json
import subprocess
import sys

import pytest

from pipeline.store.keys import artifact_key, canonical_json

BASE = {
    "stage": "flow",
    "version": 1,
    "config": {"estimator": "geometric", "nodes": 250},
    "parameters": {"candidate": 0},
    "upstream": {"ingest": "0123456789abcdef"},
    "seed": 0,
}


@pytest.mark.parametrize(
    "change",
    [
        {"stage": "ingest"},
        {"version": 2},
        {"config": {"estimator": "geometric", "nodes": 251}},
        {"config": {"estimator": "geometric"}},
        {"parameters": {"candidate": 1}},
        {"parameters": {"frame": 0}},
        {"upstream": {"ingest": "0123456789abcdee"}},
        {"upstream": {"sequence": "0123456789abcdef"}},
        {"seed": 1},
    ],
)
def test_whatever_the_output_depends_on_changes_the_key(change):
    assert artifact_key(**BASE | change) != artifact_key(**BASE)


def test_the_order_of_names_does_not_change_the_key():
    config = dict(reversed(BASE["config"].items()))
    assert artifact_key(**BASE | {"config": config}) == artifact_key(**BASE)


def test_a_key_is_the_same_in_every_process():
    program = (
        "import json, sys; from pipeline.store.keys import artifact_key; print(artifact_key(**json.load(sys.stdin)))"
    )
    answers = {
        subprocess.run(
            [sys.executable, "-c", program],
            input=json.dumps(BASE),
            env={"PYTHONHASHSEED": seed},
            capture_output=True,
            text=True,
            check=True,
        ).stdout.strip()
        for seed in ("1", "2")
    }
    assert answers == {artifact_key(**BASE)}


def test_a_key_is_sixteen_hexadecimal_digits():
    key = artifact_key(**BASE)
    assert len(key) == 16
    assert int(key, 16) >= 0


def test_canonical_json_keeps_values_apart_that_differ():
    values = [1, 1.5, "1", True, None, [1], {"1": 1}, "é", 0.1, 0.1 + 1e-17 + 1e-16]
    assert len({canonical_json(value) for value in values}) == len(values)
