"""Where files go: links, folders in the way, full disks, and what one may not read or write."""

from __future__ import annotations

import os
import shutil
from dataclasses import replace
from pathlib import Path

from attacks.case import Case, Maker, Verdict, similar
from attacks.hinge import Prepared
from attacks.lists.evaluations import DONE, EVALUATE, RUN, STATUS
from attacks.lists.makers import FIT, a_folder, both, file, given, gone, link
from attacks.lists.models import alone

WRONG: tuple[Verdict, ...] = ("refused", "failed")
ANY: tuple[Verdict, ...] = ("refused", "failed", "accepted")
MODEL = both(given("model"), alone, file("states.json", "{}"))
OBEYING = "setpriv --bounding-set=-dac_override,-dac_read_search"  # root, whom files may be closed to
POSE, URDF, FIGURE = (
    "reart pose model --states states.json --out out",
    "reart export model --to urdf --out out",
    "reart figure model --out out/a.png",
)
SPACE, DENIED = "no space left", "permission denied|not readable"


def full(command: str, kilobytes: int, place: str = "out", fill: str = "") -> str:
    """The command where `place` is a disk of so many kilobytes; what a `fill` command leaves there first."""
    mount = f"mount -t tmpfs -o size={kilobytes}k,mode=777 tmpfs {place} && {fill or 'true'}"
    look = f'find {place} -name "*partial*" -o -name ".staging*" | sed "s/^/LEFTOVER /"'
    return f"unshare -m bash -c '{mount} && ({command}); code=$?; {look}; exit $code'"


def on_full(name: str, command: str, make: Maker, kilobytes: int, place: str = "out", fill: str = "") -> Case:
    def made(folder: Path, prepared: Prepared) -> None:
        make(folder, prepared)
        (folder / place).mkdir(exist_ok=True)

    return Case(
        f"a full disk: {name}",
        full(command, kilobytes, place, fill),
        made,
        may=WRONG,
        says=SPACE,
        needs_root=True,
        check=lambda folder, ran: "leaves partial files" if "LEFTOVER" in ran.out else "",
    )


def delivering(kilobytes: int) -> Case:
    """The artifacts have room, what is delivered has not."""

    def made(folder: Path, prepared: Prepared) -> None:
        prepared.give(folder, "frames")
        (folder / "elsewhere").mkdir()

    case = on_full(f"fit delivers {kilobytes} kB", FIT, made, kilobytes, "out", "ln -s ../elsewhere out/workdir")
    return replace(case, writes=("elsewhere",))


def full_temporary() -> Case:
    """Nothing can be written where temporary files go, which a fit may need or not."""
    fill = "(head -c 100000 /dev/zero > small/fill || true)"
    case = on_full("of temporary files", f"TMPDIR=$PWD/small {FIT}", given("frames"), 8, "small", fill)
    return replace(case, may=ANY, says="written|no space left", writes=("small",))


def without_permission(
    name: str, command: str, make: Maker, may: tuple[Verdict, ...] = WRONG, says: str = DENIED, check=None
) -> Case:  # type: ignore[no-untyped-def]
    """A command that may do what the files' modes say; `make` says what is closed."""
    return Case(
        f"no permission: {name}",
        f"{OBEYING} {command}",
        make,
        may=may,
        says=says,
        needs_root=True,
        check=check,
    )


def open_all(folder: Path, prepared: Prepared) -> None:
    """Everything may be read and written by everybody."""
    for root, folders, files in os.walk(folder):
        for name in [*folders, *files]:
            if not (path := Path(root) / name).is_symlink():
                path.chmod(0o777)


def closed(*patterns: str, mode: int = 0) -> Maker:
    def make(folder: Path, prepared: Prepared) -> None:
        open_all(folder, prepared)
        for pattern in patterns:
            found = list(folder.glob(pattern))
            if not found:
                raise ValueError(f"{pattern}: nothing to close")
            for path in found:
                path.chmod(mode)

    return make


def log(kind: str) -> Maker:
    """In place of the flow's log, and without its artifact: a folder, or a link to a victim."""

    def make(folder: Path, prepared: Prepared) -> None:
        file("victim", "precious")(folder, prepared)
        for directory in sorted((folder / "workdir/scans").glob("*/flow-*/")):
            path = directory.with_name(f"{directory.name}.log")
            path.unlink()
            shutil.rmtree(directory)
            path.mkdir() if kind == "folder" else path.symlink_to(folder / "victim")

    return make


def foreign(folder: Path, prepared: Prepared) -> None:
    file("out/meshes/part_x.stl", "mine")(folder, prepared)
    file("out/meshes/part_99.stl", "mine")(folder, prepared)
    file("out/meshes/notes.txt", "mine")(folder, prepared)


def elsewhere(folder: Path, prepared: Prepared) -> None:
    file("victim/part_x.stl", "mine")(folder, prepared)
    file("victim/part_0.stl", "mine")(folder, prepared)
    (folder / "out").mkdir(exist_ok=True)
    (folder / "out" / "meshes").symlink_to("../victim")


VICTIM = file("victim", "precious")


