"""Models for pose, export and figure that are not what `reart fit` wrote."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from attacks.case import Case, Maker, Verdict, similar
from attacks.hinge import Prepared
from attacks.lists.makers import a_folder, a_pipe, both, changed_json, file, given, gone, npy_head, sparse, zeros_in_zip

REFUSED: tuple[Verdict, ...] = ("refused",)
POSE = "reart pose model --states states.json --out out"
EXPORT = "reart export model --to mjcf --out out && reart export model --to urdf --out out"
FIGURE = "reart figure model --out out/a.png"


def alone(folder: Path, prepared: Prepared) -> None:
    """A model as it is sent to someone: without its artifacts."""
    shutil.rmtree(folder / "model" / "workdir")


SOUND = both(given("model"), file("states.json", "{}"), alone)


def unsealed(folder: Path, prepared: Prepared) -> None:
    """Without the digests, so that what is said of the content itself is tried."""
    path = folder / "model" / "model.json"
    content = json.loads(path.read_bytes())
    path.write_text(json.dumps({key: value for key, value in content.items() if not key.endswith("_sha256")}, indent=1))


def every(
    name: str,
    make: Maker,
    may: tuple[Verdict, ...] = REFUSED,
    base: Maker = SOUND,
    says: str = "",
    writes: tuple[str, ...] = (),
) -> list[Case]:
    """The three commands that read a model."""
    return [
        Case(f"{name}: {what}", command, both(base, make), may=may, seconds=60, says=says, writes=writes)
        for what, command in (("pose", POSE), ("export", EXPORT), ("figure", FIGURE))
    ]


def some(name: str, make: Maker, may: tuple[Verdict, ...] = REFUSED) -> list[Case]:
    """The cheapest of the three: what they say of a model, they say by one function."""
    return [Case(name, POSE, both(SOUND, make), may=may, seconds=60)]


def one(name: str, make: Maker, may: tuple[Verdict, ...] = REFUSED, command: str = POSE) -> Case:
    return Case(name, command, both(SOUND, make), may=may, seconds=60)


def model(name: str, change: Callable[[Any], Any], may: tuple[Verdict, ...] = REFUSED) -> list[Case]:
    """A model.json that was changed: all three commands where it may be taken, since they use what it says."""
    commands = every if "accepted" in may else some
    return commands(name, both(unsealed, changed_json("model/model.json", change)), may)


def text(change: Callable[[str], str], encoding: str = "utf-8") -> Maker:
    def make(folder: Path, prepared: Prepared) -> None:
        unsealed(folder, prepared)
        path = folder / "model" / "model.json"
        path.write_text(change(path.read_text()), encoding)

    return make


def arrays(**changes: Callable[[np.ndarray], np.ndarray | None]) -> Maker:
    """A model.npz with other arrays."""

    def make(folder: Path, prepared: Prepared) -> None:
        unsealed(folder, prepared)
        path = folder / "model" / "model.npz"
        content = dict(np.load(path))
        for name, change in changes.items():
            other = change(content.get(name, np.zeros(1)))
            content = {key: value for key, value in content.items() if key != name}
            content |= {} if other is None else {name: other}
        np.savez(path, **content)

    return make


def flipped(path: str) -> Maker:
    """A byte in the middle of a file, flipped; of the result's artifact where the path says so."""

    def make(folder: Path, prepared: Prepared) -> None:
        [found] = folder.glob(path)
        content = bytearray(found.read_bytes())
        content[len(content) // 2] ^= 1
        found.write_bytes(content)

    return make


def digit(folder: Path, prepared: Prepared) -> None:
    """Another last digit in the point of a joint: still a model, and not the one that was fitted."""
    [path] = folder.glob("model/model.json")
    content = json.loads(path.read_bytes())
    content["joints"][0]["point"][0] += 0.25
    path.write_text(json.dumps(content, indent=1))


def other_arrays(folder: Path, prepared: Prepared) -> None:
    shutil.copy(prepared.folder / "lid_model" / "model.npz", folder / "model" / "model.npz")


def artifact(folder: Path, prepared: Prepared) -> None:
    """The result's artifact in place of `model`."""
    prepared.give(folder, "workdir")
    [result] = (folder / "workdir" / "scans" / "box").glob("result-*/")
    (folder / "model").symlink_to(result.relative_to(folder))
    (folder / "states.json").write_text("{}")


def bomb(folder: Path, prepared: Prepared) -> None:
    (folder / "model" / "model.npz").unlink()
    zeros_in_zip(folder / "model" / "model.npz", {"canonical_points.npy": npy_head((270_000_000, 3), "<f4")}, 3 * 2**30)


def set_part(name: str) -> Callable[[Any], Any]:
    def change(content: Any) -> None:
        content["parts"][0]["name"] = name

    return change


def set_joint(**values: Any) -> Callable[[Any], Any]:
    return lambda content: content["joints"][0].update(values)


DEEP = "[" * 200_000 + "]" * 200_000
WRONG: tuple[Verdict, ...] = ("refused", "failed")

CASES = [
    *model("point_count of -5", lambda m: m["parts"][0].update(point_count=-5)),
    *every("the arrays of another model", other_arrays),
    *every("nested JSON", file("model/model.json", DEEP)),
    *every("a changed digit", digit, WRONG),
    *every(
        "a flipped byte in an artifact's model.npz", flipped("workdir/scans/box/result-*/model.npz"), WRONG, artifact
    ),
    *every("a changed digit in an artifact", digit, WRONG, artifact),
    *similar(
        *model("point_count that does not add up", lambda m: m["parts"][0].update(point_count=7)),
        *model("an axis of NaN", set_joint(axis=[float("nan"), 0, 1])),
        *model("a field that is unknown", lambda m: m.update(more=1), ("refused", "accepted")),
        *model("version 99", lambda m: m.update(version=99)),
        *model("a version in words", lambda m: m.update(version="one")),
        *model("parts that are numbers", lambda m: m.update(parts=[1, 2])),
        *model("no parts", lambda m: m.update(parts=[], joints=[])),
        *model("a list", lambda m: [m]),
        *model("frames of 10 ** 30", lambda m: m.update(frames=10**30)),
        *model("a root of -1", lambda m: m.update(root=-1)),
        *model("a joint whose parts are one", set_joint(parent=0, child=0)),
        *model("states that are missing", set_joint(states=[])),
        *model(
            "states of 1e14", lambda m: set_joint(states=[1e14] * m["frames"], upper=1e14)(m), ("refused", "accepted")
        ),
        *model("a number of 400 digits", set_joint(lower=-(10**400))),
        *model("a part named ../../victim", set_part("../../victim"), ("refused", "accepted")),
        *model("a part named by markup", set_part("<a>&\"'[/red]"), ("refused", "accepted")),
        *model("a joint named by markup", set_joint(name="[/red]<b>"), ("refused", "accepted")),
        *model("a part named by half a character", set_part("\ud800"), ("refused", "accepted")),
        *model("a part named by a megabyte", set_part("x" * 10**6), ("refused", "accepted")),
        *model("a part named world", set_part("world"), ("refused", "accepted")),
        *model(
            "a joint named as a part is", lambda m: set_joint(name=m["parts"][0]["name"])(m), ("refused", "accepted")
        ),
        *model("a joint named root", set_joint(name="root"), ("refused", "accepted")),
        *some("a key twice", text(lambda s: s.replace('"root"', '"units": "metre", "root"')), ("refused", "accepted")),
        *some("a byte order mark", text(lambda s: "\ufeff" + s), ("refused", "accepted")),
        *some(
            "UTF-16",
            text(lambda s: s, "utf-16"),
        ),
        *some("nothing", file("model/model.json", "")),
        *some("points of NaN", arrays(canonical_points=lambda a: a * np.nan)),
        *some("points of 1e30", arrays(canonical_points=lambda a: a * np.float32(1e30))),
        *some("no points", arrays(canonical_points=lambda a: a[:0], labels=lambda a: a[:0])),
        *some("points that are fewer than labels", arrays(canonical_points=lambda a: a[:-1])),
        *some("labels that are unknown", arrays(labels=lambda a: a + 1)),
        *some("labels of one part only", arrays(labels=lambda a: a * 0), ("refused", "accepted")),
        *some("labels that are fractions", arrays(labels=lambda a: a + 0.5)),
        *some("motions that shear", arrays(T_frame_canonical=lambda a: a * 2)),
        *some("motions of the mirror", arrays(T_frame_canonical=lambda a: a * [1, 1, -1, 1])),
        *some("an array that is missing", arrays(labels=lambda a: None)),
        *some("an array that is not known", arrays(more=lambda a: a), ("refused", "accepted")),
        *some("an array of objects that is not known", arrays(more=lambda a: np.array([{}])), ("refused", "accepted")),
        *some("an archive of 3 GiB", bomb),
        *some(
            "model.json of 3 GiB",
            both(gone("model/model.json"), sparse("model/model.json")),
        ),
        one(
            "model.json that is a folder",
            a_folder("model/model.json"),
        ),
        one(
            "model.json that is a pipe",
            a_pipe("model/model.json"),
        ),
        one("model.npz that is text", file("model/model.npz", "hello")),
        one("model.npz that is missing", gone("model/model.npz")),
        one("a model that is a file", file("x", ""), command="reart pose x --states states.json"),
        one("a model that is a device", file("x", ""), command="reart pose /dev/null --states states.json"),
    ),
]
