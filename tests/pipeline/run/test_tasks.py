import importlib
import inspect
import os
import pkgutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import get_args

import pytest
from pydantic import ValidationError

import stages
from pipeline.run.task import upstream_first
from pipeline.run.tasks import STAGES, TASKS, AlignmentTask, FlowTask, IngestTask, final_tasks
from schemas.artifact import Schema
from schemas.config import CanonicalFrameConfig, PipelineConfig
from schemas.errors import InputError

NO_STAGES = {"kernels", "support", "rearticulation"}
HEAVY = {"torch", "open3d", "scipy", "networkx", "sklearn", "matplotlib"}
VALUES = (True, False, 2, 3, 100, 0.5, 1.5, "metre", "mine:function", Path("other"), (1.0, 2.0), (1,), ("spherical",))
VALUES += ((1.0, 2.0, 3.0), (0.0, 0.0, 0.0, 1.0, 1.0, 1.0))


def leaves(config, prefix=()):
    """The path of every single setting."""
    for name in type(config).model_fields:
        value = getattr(config, name)
        if isinstance(value, Schema):
            yield from leaves(value, (*prefix, name))
        else:
            yield (*prefix, name)


def changed(config, path):
    """The configuration with one setting changed to another value that is allowed."""
    document = config.model_dump()
    section, field = document, PipelineConfig
    for name in path[:-1]:
        section, field = section[name], field.model_fields[name].annotation
    for other in (*get_args(field.model_fields[path[-1]].annotation), *VALUES):
        section[path[-1]] = other
        try:
            new = PipelineConfig.model_validate(document)
        except ValidationError:
            continue
        if new != config:
            return new
    raise AssertionError(f"{'.'.join(path)}: found no other value that is allowed")


def tasks_of(tiny, config):
    return {task.label: task for task in upstream_first(final_tasks(tiny.job(config)))}


@pytest.mark.parametrize("path", list(leaves(PipelineConfig())), ids=".".join)
def test_a_stage_sees_no_setting_that_its_key_does_not_cover(tiny, path):
    before, after = (tasks_of(tiny, config) for config in (PipelineConfig(), changed(PipelineConfig(), path)))
    seeing = set()
    for label in before.keys() & after.keys():
        old, new = before[label], after[label]
        if old.settings != new.settings:
            assert old.key != new.key
            seeing.add(old.stage)
        elif (old.upstream_keys(), old.parameters()) == (new.upstream_keys(), new.parameters()) and path != ("seed",):
            assert old.key == new.key
    assert seeing == {task.stage for task in TASKS if path[0] in {task.stage, *task.also}}


def test_settings_of_other_stages_are_those_of_stages_further_up(tiny):
    for task in tasks_of(tiny, PipelineConfig()).values():
        further_up = {other.stage for other in upstream_first([task])} - {task.stage}
        assert set(task.also) <= further_up


@pytest.mark.parametrize("task", TASKS, ids=STAGES)
def test_what_computes_cannot_reach_the_job(task):
    for name in ("compute", "files"):
        assert isinstance(inspect.getattr_static(task, name), staticmethod)


def test_settings_that_were_not_declared_cannot_be_read(tiny):
    settings = FlowTask(job=tiny.job()).settings
    assert vars(settings) == {"flow": PipelineConfig().flow}
    with pytest.raises(AttributeError, match="canonical_frame"):
        settings.canonical_frame  # noqa: B018


def test_every_room_of_stages_has_the_version_of_its_task_or_is_no_stage():
    assert {module.name for module in pkgutil.iter_modules(stages.__path__)} == {*STAGES, *NO_STAGES}
    for task in TASKS:
        assert task.version == sys.modules[f"stages.{task.stage}"].VERSION


def test_keys_are_known_without_importing_what_computes():
    code = "import sys, pipeline.run.tasks; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True, env=os.environ)
    imported = set(done.stdout.split())
    assert not imported & HEAVY
    assert not imported & {f"stages.{stage}.stage" for stage in STAGES}


@pytest.mark.parametrize("stage", STAGES)
def test_a_stage_is_computed_by_the_function_that_bears_its_name(stage):
    assert callable(getattr(importlib.import_module(f"stages.{stage}.stage"), f"compute_{stage}"))


def test_a_canonical_frame_that_is_not_there_is_told_before_any_work(tiny, samples, monkeypatch):
    def estimate(*args):
        raise AssertionError("frames are aligned first")

    monkeypatch.setattr("stages.alignment.stage.compute_alignment", estimate)
    monkeypatch.setattr(IngestTask, "read", lambda task: SimpleNamespace(sequence=samples["sequence"]))
    job = tiny.job(PipelineConfig(canonical_frame=CanonicalFrameConfig(frames=(1, 99))))
    with pytest.raises(InputError, match=r"canonical_frame\.frames: found 99, expected 0\.\.2"):
        AlignmentTask(job=job).run()