def through(name: str, command: str, at: str, make: Maker = MODEL) -> Case:
    """A symbolic link where a file is written."""
    return Case(f"link: {name}", command, both(make, VICTIM, link(at, "/victim")), may=ANY)


CASES = [
    Case(
        "export: foreign meshes",
        URDF,
        both(MODEL, foreign),
        may=("accepted",),
        keeps=("out/meshes/part_x.stl", "out/meshes/part_99.stl", "out/meshes/notes.txt"),
    ),
    Case(
        "fit: foreign meshes",
        FIT,
        both(given("frames"), foreign),
        may=("accepted",),
        keeps=("out/meshes/part_x.stl", "out/meshes/part_99.stl", "out/meshes/notes.txt"),
    ),
    Case("export: meshes that are a link", URDF, both(MODEL, elsewhere), may=ANY),
    through("pose: a partial file", POSE, "out/.pose.json.partial"),
    through("export: a partial file", URDF, "out/.robot.urdf.partial"),
    through("figure: the picture", FIGURE, "out/a.png"),
    Case("link: a stage's log", RUN, both(DONE, log("link")), may=ANY),
    Case("a stage's log is a folder", RUN, both(DONE, log("folder")), may=ANY, says="box.*(director|folder|log)"),
    without_permission(
        "a sequence's folder",
        RUN,
        both(
            DONE,
            gone("workdir/scans/box/flow-*/"),
            closed("workdir/scans/box", mode=0o555),
        ),
        says="box.*permission denied",
    ),
    without_permission("an artifact's folder, status", STATUS, both(DONE, closed("workdir/scans/box/flow-*/")), ANY),
    without_permission("an artifact's folder, run", RUN, both(DONE, closed("workdir/scans/box/flow-*/")), ANY),
    without_permission(
        "the ground truth",
        FIT + " --truth frames/ground_truth.npz",
        both(given("frames"), closed("frames/ground_truth.npz")),
    ),
    without_permission(
        "weights",
        FIT + " --set flow.estimator=network --set flow.network.weights=w.safetensors",
        both(given("frames"), file("w.safetensors", "x"), closed("w.safetensors")),
    ),
    without_permission("model.json", POSE, both(MODEL, closed("model/model.json"))),
    on_full("fit of 300 kB", FIT, given("frames"), 300),
    *[delivering(kilobytes) for kilobytes in (8, 40, 80)],
    on_full("run", RUN.replace("workdir workdir", "workdir out"), given("data"), 1000),
    on_full("evaluate", f"{EVALUATE} --out out", DONE, 300),
    on_full("pose", POSE, MODEL, 8),
    on_full("export", URDF, MODEL, 20),
    on_full("figure", FIGURE, MODEL, 20),
    Case("little address space", f"ulimit -v 900000; {FIT}", given("frames"), may=ANY, says="written|memory|alloc|map"),
    Case(
        "the working directory goes away",
        f"(sleep 3.5; rm -rf out) & {FIT}; code=$?; wait; exit $code",
        given("frames"),
        may=ANY,
        says="written|no such|not found|gone|missing",
    ),
    *similar(
        through("pose: posed.ply", POSE, "out/posed.ply"),
        through("fit: model.json", FIT, "out/model.json", given("frames")),
        through("fit: a partial file", FIT, "out/.model.npz.partial", given("frames")),
        through("evaluate: a page", EVALUATE, "workdir/scans/evaluation/sequences/.box.html.partial", DONE),
        through("figure: a partial file", FIGURE, "out/.a.png.partial"),
        Case(
            "link: out leads elsewhere",
            FIT,
            both(given("frames"), a_folder("mine"), link("out", "/mine")),
            may=ANY,
            writes=("mine",),
        ),
        Case(
            "link: out leads nowhere", FIT, both(given("frames"), link("out", "/nowhere")), may=ANY, writes=("nowhere",)
        ),
        Case("link: out leads to itself", FIT, both(given("frames"), link("out", "out")), may=WRONG),
        Case("link: a mesh", URDF, both(MODEL, VICTIM, link("out/meshes/part_0.stl", "/victim")), may=ANY),
        Case(
            "a folder in place of model.json",
            FIT,
            both(given("frames"), a_folder("out/model.json")),
            may=WRONG,
            says="model.json",
        ),
        Case(
            "a folder in place of posed.ply",
            POSE,
            both(MODEL, a_folder("out/posed.ply")),
            may=WRONG,
            says="posed.ply",
        ),
        Case("a file in place of meshes", URDF, both(MODEL, file("out/meshes", "x")), may=WRONG, says="meshes"),
        Case("a pipe in place of model.json", f"mkdir out; mkfifo out/model.json; {FIT}", given("frames"), may=ANY),
        Case(
            "a folder in place of the picture",
            FIGURE,
            both(MODEL, a_folder("out/a.png")),
            may=WRONG,
        ),
        Case("out within a file", FIT.replace("--out out", "--out frames/frame_0.npy/x"), given("frames"), may=WRONG),
        Case("out on a device", FIT.replace("--out out", "--out /dev/null"), given("frames"), may=WRONG),
        Case("out in /proc", FIT.replace("--out out", "--out /proc/x"), given("frames"), may=WRONG),
        Case(
            "out with a long name",
            FIT.replace("--out out", f"--out {'x' * 255}/y"),
            given("frames"),
            may=ANY,
            writes=("x" * 255,),
        ),
        Case(
            "the lock of a partial file",
            POSE,
            both(MODEL, a_folder("out/.pose.json.partial")),
            may=ANY,
        ),
        without_permission(
            "out",
            FIT,
            both(given("frames"), a_folder("out"), closed("out", mode=0o555)),
        ),
        without_permission(
            "out's meshes",
            URDF,
            both(
                MODEL,
                a_folder("out/meshes"),
                closed("out/meshes", mode=0o555),
            ),
        ),
        without_permission("a frame", FIT, both(given("frames"), closed("frames/frame_2.npy"))),
        without_permission("the folder of frames", FIT, both(given("frames"), closed("frames"))),
        without_permission(
            "one sequence of two",
            RUN.replace("workdir workdir", "workdir out"),
            both(given("data"), closed("data/box/frame_2.npy")),
            ANY,
            check=lambda folder, ran: (
                ""
                if list((folder / "out/scans/lid").glob("report-*/manifest.json"))
                else "the other sequence was not fitted"
            ),
        ),
        without_permission(
            "one sequence's folder of two",
            RUN.replace("workdir workdir", "workdir out"),
            both(given("data"), closed("data/box")),
            ANY,
            check=lambda folder, ran: (
                ""
                if list((folder / "out/scans/lid").glob("report-*/manifest.json"))
                else "the other sequence was not fitted"
            ),
        ),
        without_permission(
            "a manifest", EVALUATE, both(DONE, closed("workdir/scans/box/evaluation-*/manifest.json")), ANY
        ),
        without_permission(
            "an array, evaluate", EVALUATE, both(DONE, closed("workdir/scans/box/result-*/model.npz")), ANY, says=""
        ),
        without_permission(
            "an array, run", RUN, both(DONE, closed("workdir/scans/box/report-*/report.html")), ANY, says=""
        ),
        without_permission("a sequence's folder, status", STATUS, both(DONE, closed("workdir/scans/box")), ANY),
        without_permission("a sequence's folder, evaluate", EVALUATE, both(DONE, closed("workdir/scans/box")), ANY),
        without_permission("a sequence's folder, run", RUN, both(DONE, closed("workdir/scans/box")), ANY),
        without_permission("the data set's folder", RUN, both(DONE, closed("workdir/scans")), ANY),
        without_permission(
            "the evaluation's folder", RUN, both(DONE, closed("workdir/scans/evaluation", mode=0o555)), ANY
        ),
        without_permission(
            "a preset",
            "reart fit frames --out out --preset mine.toml",
            both(given("frames"), file("mine.toml", ""), closed("mine.toml")),
        ),
        without_permission(
            "targets", "reart pose model --targets t.csv", both(MODEL, file("t.csv", ""), closed("t.csv"))
        ),
        without_permission(
            "an earlier evaluation", f"{EVALUATE} --against e.json", both(DONE, file("e.json", "{}"), closed("e.json"))
        ),
        without_permission(
            "a description",
            "reart run --dataset urdf --data arm.urdf --workdir out",
            both(file("arm.urdf", "<robot/>"), closed("arm.urdf")),
        ),
        on_full("fit of 16 kB", FIT, given("frames"), 16),
        on_full("fit of 700 kB", FIT, given("frames"), 700),
        full_temporary(),
        on_full(
            "train-flow",
            "reart train-flow --out out --preset smoke --set steps=1 --set validation_pairs=1",
            lambda folder, prepared: None,
            200,
        ),
        Case(
            "files of 100 kB at most",
            f"ulimit -f 100; {FIT}",
            given("frames"),
            may=ANY,
            says="written|too large|SIGXFSZ|size",
        ),
        Case(
            "few files open at once",
            f"ulimit -n 16; {FIT}",
            given("frames"),
            may=ANY,
            says="written|too many|open files",
        ),
        Case(
            "little time",
            f"ulimit -t 2; {FIT}",
            given("frames"),
            may=ANY,
            says="written|SIGXCPU|SIGKILL|time",
            exits=(152, 137),
        ),
        Case(
            "very little address space",
            f"ulimit -v 200000; {FIT}",
            given("frames"),
            may=ANY,
            says="written|memory|alloc|map|thread",
        ),
        Case(
            "a mask that hides all",
            f"umask 777; {OBEYING} {FIT}",
            both(given("frames"), open_all),
            may=ANY,
            needs_root=True,
        ),
        Case(
            "the input goes away",
            f"(sleep 3; rm -rf frames) & {FIT}; code=$?; wait; exit $code",
            given("frames"),
            may=ANY,
            writes=("frames",),
        ),
        Case(
            "the output becomes a file",
            f"(sleep 3; rm -rf out; echo x > out) & {FIT}; code=$?; wait; exit $code",
            given("frames"),
            may=ANY,
            says="written|director|folder|gone|missing",
        ),
    ),
]
