import errno
import os
from pathlib import Path

import pytest
from pydantic import ValidationError

from pipeline.run.failures import ProcessDied, one_line
from pipeline.store.artifacts import CorruptArtifactError, UnreadableArtifactError
from schemas.errors import InputError
from schemas.model_file import ModelPart


def os_error(code, *names):
    return OSError(code, os.strerror(code), *names)


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (InputError("a.ply: found\nnothing"), "a.ply: found nothing"),
        (ProcessDied("it was killed"), "it was killed"),
        (ValueError("odd"), "ValueError: odd"),
        (os_error(errno.ENOSPC, "out/model.npz"), "out/model.npz: No space left on device; free some space"),
        (os_error(errno.ENOSPC), "input or output: No space left on device; free some space"),
        (os_error(errno.EACCES, b"\xff"), "Permission denied; check its permissions"),
        (os_error(errno.ENOENT, "a", None, "b"), "b: No such file or directory; see to that"),
        (os_error(errno.ENAMETOOLONG, "a" * 999), "a...: found a name too long for this system; give a shorter one"),
        (MemoryError("8 GiB"), "found too little memory (8 GiB); allow more"),
        (OSError("no code"), "OSError: no code"),
        (RuntimeError("DefaultCPUAllocator: can't allocate memory"), "found too little memory"),
        (RuntimeError("odd"), "RuntimeError: odd"),
    ],
)
def test_an_exception_is_one_line_with_what_to_do(error, said):
    line = one_line(error)
    assert said in line
    assert "\n" not in line
    assert len(line) < 400


def test_an_artifact_that_could_not_be_read_is_not_called_corrupt():
    lines = [one_line(kind(Path("flow-0"), "odd")) for kind in (CorruptArtifactError, UnreadableArtifactError)]
    assert ["remove" in line for line in lines] == [True, False]


def test_a_value_that_does_not_fit_its_schema_is_told_without_pydantics_link():
    with pytest.raises(ValidationError) as caught:
        ModelPart(id=0, name="part_0", point_count=-5)
    line = one_line(caught.value)
    assert line == "ModelPart.point_count: Input should be greater than or equal to 0 (found -5)"
