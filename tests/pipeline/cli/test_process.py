"""The command line as a process: closed streams, a full disk, signals, names that are no text."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

import pipeline

REART = [sys.executable, "-P", "-c", "from pipeline.cli import app; app()"]
ROOT = Path(pipeline.__file__).parents[1]
ASLEEP = """
import time
from pipeline.cli import app

@app.command()
def sleep():
    try:
        print("\\033[?25l", flush=True)
        time.sleep(60)
    finally:
        print("\\033[?25h", flush=True)

app()
"""


def reart(*words, **how):
    return subprocess.run([*REART, *words], capture_output=True, timeout=60, **how, check=False)


def error_of(done):
    [line] = done.stderr.decode().splitlines()
    assert line.startswith("error: ")
    return line


def test_the_version_and_short_help():
    assert reart("--version").stdout.startswith(b"rearticulate ")
    assert b" pose [OPTIONS]" in reart("pose", "-h").stdout


@pytest.mark.parametrize("closed", [(1,), (0, 1, 2)])
def test_closed_streams_are_no_reason_to_fail_and_no_file_takes_their_place(tmp_path, closed):
    def close():
        for number in closed:
            os.close(number)

    program = "from pipeline.cli.process import open_standard_streams; open_standard_streams(); import sys; "
    program += f"f = open({str(tmp_path / 'file')!r}, 'w'); print('printed'); sys.exit(0 if f.fileno() > 2 else 9)"
    done = subprocess.run([sys.executable, "-c", program], preexec_fn=close, timeout=60)
    assert done.returncode == 0
    assert (tmp_path / "file").read_text() == ""
    assert subprocess.run([*REART, "--version"], preexec_fn=close, timeout=60).returncode == 0


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs Linux's /dev/full")
def test_output_that_cannot_be_written_is_one_line_and_exit_code_1():
    with open("/dev/full", "w") as full:
        done = subprocess.run([*REART, "--version"], stdout=full, stderr=subprocess.PIPE, timeout=60)
    assert done.returncode == 1
    assert "standard output: No space left on device" in error_of(done)


def test_a_reader_that_has_left_is_no_error_to_speak_of():
    reading, writing = os.pipe()
    os.close(reading)
    done = subprocess.run([*REART, "--version"], stdout=writing, stderr=subprocess.PIPE, timeout=60)
    os.close(writing)
    assert (done.returncode, done.stderr) == (1, b"")


def test_a_name_that_is_no_text_and_a_folder_that_is_gone_are_one_line_and_exit_code_2(tmp_path):
    done = reart("status", "--dataset", "scans", "--data", b"sc\xffans", cwd=tmp_path)
    assert done.returncode == 2
    assert "sc\\udcffans: found a name that is not UTF-8" in error_of(done)
    gone = tmp_path / "gone"
    gone.mkdir()
    done = reart("status", cwd=gone, preexec_fn=gone.rmdir, env=os.environ | {"PYTHONPATH": str(ROOT)})
    assert done.returncode == 2
    assert "the current folder: No such file or directory" in error_of(done)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
def test_a_signal_ends_the_program_by_its_own_code_after_the_cursor_came_back(number):
    process = subprocess.Popen(
        [sys.executable, "-c", ASLEEP, "sleep"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        preexec_fn=lambda: [signal.signal(each, signal.SIG_DFL) for each in (number, signal.SIGINT)],
    )
    process.stdout.readline()
    process.send_signal(number)
    out, error = process.communicate(timeout=60)
    assert process.returncode == 128 + number
    assert out.endswith(b"\033[?25h\n")
    assert error.startswith(b"error: ")
    assert len(error.splitlines()) == 1


def test_a_signal_that_is_ignored_stays_so():
    program = "import signal; from pipeline.cli.process import answering_signals\n"
    program += "with answering_signals(): assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN"
    ignoring = lambda: signal.signal(signal.SIGHUP, signal.SIG_IGN)  # noqa: E731
    assert subprocess.run([sys.executable, "-c", program], preexec_fn=ignoring, timeout=60).returncode == 0


def test_where_there_is_no_fcntl_the_system_is_named():
    program = "import sys; sys.modules['fcntl'] = None\n"
    program += "import importlib.util as u; find = u.find_spec\n"
    program += "u.find_spec = lambda name: None if name == 'fcntl' else find(name)\nimport pipeline.cli"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, timeout=60)
    assert done.returncode == 2
    assert "expected Linux or macOS" in error_of(done)


@pytest.mark.parametrize("words", [("status", "--seed", "-1"), ("run", "--dataset", "scans", "--workers", "no")])
def test_an_option_of_a_wrong_value_is_one_line(words):
    done = reart(*words)
    assert done.returncode == 2
    assert words[-2] in error_of(done)
