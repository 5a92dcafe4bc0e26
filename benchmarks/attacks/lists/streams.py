"""Streams that are closed or full, folders that are gone, odd names and environments, and signals."""

from __future__ import annotations

import os
from pathlib import Path

from attacks.case import Case, Verdict, similar
from attacks.command import Ran
from attacks.hinge import Prepared
from attacks.lists.evaluations import DONE, EVALUATE, RUN, STATUS
from attacks.lists.makers import FIT, both, file, given
from attacks.lists.models import alone

ANY: tuple[Verdict, ...] = ("refused", "failed", "accepted")
MODEL = both(given("model"), alone, file("states.json", "{}"))
FIGURE = "reart figure model --out out/a.png"
POSE = "reart pose model --states states.json"
HIDE, SHOW = "\x1b[?25l", "\x1b[?25h"


def quiet(name: str, line: str, make=DONE, exits: tuple[int, ...] = (), may: tuple[Verdict, ...] = ANY) -> Case:  # type: ignore[no-untyped-def]
    """Nobody listens, so nothing need be said; but no traceback."""
    return Case(name, line, make, may=may, exits=exits, check=no_noise)


def no_noise(folder: Path, ran: Ran) -> str:
    return "Exception ignored" if "Exception ignored" in ran.words else ""


def cursor_shown(folder: Path, ran: Ran) -> str:
    """The terminal's cursor was hidden, and is there at the end."""
    if HIDE not in ran.out:
        return "the cursor was never hidden: the command was ended too early"
    return "" if ran.out.rfind(SHOW) > ran.out.rfind(HIDE) else "the cursor stays hidden"


def signalled(name: str, code: int, seconds: float = 4.0, command: str = FIT) -> Case:
    return Case(
        f"SIG{name} after {seconds} s: {command.split()[1]}",
        f"timeout --preserve-status -s {name} {seconds} {command}",
        given("frames"),
        exits=(code,),
        terminal=True,
        check=cursor_shown,
    )


def byte_names(folder: Path, prepared: Prepared) -> None:
    prepared.give(folder, "frames", "data")
    os.rename(folder / "frames", os.fsencode(folder) + b"/fr\xff")
    os.rename(folder / "data" / "box", os.fsencode(folder / "data") + b"/b\xff")


def own_modules(*names: str):  # type: ignore[no-untyped-def]
    """Files in the current folder that are named as modules, and write `victim` where they are run."""
    return both(given("frames"), *(file(f"{name}.py", 'open("victim", "w")\n') for name in names))


def environment(text: str, command: str = FIT, may: tuple[Verdict, ...] = ANY, make=given("frames")) -> Case:  # type: ignore[no-untyped-def]  # noqa: B008
    return Case(f"environment: {text}: {command.split()[1]}", f"export {text}; {command}", make, may=may)


