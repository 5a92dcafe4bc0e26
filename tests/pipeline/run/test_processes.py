import subprocess
import sys

from pipeline.run.processes import how_it_ended

PROGRAM = "from pipeline.run.processes import peak_memory_mib; held = bytearray(300 * 2**20); print(peak_memory_mib())"


def test_peak_memory_is_told_in_mib():
    done = subprocess.run([sys.executable, "-c", PROGRAM], check=True, capture_output=True, text=True)
    assert 300 < float(done.stdout) < 10_000  # the peak of the process that started it counts too


def test_an_end_is_told_in_words():
    assert how_it_ended(-9) == "killed by SIGKILL"
    assert how_it_ended(3) == "exit code 3"
