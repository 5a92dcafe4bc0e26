"""What is said of a value that does not fit its schema is one short line, the same everywhere."""

import json

import pytest
from pydantic import Field, ValidationError, field_validator, model_validator

from schemas.artifact import Schema
from schemas.errors import first_fault
from schemas.model_file import ModelFile


class Inner(Schema):
    size: int = Field(default=1, gt=0)
    name: str = "a"
    pair: tuple[int, ...] = ()

    @field_validator("name")
    @classmethod
    def _plain(cls, value):
        if "/" in value:
            raise ValueError(f"found {value!r}, expected no '/'")
        return value

    @field_validator("pair")
    @classmethod
    def _ordered(cls, value):
        if list(value) != sorted(value):
            raise ValueError("expected the least first")
        return value


class Outer(Schema):
    inner: Inner = Inner()
    count: int = 2

    @model_validator(mode="after")
    def _even(self):
        if self.count % 2:
            raise ValueError(f"Outer.count: found {self.count}, expected an even one")
        return self


def fault(content, within=""):
    with pytest.raises(ValidationError) as caught:
        Outer.model_validate_json(content if isinstance(content, str) else json.dumps(content))
    line = first_fault(caught.value, within)
    assert line.isprintable()
    assert len(line) < 600
    assert "Value error" not in line
    assert "pydantic" not in line
    return line


@pytest.mark.parametrize(
    ("content", "line"),
    [
        ({"inner": {"size": -5}}, "inner.size: Input should be greater than 0 (found -5)"),
        ({"inner": {"size": "x" * 99}}, f"inner.size: {{}} (found '{'x' * 39}...)"),
        ({"inner": {"size": -(10**90)}}, "inner.size: Input should be greater than 0 (found a huge number)"),
        ({"inner": {"name": "a/b"}}, "inner.name: found 'a/b', expected no '/'"),
        ({"inner": {"pair": [2, 1]}}, "inner.pair: expected the least first"),
        ({"inner": []}, "inner: {}"),
        ({"count": 3}, "Outer.count: found 3, expected an even one"),
        ({"other": 3}, "other: Extra inputs are not permitted (found 3)"),
        ({"o\n\x1bther": 3}, "o \\x1bther: Extra inputs are not permitted (found 3)"),
        ("[]", "the file: {}"),
        ("{", "the file: Invalid JSON: {}"),
    ],
)
def test_the_first_fault_is_the_field_and_what_is_wrong(content, line):
    start, _, end = line.partition("{}")
    found = fault(content)
    assert found.startswith(start)
    assert found.endswith(end)
    assert end or "{}" in line or found == line


def test_what_the_value_is_of_goes_before_the_field():
    assert fault({"inner": {"size": 0}}, "Outer").startswith("Outer.inner.size: ")
    assert fault([], "Outer").startswith("Outer: ")
    assert fault({"count": 3}, "Outer").startswith("Outer.count: found 3")


def test_long_and_strange_words_of_the_input_are_cut(samples):
    fault({"x" * 100_000: 1})
    content = json.loads(samples["result"].model.model_dump_json())
    content["joints"][0] |= {"name": "a\x1b[2J\n" + "b" * 100_000, "lower": 9e9}
    with pytest.raises(ValidationError) as caught:
        ModelFile.model_validate(content)
    line = first_fault(caught.value)
    assert line.startswith("joint a\\x1b[2J b")
    assert len(line) < 600