CASES = [
    Case("a path of bytes", "reart fit $'fr\\xff' --out out --preset \"$TINY\"", byte_names, may=ANY),
    Case(
        "a path of bytes for out", "reart fit frames --out $'out/o\\xff' --preset \"$TINY\"", given("frames"), may=ANY
    ),
    Case(
        "a data set of bytes",
        'reart run --dataset scans --data data --workdir out --preset "$TINY"',
        byte_names,
        may=ANY,
    ),
    *[
        quiet(f"{stream}: {name}", f"{command} {redirect}")
        for name, command in (("status", STATUS), ("evaluate", EVALUATE), ("run", RUN))
        for stream, redirect in (("closed output", ">&-"), ("full output", "> /dev/full"))
    ],
    quiet("closed output: fit", f"{FIT} >&-", given("frames")),
    quiet("full output: fit", f"{FIT} > /dev/full", given("frames")),
    quiet("closed output: pose", f"{POSE} --json >&-", MODEL),
    quiet("full output: pose", f"{POSE} --json > /dev/full", MODEL),
    quiet("full output: figure", f"{FIGURE} > /dev/full", MODEL),
    *[
        Case(f"the current folder is gone: {name}", f"mkdir gone; cd gone; rmdir ../gone; {command}", make, may=ANY)
        for name, command, make in (
            ("status", "reart status --dataset scans --data ../data", given("data")),
            ("fit", 'reart fit ../frames --out ../out --preset "$TINY"', given("frames")),
            ("pose", "reart pose ../model --states ../states.json", MODEL),
            ("help", "reart --help", given()),
        )
    ],
    environment("MPLBACKEND=nonsense", FIGURE, make=MODEL),
    environment("MPLBACKEND=nonsense"),
    signalled("TERM", 143),
    signalled("HUP", 129),
    signalled("INT", 130),
    Case(
        "no fcntl",
        f'export PYTHONPATH="$PWD/fake:$PYTHONPATH"; {FIT}',
        both(given("frames"), file("fake/sitecustomize.py", 'import sys\n\nsys.modules["fcntl"] = None\n')),
        may=ANY,
    ),
    *similar(
        quiet("closed error: fit", f"{FIT} 2>&-", given("frames")),
        quiet("closed error: a refusal", "reart fit nowhere --out out 2>&-", exits=(2,)),
        quiet("full error: a refusal", "reart fit nowhere --out out 2> /dev/full", exits=(2,)),
        quiet("closed input: fit", f"{FIT} <&-", given("frames")),
        quiet("all streams closed: fit", f"{FIT} <&- >&- 2>&-", given("frames")),
        quiet("all streams closed: status", f"{STATUS} <&- >&- 2>&-"),
        quiet("closed output: help", "reart --help >&-"),
        quiet("full output: help", "reart --help > /dev/full"),
        quiet("full output: inspect", "reart inspect workdir/scans/box/flow-*/ > /dev/full"),
        quiet("full output: status --json", f"{STATUS} --json > /dev/full"),
        quiet("full output: evaluate --json", f"{EVALUATE} --json > /dev/full"),
        quiet(
            "full output: train-flow",
            "reart train-flow --out out --preset smoke --set steps=1 --set validation_pairs=1 > /dev/full",
            given(),
        ),
        *[
            quiet(
                f"a reader that leaves: {name}",
                f"{command} | head -c 1 >/dev/null; exit ${{PIPESTATUS[0]}}",
                make,
                exits=(141, 1),
            )
            for name, command, make in (
                ("evaluate --json", f"{EVALUATE} --json", DONE),
                ("status", STATUS, DONE),
                ("help", "reart --help", DONE),
                ("fit", FIT, given("frames")),
            )
        ],
        Case(
            "a preset of bytes", "reart fit frames --out out --preset $'p\\xff.toml'", given("frames"), may=("refused",)
        ),
        Case(
            "a setting of bytes",
            "reart fit frames --out out --set $'flow.estimator=\\xff'",
            given("frames"),
            may=("refused",),
        ),
        Case("states of bytes", "reart pose model --states $'s\\xff.json'", MODEL, may=("refused",)),
        Case(
            "a model of bytes",
            "cp -r model $'m\\xff'; reart pose $'m\\xff' --states states.json --out out",
            MODEL,
            may=ANY,
            writes=("m\udcff",),
        ),
        Case(
            "export of a model of bytes",
            "cp -r model $'m\\xff'; reart export $'m\\xff' --to urdf --out out",
            MODEL,
            may=ANY,
            writes=("m\udcff",),
        ),
        Case("a picture of bytes", "reart figure model --out $'out/\\xff.png'", MODEL, may=ANY),
        Case("sequences of bytes", f"{RUN} --sequences $'b\\xff'", DONE, may=("refused",)),
        Case(
            "a working directory of bytes",
            RUN.replace("workdir workdir", "workdir $'out/w\\xff'"),
            given("data"),
            may=ANY,
        ),
        Case("a command that is unknown", "reart frobnicate", may=ANY, exits=(2,), check=no_noise),
        environment("LC_ALL=C PYTHONUTF8=0 PYTHONIOENCODING=ascii"),
        environment("LC_ALL=C PYTHONUTF8=0 PYTHONIOENCODING=ascii", POSE, make=MODEL),
        environment("LC_ALL=nonsense"),
        environment("TERM=nonsense"),
        *[environment(f"COLUMNS={value}", STATUS, make=DONE) for value in ("0", "1", "-5", "x", "99999999")],
        environment("HOME=/nowhere XDG_CACHE_HOME=/nowhere MPLCONFIGDIR=/nowhere", FIGURE, make=MODEL),
        environment("HOME=", FIGURE, make=MODEL),
        environment("TMPDIR=/nowhere"),
        environment("OMP_NUM_THREADS=nonsense"),
        environment("OMP_NUM_THREADS=1000000"),
        environment("PYTHONWARNINGS=error"),
        environment("MPLBACKEND=TkAgg DISPLAY=:99", FIGURE, make=MODEL),
        environment("MPLBACKEND=module://nowhere", RUN, make=DONE),
        environment("MATPLOTLIBRC=/dev/zero.rc", FIGURE, make=MODEL),
        environment("LUIGI_CONFIG_PATH=$PWD/luigi.cfg", make=both(given("frames"), file("luigi.cfg", "[core\n%%%"))),
        environment("LUIGI_CONFIG_PARSER=toml", make=both(given("frames"), file("luigi.toml", "[[["))),
        Case(
            "a luigi.cfg in the current folder",
            FIT,
            both(given("frames"), file("luigi.cfg", "[worker]\nmax_reschedules=x\n[")),
            may=ANY,
        ),
        Case(
            "a logging.cfg in the current folder", FIT, both(given("frames"), file("logging.cfg", "nonsense")), may=ANY
        ),
        Case(
            "a matplotlibrc in the current folder",
            FIGURE,
            both(MODEL, file("matplotlibrc", "backend: nonsense\nx y z\n")),
            may=ANY,
        ),
        Case(
            "modules in the current folder",
            FIT,
            own_modules(
                "numpy",
                "torch",
                "json",
                "luigi",
                "open3d",
                "sitecustomize",
                "usercustomize",
                "schemas",
                "stages",
                "pipeline",
                "scipy",
                "zarr",
                "roma",
                "trimesh",
                "matplotlib",
                "typing",
                "collada",
                "lxml",
                "networkx",
            ),
        ),
        Case("a zarr.json in the current folder", FIT, both(given("frames"), file("zarr.json", "{")), may=ANY),
        *[
            signalled(name, code, seconds)
            for name, code in (("TERM", 143), ("HUP", 129), ("INT", 130))
            for seconds in (2.0, 6.0)
        ],
        signalled("TERM", 143, 4.0, 'reart run --dataset scans --data frames --workdir out --preset "$TINY"'),
        signalled("QUIT", 131, 4.0),
        Case(
            "the engine is killed",
            f"(sleep 4; pkill -9 -s 0 -f '[p]ipeline.engine') & {FIT}",
            given("frames"),
            may=ANY,
            terminal=True,
            check=cursor_shown,
        ),
    ),
]
