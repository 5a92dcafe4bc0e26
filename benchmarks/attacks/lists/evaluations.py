"""What lies in a working directory, and is read there by `run`, `evaluate`, `status` and `inspect`."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

from attacks.case import Case, Check, Maker, Verdict, similar
from attacks.command import Ran
from attacks.hinge import Prepared
from attacks.lists.makers import a_folder, both, file, given, gone, link, moved, sparse

DATA = '--dataset scans --data data --preset "$TINY" --workdir workdir'
RUN, EVALUATE, STATUS = (f"reart {command} {DATA}" for command in ("run", "evaluate", "status"))
DONE = given("data", "workdir")
EVALUATION = "workdir/scans/evaluation"
WRONG: tuple[Verdict, ...] = ("refused", "failed")
ANY: tuple[Verdict, ...] = ("refused", "failed", "accepted")


def planted(*names: str) -> Maker:
    """An earlier evaluation that speaks of sequences of these names; {folder} is the case's."""

    def make(folder: Path, prepared: Prepared) -> None:
        for ending in (".html", ".png"):
            file(f"victim{ending}", "precious")(folder, prepared)
            file(f"workdir/victim{ending}", "precious")(folder, prepared)
        path = folder / EVALUATION / "evaluation.json"
        content = json.loads(path.read_bytes())
        content["sequences"] += [content["sequences"][0] | {"sequence": name.format(folder=folder)} for name in names]
        path.write_text(json.dumps(content))

    return make


def evaluation(
    name: str, change: Callable[[Any], Any], command: str = EVALUATE, may: tuple[Verdict, ...] = ANY
) -> Case:
    def make(folder: Path, prepared: Prepared) -> None:
        path = folder / EVALUATION / "evaluation.json"
        content = json.loads(path.read_bytes())
        other = change(content)
        shutil.copy(path, folder / "sound.json")
        (folder / "earlier.json").write_text(json.dumps(content if other is None else other))
        shutil.copy(folder / "earlier.json", path)

    return Case(name, command, both(DONE, make), may=may)


def damaged(
    stage: str, how: Callable[[Path], object], sequence: str = "box", file_name: str = "manifest.json"
) -> Maker:
    """A file of a complete artifact, damaged."""

    def make(folder: Path, prepared: Prepared) -> None:
        [directory] = (folder / "workdir" / "scans" / sequence).glob(f"{stage}-*/")
        for path in directory.rglob(file_name):
            how(path)

    return make


def flow_as_file(folder: Path, prepared: Prepared) -> None:
    for path in sorted((folder / "workdir/scans/box").glob("flow-*/")):
        shutil.rmtree(path)
        path.write_text("x")


