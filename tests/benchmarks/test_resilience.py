"""What decides in the sweep: the verdicts themselves, on processes and files that are made here."""

import os
import signal
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

FOLDER = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture
def benchmark(load_benchmark):
    return load_benchmark("resilience")


@pytest.fixture
def attacks(benchmark):
    """The modules of the sweep, by name."""
    return {name.rpartition(".")[2]: module for name, module in sys.modules.items() if name.startswith("attacks")}


@pytest.fixture
def ran(attacks, tmp_path):
    """What comes of a line of bash."""
    return lambda line, **limits: attacks["command"].run(line, tmp_path, os.environ, **limits)


@pytest.fixture
def prepared(attacks, tmp_path):
    return attacks["hinge"].Prepared(tmp_path / "prepared")


def verdict_on(attacks, prepared, tmp_path, command, **more):
    case = attacks["case"].Case("a case", command, **more)
    return attacks["case"].judge(case, tmp_path / "case", prepared)


@pytest.mark.parametrize(
    ("line", "verdict"),
    [
        ("true", "accepted"),
        ("echo 'error: a: found b, expected c' >&2; exit 2", "refused"),
        ("echo 'error: no space left on device' >&2; exit 1", "failed"),
        ("exit 2", "broken"),
        ("echo 'error: a' >&2; echo 'error: b' >&2; exit 2", "broken"),
        ("echo 'Traceback (most recent call last)' >&2; echo 'error: a' >&2; exit 2", "broken"),
        ("echo 'Traceback (most recent call last)'", "broken"),
        ("exit 1", "broken"),
        ("exit 3", "broken"),
        ("kill -SEGV $$", "broken"),
    ],
)
def test_verdict_follows_exit_code_and_words(ran, attacks, line, verdict):
    assert attacks["case"].outcome(ran(line))[0] == verdict


def test_command_is_ended_for_its_time(ran):
    outcome = ran("sleep 60", seconds=0.3)
    assert outcome.code is None
    assert outcome.seconds < 5


def test_command_is_ended_for_its_memory_and_its_peak_is_measured(ran):
    hungry = f"{sys.executable} -c 'x = b\"1\" * 300_000_000; import time; time.sleep(60)'"
    outcome = ran(hungry, gib=0.1)
    assert outcome.code is None
    assert outcome.peak_gib > 0.1


def test_peak_memory_is_that_of_the_greatest_process(ran):
    outcome = ran(f"{sys.executable} -c 'x = b\"1\" * 300_000_000'; true")
    assert outcome.code == 0
    assert 0.28 < outcome.peak_gib < 1.0


def test_processes_that_outlive_a_command_are_named_and_ended(ran, attacks, monkeypatch):
    monkeypatch.setattr(attacks["command"], "PATIENCE", 0.1)
    outcome = ran("sleep 61 & true")
    assert outcome.code == 0
    assert outcome.left == ("sleep 61 ",)
    assert attacks["case"].outcome(outcome)[0] == "broken"


def test_signal_is_an_exit_code_as_in_a_shell(ran):
    assert ran("kill -TERM $$").code == 128 + signal.SIGTERM


def test_terminal_is_one(ran):
    outcome = ran("[ -t 1 ] && printf '\\033[?25l' && echo error >&2", on_terminal=True)
    assert outcome.code == 0
    assert "\x1b[?25l" in outcome.out
    assert "error" in outcome.out


def test_victims_and_strange_files_break_a_case(attacks, prepared, tmp_path):
    made = attacks["makers"].file("victim", "precious")
    judged = verdict_on(
        attacks, prepared, tmp_path, "echo worthless > victim; touch strange; mkdir out; touch out/a", make=made
    )
    assert judged.verdict == "broken"
    assert judged.reasons == ("changed strange", "changed victim")


def test_what_a_case_keeps_may_not_change_where_it_may_write(attacks, prepared, tmp_path):
    made = attacks["makers"].file("out/mine", "precious")
    judged = verdict_on(attacks, prepared, tmp_path, "rm out/mine; touch out/a", make=made, keeps=("out/mine",))
    assert judged.reasons == ("changed out/mine",)


def test_link_at_a_write_target_is_judged_by_its_victim(attacks, prepared, tmp_path):
    makers = attacks["makers"]
    made = makers.both(makers.file("victim", "precious"), makers.link("out/a", "/victim"))
    assert verdict_on(attacks, prepared, tmp_path, "echo x > out/a", make=made).reasons == ("changed victim",)


def test_leftovers_among_temporary_files_break_a_case(attacks, prepared, tmp_path):
    assert verdict_on(attacks, prepared, tmp_path, "touch $TMPDIR/x").reasons == ("left x among the temporary files",)


@pytest.mark.parametrize(
    ("more", "reasons"),
    [
        ({"may": ("refused",)}, ("accepted, expected refused",)),
        ({"says": "hello"}, ("does not say 'hello'",)),
        ({"says": "good bye"}, ()),
        ({"check": lambda folder, ran: "wrong"}, ("wrong",)),
        ({"check": lambda folder, ran: ""}, ()),
    ],
)
def test_case_says_what_may_come_of_it(attacks, prepared, tmp_path, more, reasons):
    assert verdict_on(attacks, prepared, tmp_path, "echo Good bye", **more).reasons == reasons


def test_case_whose_own_files_fail_is_skipped(attacks, prepared, tmp_path):
    def make(folder, prepared):
        raise ValueError("no such thing")

    case = attacks["case"].Case("a case", "true", make)
    [judged] = attacks["hostile"].attack({"x": case}, prepared, tmp_path / "run", lambda name, entry: None).values()
    assert judged.verdict == "skipped"


