"""The engine: the process that runs Luigi and forks a worker for every task.

The command line starts it with `python -P -m pipeline.run.engine EVENTS PARENT` and sends the request on standard
input. EVENTS is the descriptor of the pipe for its events, PARENT the process that it dies with. It is separate from
the command line, so that the process with the display never forks, and so that killing one process ends everything.
"""

from __future__ import annotations

import contextlib
import faulthandler
import gc
import importlib
import multiprocessing
import os
import re
import signal
import sys
from collections.abc import Collection, Iterable, Sequence

from pipeline.run.failures import ProcessDied, one_line
from pipeline.run.isolated_luigi import luigi
from pipeline.run.order import prioritise
from pipeline.run.plan import origin_of, plan
from pipeline.run.plugins import check_plugins
from pipeline.run.processes import die_with_forking_parent, die_with_parent, how_it_ended
from pipeline.run.protocol import Event, Listener, Request, write_to_pipe
from pipeline.run.task import Job, StageTask, package_versions, upstream_first
from pipeline.run.tasks import IngestTask, final_tasks
from pipeline.store import artifacts
from schemas.errors import InputError


class LocalLuigi:
    """Luigi on one machine. It forgets and retries nothing during a run, and runs each task in its own process."""

    def create_local_scheduler(self) -> luigi.scheduler.Scheduler:
        return luigi.scheduler.Scheduler(
            prune_on_get_work=False, record_task_history=False, stable_done_cooldown_secs=0
        )

    def create_worker(
        self, scheduler: luigi.scheduler.Scheduler, worker_processes: int, assistant: bool = False
    ) -> luigi.worker.Worker:
        return luigi.worker.Worker(
            scheduler=scheduler,
            worker_processes=worker_processes,
            force_multiprocessing=True,
            wait_interval=0.2,
            send_failure_email=False,
            check_unfulfilled_deps=False,  # a task reads its inputs, with better messages
        )


def run(request: Request, notify: Listener) -> None:
    """Bring every requested sequence as far as possible. Raises InputError for a request that cannot be met."""
    artifacts.sweep(request.workdir)
    jobs = [job for job in plan(request, notify) if announce(job)]
    tasks = upstream_first(task for job in jobs for task in final_tasks(job))
    prioritise([final_tasks(job) for job in jobs], request.workers)
    ingests = [IngestTask(job=job) for job in jobs]
    ingest(ingests, {task.stage for task in tasks if not task.complete()}, request.workers)
    tasks = upstream_first(task for ingest in ingests if ingest.complete() for task in final_tasks(ingest.job))
    pending = [task for task in tasks if not task.complete()]  # a missing artifact may precede complete ones
    if pending:
        preload({task.stage for task in pending})
        check_plugins(request.config)
        build(pending, request.workers)


def announce(job: Job) -> bool:
    """Report the planned tasks of a sequence. If its folder cannot be read, report a failure and return False."""
    origin = origin_of(job.source)
    for task in upstream_first(final_tasks(job)):
        try:
            complete = task.complete()
        except artifacts.UnreadableArtifactError as error:
            task.fail(error)
            return False
        task.tell("planned", complete=complete, origin=origin)
    return True


def ingest(tasks: Sequence[StageTask], pending: Collection[str], workers: int) -> None:
    """Ingest first, so that bad input is reported at once, and preload the pending stages meanwhile.

    A single sequence is ingested before preloading: if it is bad input, no stage is needed.
    """
    if not pending:
        return
    preload(["ingest"])
    if len(tasks) == 1:
        build(tasks, workers)
        return
    ingesting = multiprocessing.Process(target=_build_beside, args=(tasks, workers))
    ingesting.start()
    preload(pending)
    ingesting.join()
    if ingesting.exitcode:
        raise RuntimeError(f"ingest ended unexpectedly ({how_it_ended(ingesting.exitcode)})")


def _build_beside(tasks: Sequence[StageTask], workers: int) -> None:
    die_with_forking_parent()
    build(tasks, workers)


def build(tasks: Sequence[StageTask], workers: int) -> None:
    """Run tasks and all that they need. Their events and the complete artifacts show the outcome."""
    luigi.build(
        tasks,
        worker_scheduler_factory=LocalLuigi(),
        local_scheduler=True,
        workers=workers,
        log_level="WARNING",
    )


def preload(stages: Iterable[str]) -> None:
    """Import stages once, so that forked workers need not: torch alone takes seconds.

    Nothing but imports may happen here. After numeric work in a forking process, its children would wait for threads
    that they do not have. The imported objects are frozen, so that no garbage collection visits them. In a worker that
    would copy their memory.
    """
    gc.disable()
    for module in ("zarr", *(f"stages.{stage}.stage" for stage in stages)):
        with contextlib.suppress(Exception):  # the worker meets the same error and reports it
            importlib.import_module(module)
    package_versions()
    gc.freeze()
    gc.enable()


@StageTask.event_handler(luigi.Event.DEPENDENCY_MISSING)
def report_unknown(task: StageTask) -> None:
    """Report a task whose completeness Luigi could not determine. Luigi does not pass on the reason."""
    try:
        task.complete()
    except Exception as error:
        task.fail(error)


@StageTask.event_handler(luigi.Event.PROCESS_FAILURE)
def report_dead_worker(task: StageTask, luigi_message: str) -> None:
    """Report a worker that was killed or crashed, and so could not report its failure itself."""
    if task.complete():
        return  # it crashed at its exit, after its work was done
    code = int(re.findall(r"-?\d+", luigi_message)[-1])
    hint = " (most often for lack of memory)" if code == -signal.SIGKILL else ""
    task.fail(ProcessDied(f"its process ended without a word: {how_it_ended(code)}{hint}"))


def main() -> None:
    events, parent = map(int, sys.argv[1:])
    die_with_parent(parent)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the command line, which ends us
    faulthandler.enable(2)  # print the traceback of a crash in a C library; a worker's goes to its log
    multiprocessing.set_start_method("fork")
    sys.path.append(os.getcwd())  # for the user's own stage functions; last, so that it shadows none of our modules
    notify = write_to_pipe(events)
    try:
        run(Request.model_validate_json(sys.stdin.buffer.read()), notify)
    except InputError as error:
        notify(Event(kind="refused", message=str(error)))
    except (OSError, MemoryError) as error:
        sys.exit(one_line(error))  # the last line that the command line reads


if __name__ == "__main__":
    main()
