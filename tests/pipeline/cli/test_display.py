import io

import pytest
from rich.console import Console

from pipeline.cli.display import RunDisplay, time_left
from pipeline.run.protocol import Event

EVENTS = [
    Event(kind="planned", sequence="box", task="ingest", complete=True),
    Event(kind="planned", sequence="box", task="relaxed_fit[0]"),
    Event(kind="planned", sequence="box", task="final_fit"),
    Event(kind="started", sequence="box", task="relaxed_fit[0]", artifact="relaxed_fit-0"),
    Event(kind="warning", sequence="box", task="relaxed_fit[0]", message="[odd] points"),
    Event(kind="progress", sequence="box", task="relaxed_fit[0]", done=1, total=4, energy=0.125),
]
END = [
    Event(kind="finished", sequence="box", task="relaxed_fit[0]", artifact="relaxed_fit-0", seconds=1.25),
    Event(kind="failed", sequence="box", task="final_fit", artifact="final_fit-0"),
]


@pytest.fixture
def show():
    def shown(events, terminal):
        screen = io.StringIO()
        console = Console(file=screen, force_terminal=terminal, width=100, highlight=False, color_system=None)
        with RunDisplay(console) as display:
            for event in events:
                display(event)
            display.progress.refresh()
        return screen.getvalue()

    return shown


def test_without_a_terminal_each_finished_stage_is_one_line(show):
    assert show(EVENTS + END, terminal=False).splitlines() == [
        "warning: box relaxed_fit[0]: [odd] points",
        "1/2  box  relaxed_fit[0]  1.2 s",
        "2/2  box  final_fit  failed",
    ]


def test_once_every_pending_stage_was_seen_a_line_tells_the_time_left(show):
    planned = [Event(kind="planned", sequence=name, task="flow") for name in "abc"]
    done = [
        Event(kind="started", sequence="a", task="flow", artifact="flow-0"),
        Event(kind="finished", sequence="a", task="flow", artifact="flow-0", seconds=600),
    ]
    assert show(planned + done, terminal=False).splitlines() == ["1/3  a  flow  600.0 s  about 20 min left"]
    assert "all stages" in show(planned + done, terminal=True)


@pytest.mark.parametrize(
    ("seconds", "words"),
    [
        (None, ""),
        (0.0, ""),
        (20, "less than a minute left"),
        (100, "about 2 min left"),
        (3659, "about 1 h 01 min left"),
    ],
)
def test_time_left_is_told_as_exactly_as_an_estimate_is(seconds, words):
    assert time_left(seconds) == words


def test_on_a_terminal_a_running_stage_has_a_bar_with_its_energy(show):
    screen = show(EVENTS, terminal=True)
    assert "box relaxed_fit[0]" in screen
    assert "E 0.125" in screen