def test_names_of_cases_are_unique_and_every_subject_is_there(attacks):
    lists = sys.modules["attacks.lists"]
    for subject, module in lists.SUBJECTS.items():
        names = Counter(case.name for case in module.CASES)
        assert not [name for name, count in names.items() if count > 1], subject
    assert sum(not case.similar for case in lists.all_cases().values()) > 100
    assert sum(case.similar for case in lists.all_cases().values()) > 100


def test_damage_changes_one_byte_cuts_or_removes(attacks):
    damage, rng = attacks["flips"].damage, np.random.default_rng(0)
    content = bytes(range(100))
    for _ in range(20):
        offset, flipped = damage(content, "flipped", rng)
        assert [k for k in range(100) if flipped[k] != content[k]] == [offset]
        offset, cut = damage(content, "cut", rng)
        assert cut == content[:offset] != content
    assert damage(content, "removed", rng)[1] is None
    assert damage(b"", "flipped", rng)[1] is None


def test_damaged_file_is_whole_again(attacks, tmp_path):
    path = tmp_path / "a"
    path.write_bytes(b"precious")
    for how in ("flipped", "cut", "removed"):
        with attacks["flips"].damaged(path, how, np.random.default_rng(0)):
            assert not path.exists() or path.read_bytes() != b"precious"
        assert path.read_bytes() == b"precious"


def test_read_of_damage_is_found_same_missed_or_escaped(attacks):
    flips = attacks["flips"]

    def raising(error):
        def read():
            raise error

        return read

    assert flips.judge_read(raising(flips.artifacts.CorruptArtifactError(Path("x"), "bad")), 1)[0] == "found"
    assert flips.judge_read(raising(KeyError("x")), 1) == ("escaped", "KeyError: 'x'")
    assert flips.judge_read(lambda: 1, 1)[0] == "same"
    assert flips.judge_read(lambda: 2, 1)[0] == "missed"


def test_half_of_a_delivered_file_is_not_whole(attacks, tmp_path):
    whole = attacks["delivered"].whole
    np.savez(tmp_path / "model.npz", a=np.arange(100.0))
    contents = {
        "model.json": b'{"a": [1, 2]}',
        "model.npz": (tmp_path / "model.npz").read_bytes(),
        "robot.urdf": b"<robot><link/></robot>",
        "meshes/part_0.stl": bytes(80) + (2).to_bytes(4, "little") + bytes(100),
        "report.html": b"<html><body></body></html>\n",
    }
    for name, content in contents.items():
        assert whole(name, content), name
        assert not whole(name, content[: len(content) // 2]), name
        assert not whole(name, b""), name


def test_watch_tells_a_torn_file_from_one_that_is_replaced(attacks, tmp_path):
    (tmp_path / "model.json").write_text("{}")
    with attacks["kills"].Watch(tmp_path) as watch:
        other = tmp_path / "other"
        other.write_text('{"a": 1}')
        other.rename(tmp_path / "model.json")
    assert watch.torn == set()
    with attacks["kills"].Watch(tmp_path) as watch:
        (tmp_path / "model.json").write_text('{"a":')
    assert watch.torn == {"model.json"}


def test_kills_are_planned_over_the_whole_run_and_its_delivery(attacks):
    plans = attacks["kills"].plans(30, 8.0, np.random.default_rng(0))
    assert sum(plan.delivering for plan in plans) == 12
    assert {plan.target for plan in plans} == {"all", "command line", "engine", "worker"}
    moments = [plan.seconds for plan in plans if not plan.delivering]
    assert min(moments) < 2
    assert max(moments) > 6
    assert plans == attacks["kills"].plans(30, 8.0, np.random.default_rng(0))


def test_every_process_of_a_session_is_killed(attacks):
    import subprocess

    process = subprocess.Popen(["bash", "-c", "sleep 60 & sleep 60 & wait"], start_new_session=True)
    while len(list(attacks["command"].session(process.pid))) < 3:
        pass
    assert attacks["kills"].kill(process.pid, "all") == "all 3"
    assert process.wait(timeout=5) == -signal.SIGKILL
    assert attacks["command"].alive(process.pid, patience=2.0) == []


def test_tally_and_document_say_what_did_not_hold(benchmark, attacks):
    held = benchmark.tally("flips", ["found", "same", "missed"], ("found", "same"))
    assert (held.tried, held.held, held.well) == (3, 2, False)
    flip = attacks["flips"].Flip("model.json", "flipped", 7, "missed", "")
    [finding] = benchmark.flip_findings("flips", [flip, attacks["flips"].Flip("a", "cut", 1, "found", "x")])
    record = benchmark.Record(
        date="2026-01-01T00:00:00Z",
        commit="",
        machine=benchmark.machine(),
        packages={},
        seed=3,
        root=False,
        tallies=(held,),
        findings=(finding,),
    )
    text = benchmark.document(record)
    assert "2 of 3" in text
    assert "model.json" in text
    assert "Not as root" in text


def test_unknown_input_is_refused(benchmark, capsys):
    assert benchmark.main(["hostile", "--only", "nowhere/at all"]) == 2
    assert "found no such input" in capsys.readouterr().err


def test_names_are_listed(benchmark, capsys):
    assert benchmark.main(["hostile", "--list", "--only", "tables/"]) == 0
    assert "tables/csv with commas" in capsys.readouterr().out.splitlines()


def test_skipped_inputs_are_not_counted_as_tried(benchmark, attacks):
    case = attacks["case"].Case("a case", "true")
    judged = {"a/x": attacks["case"].Judged(case, "skipped"), "a/y": attacks["case"].Judged(case, "refused")}
    [tally] = benchmark.hostile_tallies(judged)
    assert (tally.tried, tally.held, tally.outcomes) == (1, 1, {"refused": 1, "skipped": 1})
