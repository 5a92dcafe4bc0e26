from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.run.tasks import FlowTask
from schemas.config import CanonicalFrameConfig, PipelineConfig
from schemas.errors import InputError
from stages.support.progress import silent


def test_a_canonical_frame_that_is_not_there_is_told_before_the_flow(tiny, samples, monkeypatch):
    def estimate(*args):
        raise AssertionError("the flow is computed first")

    monkeypatch.setattr("stages.flow.estimate_flow", estimate)
    job = tiny.job(PipelineConfig(canonical_frame=CanonicalFrameConfig(frames=(1, 99))))
    inputs = {"ingest": SimpleNamespace(sequence=samples["sequence"])}
    with pytest.raises(InputError, match=r"canonical_frame\.frames: found 99, expected 0\.\.2"):
        FlowTask(job=job).compute(inputs, np.random.default_rng(0), silent)
