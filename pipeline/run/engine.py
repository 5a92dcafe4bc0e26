"""The engine: the process that runs Luigi and forks a worker for every task.

The command line starts it with `python -P -m pipeline.run.engine EVENTS PARENT`: the pipe's descriptor for its
events and the process that it dies with; the request comes on standard input. It stays apart from the
command line so that the screen never forks, and so that killing one process ends everything at once.
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
    """Luigi on one machine: nothing is forgotten or tried again while a run lasts, each task has its own process."""

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
            check_unfulfilled_deps=False,  # a task reads what it needs, and says better what is wrong with it
        )


def run(request: Request, notify: Listener) -> None:
    """Bring every requested sequence as far as it goes. Raises InputError for a request that cannot be met."""
    artifacts.sweep(request.workdir)
    jobs = [job for job in plan(request, notify) if announce(job)]
    tasks = upstream_first(task for job in jobs for task in final_tasks(job))
    prioritise([final_tasks(job) for job in jobs], request.workers)
    ingests = [IngestTask(job=job) for job in jobs]
    ingest(ingests, {task.stage for task in tasks if not task.complete()}, request.workers)
    tasks = upstream_first(task for ingest in ingests if ingest.complete() for task in final_tasks(ingest.job))
    pending = [task for task in tasks if not task.complete()]  # also one that is missing before complete ones
    if pending:
        preload({task.stage for task in pending})
        check_plugins(request.config)
        build(pending, request.workers)


def announce(job: Job) -> bool:
    """Tell what is to be made of a sequence. False, and a failure is told, where its folder cannot be looked into."""
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
    """Ingest, first of all, so that bad input is told at once; and preload the pending stages meanwhile.

    Not so for a single sequence: it may be bad input, and then there is nothing to preload for.
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
    """Run tasks and all that they need. How it went is told by their events and by what is complete."""
    luigi.build(
        tasks,
        worker_scheduler_factory=LocalLuigi(),
        local_scheduler=True,
        workers=workers,
        log_level="WARNING",
    )


def preload(stages: Iterable[str]) -> None:
    """Import stages once, so that workers, which are forked, need not: torch alone takes seconds.

    Importing is all that may happen here. Numeric work in a process that forks leaves its children waiting
    for threads that they do not have. What was imported stays, so no garbage collection looks at it, neither
    meanwhile nor in a worker, which would come to copy it all.
    """
    gc.disable()
    for module in ("zarr", *(f"stages.{stage}.stage" for stage in stages)):
        with contextlib.suppress(Exception):  # the worker meets the same error, and reports it as the stage's
            importlib.import_module(module)
    package_versions()
    gc.freeze()
    gc.enable()


@StageTask.event_handler(luigi.Event.DEPENDENCY_MISSING)
def report_unknown(task: StageTask) -> None:
    """Luigi could not find out whether a task is complete, and does not say why."""
    try:
        task.complete()
    except Exception as error:
        task.fail(error)


@StageTask.event_handler(luigi.Event.PROCESS_FAILURE)
def report_dead_worker(task: StageTask, luigi_message: str) -> None:
    """A worker that was killed, or crashed, could not record its failure itself."""
    if task.complete():
        return  # it crashed on its way out, after its work was done
    code = int(re.findall(r"-?\d+", luigi_message)[-1])
    hint = " (most often for lack of memory)" if code == -signal.SIGKILL else ""
    task.fail(ProcessDied(f"its process ended without a word: {how_it_ended(code)}{hint}"))


def main() -> None:
    events, parent = map(int, sys.argv[1:])
    die_with_parent(parent)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the command line, which ends us
    faulthandler.enable(2)  # a crash in a C library leaves its traceback: a worker's goes to its log
    multiprocessing.set_start_method("fork")
    sys.path.append(os.getcwd())  # for the user's own stage functions; last, so that nothing of ours is shadowed
    notify = write_to_pipe(events)
    try:
        run(Request.model_validate_json(sys.stdin.buffer.read()), notify)
    except InputError as error:
        notify(Event(kind="refused", message=str(error)))
    except (OSError, MemoryError) as error:
        sys.exit(one_line(error))  # the last line that the command line hears


if __name__ == "__main__":
    main()