def flip(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


def empty(path: Path) -> None:
    path.write_bytes(b"")


def page_is_kept(folder: Path, ran: Ran) -> str:
    return "" if (folder / EVALUATION / "sequences" / "box.html").exists() else "the sequence's earlier page is gone"


def names_it(sequence: str = "box") -> Check:
    return lambda folder, ran: "" if sequence in ran.err else f"does not name {sequence}"


def against(name: str, content: str | bytes) -> Case:
    return Case(
        f"against: {name}",
        f"{EVALUATE} --against earlier.json",
        both(DONE, file("earlier.json", content)),
        may=("refused",),
    )


KEEP = ("workdir/victim.html", "workdir/victim.png")

CASES = [
    Case("an evaluation with a path as a name", EVALUATE, both(DONE, planted("{folder}/victim")), may=ANY),
    Case(
        "run: a damaged evaluation artifact",
        RUN,
        both(DONE, damaged("evaluation", flip)),
        may=("failed", "accepted"),
        check=page_is_kept,
        says="box",
    ),
    Case(
        "evaluate: a damaged evaluation artifact",
        EVALUATE,
        both(DONE, damaged("evaluation", flip)),
        may=("failed",),
        says="box.*(corrupt|digest|changed)",
    ),
    Case(
        "status: a changed array",
        f"{STATUS} --check",
        both(DONE, damaged("flow", flip, file_name="zarr.json")),
        may=("failed",),
        says="corrupt|changed|digest",
    ),
    Case(
        "status: an array is gone",
        f"{STATUS} --check",
        both(DONE, damaged("flow", Path.unlink, file_name="zarr.json")),
        may=("failed",),
        says="corrupt|missing",
    ),
    Case(
        "run: an array is gone",
        RUN,
        both(DONE, damaged("result", Path.unlink, file_name="model.npz")),
        may=("failed", "accepted"),
        check=lambda folder, ran: (
            ""
            if ran.code
            else ""
            if list((folder / "workdir/scans/box").glob("result-*/model.npz"))
            else "says that all is done"
        ),
    ),
    *[
        Case(
            f"{name}: input is gone after all was computed",
            "(while ! [ -e out/scans/box/report-*/manifest.json ] || ! [ -e out/scans/lid/result-*/manifest.json ]; do "
            'sleep 0.05; done; rm -r data/box) & reart run --dataset scans --data data --preset "$TINY" --workdir out',
            given("data"),
            may=ANY,
            writes=("data",),
            check=lambda folder, ran: (
                "" if (folder / "out/scans/evaluation/evaluation.json").exists() else "no evaluation"
            ),
        )
        for name in ("run",)
    ],
    *similar(
        Case("an evaluation with a path upwards", EVALUATE, both(DONE, planted("../../../../victim")), may=ANY),
        Case("an evaluation with a path beside", EVALUATE, both(DONE, planted("../../../victim")), may=ANY, keeps=KEEP),
        Case(
            "an evaluation with a path through a sequence",
            EVALUATE,
            both(DONE, planted("box/../../../../victim")),
            may=ANY,
            keeps=KEEP,
        ),
        Case("run: an evaluation with a path as a name", RUN, both(DONE, planted("{folder}/victim")), may=ANY),
        Case(
            "an evaluation with odd names",
            EVALUATE,
            both(DONE, planted("", ".", "..", "a\0b", "x" * 5000, "\ud800")),
            may=ANY,
        ),
        Case(
            "a folder of sequences that is a link",
            EVALUATE,
            both(
                DONE,
                planted("victim"),
                gone(f"{EVALUATION}/sequences"),
                file("mine/victim.html", "x"),
                link(f"{EVALUATION}/sequences", "/mine"),
            ),
            may=ANY,
            keeps=("mine/victim.html",),
            writes=("mine",),
        ),
        evaluation("an evaluation of nothing", lambda content: {}),
        evaluation("an evaluation of numbers", lambda content: {"sequences": [1, 2]}),
        evaluation("an evaluation of lists", lambda content: {"sequences": {"sequence": [1]}}),
        evaluation(
            "an evaluation without metrics",
            lambda content: content["sequences"][0].pop("metrics"),
            f"{EVALUATE} --against earlier.json",
        ),
        evaluation(
            "an evaluation with figures of 1e308",
            lambda content: content["sequences"][0]["figures"].update(ari=1e308),
            f"{EVALUATE} --against earlier.json",
        ),
        evaluation(
            "an evaluation with figures of NaN",
            lambda content: content["sequences"][0]["figures"].update(ari=float("nan")),
            f"{EVALUATE} --against earlier.json",
        ),
        evaluation(
            "an evaluation with settings that nest",
            lambda content: content.update(config={"a": [[[[[]]]]], "flow": 3}),
            f"{EVALUATE} --against earlier.json",
        ),
        evaluation(
            "an evaluation with names of markup",
            lambda content: content["sequences"][0].update(sequence="[/red]<script>"),
            f"{EVALUATE} --against earlier.json",
        ),
        against("nothing", b""),
        against("nested", "[" * 200_000),
        against("bytes", bytes(range(256))),
        against("a list", "[]"),
        against("a model", '{"format": "rearticulate/model"}'),
        against("half a character", '{"format": "\\ud800"}'),
        Case(
            "against: 3 GiB of zeros",
            f"{EVALUATE} --against earlier.json",
            both(DONE, sparse("earlier.json", b"{")),
            may=("refused",),
        ),
        Case("against: a folder", f"{EVALUATE} --against data", DONE, may=("refused",)),
        Case("against: a pipe", f"mkfifo p; {EVALUATE} --against p", DONE, may=("refused",), seconds=30, writes=("p",)),
        Case(
            "a nested evaluation.json",
            EVALUATE,
            both(DONE, file(f"{EVALUATION}/evaluation.json", "[" * 200_000)),
            may=ANY,
        ),
        Case(
            "an evaluation.json that is a folder",
            EVALUATE,
            both(
                DONE,
                a_folder(f"{EVALUATION}/evaluation.json"),
            ),
            may=ANY,
        ),
        Case(
            "an evaluation.json of 3 GiB", EVALUATE, both(DONE, sparse(f"{EVALUATION}/evaluation.json", b"{")), may=ANY
        ),
        Case(
            "a page that is a folder",
            EVALUATE,
            both(
                DONE,
                a_folder(f"{EVALUATION}/index.html"),
            ),
            may=ANY,
        ),
        *[
            Case(
                f"{command.split()[1]}: {name} of {stage}",
                command,
                both(DONE, damaged(stage, how, file_name=file_name)),
                may=ANY,
                says="box",
            )
            for command in (STATUS, EVALUATE, RUN)
            for stage, name, how, file_name in (
                ("flow", "an empty manifest", empty, "manifest.json"),
                ("evaluation", "a nested manifest", lambda path: path.write_text("[" * 200_000), "manifest.json"),
                (
                    "result",
                    "a manifest that is a link to itself",
                    lambda path: [path.unlink(), path.symlink_to(path.name)],
                    "manifest.json",
                ),
                ("report", "an empty page", empty, "report.html"),
            )
        ],
        *[
            Case(
                f"inspect: {name}",
                "reart inspect workdir/scans/box/flow-*/",
                both(DONE, damaged("flow", how)),
                may=WRONG,
            )
            for name, how in (
                ("an empty manifest", empty),
                ("a nested manifest", lambda path: path.write_text("[" * 200_000)),
                ("a manifest of NaN", lambda path: path.write_text("NaN")),
                ("a manifest of 400 digits", lambda path: path.write_text('{"seed": 1' + "0" * 5000 + "}")),
                ("a manifest of half a character", lambda path: path.write_text('{"stage": "\\ud800"}')),
            )
        ],
        Case("inspect: a device", "reart inspect /dev/null", may=("refused",)),
        Case("inspect: nothing", "reart inspect nowhere", may=("refused",)),
        Case(
            "inspect: a foreign file in it",
            "for own in workdir/scans/box/flow-*/; do touch $own/x; done; reart inspect workdir/scans/box/flow-*/",
            DONE,
            may=WRONG,
        ),
        Case(
            "inspect: little memory",
            "ulimit -v 300000; reart inspect workdir/scans/box/ingest-*/",
            DONE,
            may=ANY,
            check=lambda folder, ran: (
                "a sound artifact is called corrupt"
                if "corrupt" in ran.words or "remove this folder" in ran.words
                else ""
            ),
        ),
        Case("a dataset folder that is a file", RUN, both(given("data"), file("workdir/scans", "x")), may=ANY),
        Case(
            "a sequence folder that is a file",
            RUN,
            both(given("data"), file("workdir/scans/box", "x")),
            may=ANY,
            says="box",
        ),
        Case(
            "an artifact that is a file",
            f"{RUN}",
            both(
                DONE,
                flow_as_file,
            ),
            may=ANY,
        ),
        Case(
            "sequences that would collide",
            RUN,
            both(given("data"), lambda folder, prepared: shutil.copytree(folder / "data/box", folder / "data/box!")),
            may=ANY,
        ),
        Case(
            "a sequence named evaluation",
            RUN,
            both(given("data"), moved("data/box", "data/evaluation")),
            may=ANY,
            check=lambda folder, ran: (
                "" if (folder / f"{EVALUATION}/evaluation.json").exists() or ran.code else "no evaluation"
            ),
        ),
        Case(
            "a sequence named by dots",
            RUN,
            both(given("data"), moved("data/box", "data/..-..")),
            may=ANY,
        ),
    ),
]
