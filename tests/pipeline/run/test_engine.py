import json
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

from pipeline.run.processes import ONE_THREAD

TINY = textwrap.dedent(
    """
    import importlib.util, json, multiprocessing, os, signal, sys
    from pathlib import Path
    spec = importlib.util.spec_from_file_location("tiny", sys.argv[1])
    tiny = sys.modules["tiny"] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(tiny)
    from pipeline.run.engine import build, ingest
    multiprocessing.set_start_method("fork")
    pipeline = tiny.TinyPipeline(Path(sys.argv[2]), [])
    sources = [tiny.NumberSource("a"), tiny.NumberSource("b", refuses="load"), tiny.NumberSource("c")]
    """
)

PROGRAM = TINY + textwrap.dedent(
    """
    class KilledTask(tiny.MiddleTask):
        stage = "flow"
        @staticmethod
        def compute(inputs, given):
            os.kill(os.getpid(), signal.SIGKILL)

    class AfterTask(tiny.LastTask):
        stage = "projection"
        def requires(self):
            return {"killed": KilledTask(job=self.job, candidate=0)}

    tasks = [tiny.LastTask(job=pipeline.job(source=source)) for source in sources]
    if "killed" in sys.argv:
        tasks.append(AfterTask(job=pipeline.job(source=sources[0])))
    build(tasks, int(sys.argv[3]))
    print(json.dumps({"failed": [(event.sequence, event.task, event.message) for event in pipeline.events]}))
    """
)

INGEST = TINY + textwrap.dedent(
    """
    class EndsItsParentTask(tiny.FirstTask):
        @staticmethod
        def compute(inputs, given):
            os.kill(os.getppid(), signal.SIGKILL)

    kind = EndsItsParentTask if "killed" in sys.argv else tiny.FirstTask
    ingest([kind(job=pipeline.job(source=source)) for source in sources], ["result"], 2)
    threads = len(os.listdir("/proc/self/task"))
    print(json.dumps({"preloaded": "stages.result.stage" in sys.modules, "threads": threads}))
    """
)


def start(program, workdir, *words, cwd=None):
    conftest = Path(__file__).parents[1] / "conftest.py"
    return subprocess.run(
        [sys.executable, "-c", program, str(conftest), str(workdir), *words],
        capture_output=True,
        text=True,
        timeout=60,
        cwd=cwd,
    )


def run(workdir, workers, *words, cwd=None):
    done = start(PROGRAM, workdir, str(workers), *words, cwd=cwd)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)["failed"]


def complete(workdir):
    return {(path.parts[-3], path.parts[-2].split("-")[0]) for path in workdir.glob("scans/*/*/manifest.json")}


def values(workdir):
    entries = {}
    for path in workdir.glob("scans/*/*/manifest.json"):
        entries[path.parts[-3], path.parts[-2]] = json.loads(path.read_text())["arrays"]
    return entries


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A run whose second sequence is bad input and in which one worker is killed."""
    folder = tmp_path_factory.mktemp("engine")
    (folder / "luigi.cfg").write_text("[worker\nkeep_alive=true\n")  # somebody else's, and broken
    reported = run(folder / "workdir", 2, "killed", cwd=folder)
    return folder / "workdir", reported


def test_a_failed_sequence_stops_no_other(finished):
    workdir, _ = finished
    stages = {"ingest", "merging", "final_fit"}
    assert complete(workdir) == {(name, stage) for name in "ac" for stage in stages}
    assert [path.parent.name for path in workdir.glob("scans/*/ingest-*.failed.json")] == ["b"]


def test_a_killed_worker_is_reported_and_recorded_and_ends_only_its_own_branch(finished):
    workdir, reported = finished
    [(sequence, task, message)] = reported  # the only event of the parent process itself
    assert (sequence, task) == ("a", "flow[0]")
    assert "SIGKILL" in message
    assert [path.parent.name for path in workdir.glob("scans/*/flow-*.failed.json")] == ["a"]
    assert not list(workdir.glob("scans/*/projection-*"))


def test_the_number_of_workers_changes_no_value(finished, tmp_path):
    workdir, _ = finished
    run(tmp_path, 1)
    assert values(tmp_path) == values(workdir)


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="needs Linux's /proc")
def test_many_sequences_are_ingested_while_the_rest_is_preloaded(tmp_path):
    done = start(INGEST, tmp_path)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == {"preloaded": True, "threads": 1}
    assert complete(tmp_path) == {("a", "ingest"), ("c", "ingest")}
    assert [path.parent.name for path in tmp_path.glob("scans/*/ingest-*.failed.json")] == ["b"]


@pytest.mark.skipif(sys.platform != "linux", reason="a worker ends with its parent on Linux only")
def test_an_ingest_that_is_killed_ends_the_engine(tmp_path):
    done = start(INGEST, tmp_path, "killed")
    assert done.returncode == 1
    assert "ingest ended unexpectedly (killed by SIGKILL)" in done.stderr
    assert not complete(tmp_path)


def test_the_engine_still_has_a_single_thread_when_it_forks():
    program = (
        "import os, sys; from pipeline.run.engine import preload; from pipeline.run.tasks import STAGES;"
        "preload(STAGES);"
        "assert 'torch' in sys.modules; print(len(os.listdir('/proc/self/task')))"
    )
    import os

    if not Path("/proc/self/task").exists():
        pytest.skip("needs Linux's /proc")
    done = subprocess.run(
        [sys.executable, "-c", program], check=True, capture_output=True, text=True, env=os.environ | ONE_THREAD
    )
    assert done.stdout.strip() == "1"
