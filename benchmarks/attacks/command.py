"""A command line as a user types it, run under limits: what it said, how it ended, what it used and what it left."""

from __future__ import annotations

import contextlib
import os
import pty
import resource
import signal
import subprocess
import sys
import tempfile
import threading
import time
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

REPOSITORY = Path(__file__).parents[2]
SECONDS = 120.0  # that a command may take
GIB = 2.0  # that one of its processes may hold; an ordinary one needs 0.5
ADDRESS_SPACE = 24 * 2**30  # bytes, what the machine is guarded by; the libraries map several GiB
POLL = 0.05  # seconds
PATIENCE = 2.0  # seconds that processes may take to end after their command


@dataclass(frozen=True)
class Ran:
    """How a command ended. `code` is None where it was ended for its time or its memory."""

    code: int | None
    out: str
    err: str
    seconds: float
    peak_gib: float
    left: tuple[str, ...]  # processes that outlived it

    @property
    def words(self) -> str:
        return self.out + self.err

    @property
    def traceback(self) -> bool:
        return "Traceback (most recent call last)" in self.words or "Fatal Python error" in self.words


def install(folder: Path) -> Path:
    """A `reart` in `folder`, which starts this tree's as its console script does. The folder, for PATH."""
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["project"]
    module, _, name = project["scripts"]["reart"].partition(":")
    folder.mkdir(parents=True, exist_ok=True)
    script = folder / "reart"
    start = f"if __name__ == '__main__':\n    import sys\n    from {module} import {name}\n    sys.exit({name}())\n"
    script.write_text(f"#!{sys.executable} -P\n{start}")
    script.chmod(0o755)
    return folder


def environment(folder: Path, bin_folder: Path, preset: Path) -> dict[str, str]:
    """That of a command: this tree's reart, small settings as $TINY, and a folder for what is temporary."""
    temporary = folder / "tmp"
    temporary.mkdir(exist_ok=True)
    temporary.chmod(0o777)
    kept = {name: value for name, value in os.environ.items() if name not in ("COLUMNS", "TERM", "REART_ASSETS")}
    return kept | {
        "PATH": f"{bin_folder}:{Path(sys.executable).parent}:{os.environ['PATH']}",
        "PYTHONPATH": str(REPOSITORY),
        "PYTHONDONTWRITEBYTECODE": "1",
        "TMPDIR": str(temporary),
        "TINY": str(preset),
    }


def run(
    line: str,
    folder: Path,
    env: Mapping[str, str],
    seconds: float = SECONDS,
    gib: float = GIB,
    on_terminal: bool = False,
) -> Ran:
    """Run a line of bash in `folder`, as a session of its own, which is ended whole."""
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        started = time.monotonic()
        terminal = Terminal() if on_terminal else None
        streams = {"stdout": out, "stderr": err} if terminal is None else terminal.streams
        process = subprocess.Popen(
            ["bash", "-c", line],
            cwd=folder,
            env=dict(env),
            stdin=subprocess.DEVNULL,
            start_new_session=True,
            preexec_fn=_as_by_hand,
            **streams,
        )
        code, peak = _watch(process, started + seconds, gib)
        left = tuple(_command_of(pid) for pid in alive(process.pid, PATIENCE))
        end_session(process.pid)
        said = [_text(file) for file in (out, err)] if terminal is None else [terminal.text(), ""]
        return Ran(code, *said, time.monotonic() - started, peak, left)


def _as_by_hand() -> None:
    """Signals as a shell in the foreground has them, and a bound on memory."""
    for number in (signal.SIGINT, signal.SIGQUIT, signal.SIGPIPE, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESS_SPACE, ADDRESS_SPACE))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _watch(process: subprocess.Popen[bytes], deadline: float, gib: float) -> tuple[int | None, float]:
    """Wait for the end, or bring it about. The exit code, and the most that one process held in GiB."""
    while True:
        pid, status, usage = os.wait4(process.pid, os.WNOHANG)
        if pid:
            process.returncode = os.waitstatus_to_exitcode(status)
            code = process.returncode if process.returncode >= 0 else 128 - process.returncode
            return code, usage.ru_maxrss / 2**20
        greatest = max((resident(pid) for pid in session(process.pid)), default=0.0)
        if greatest > gib or time.monotonic() > deadline:
            end_session(process.pid)
            _, status, usage = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
            return None, max(greatest, usage.ru_maxrss / 2**20)
        time.sleep(POLL)


class Terminal:
    """A pseudo-terminal, and what was written to it."""

    def __init__(self) -> None:
        self._master, self._slave = pty.openpty()
        self._written = b""
        self.streams = {"stdout": self._slave, "stderr": self._slave}
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        while True:
            try:
                piece = os.read(self._master, 65536)
            except OSError:
                return
            if not piece:
                return
            self._written += piece

    def text(self) -> str:
        os.close(self._slave)
        self._reader.join(timeout=2)
        os.close(self._master)
        return self._written.decode(errors="replace")


def session(leader: int) -> Iterator[int]:
    """The living processes of a session."""
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            fields = (entry / "stat").read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[3]) == leader and fields[0] not in "ZX":
            yield int(entry.name)


def alive(leader: int, patience: float) -> list[int]:
    """The processes of a session that are still there after some seconds."""
    deadline = time.monotonic() + patience
    while (found := list(session(leader))) and time.monotonic() < deadline:
        time.sleep(POLL)
    return found


def end_session(leader: int) -> None:
    for pid in session(leader):
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)


def resident(pid: int) -> float:
    """What a process holds, in GiB."""
    try:
        pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    except (OSError, IndexError):
        return 0.0
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**30


def _command_of(pid: int) -> str:
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")[:100]
    except OSError:
        return str(pid)


def _text(file: object) -> str:
    file.seek(0)  # type: ignore[attr-defined]
    return file.read(2**20).decode(errors="replace")  # type: ignore[attr-defined]
