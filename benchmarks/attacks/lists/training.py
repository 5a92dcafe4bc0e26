"""Checkpoints, logs and weights of the flow network."""

from __future__ import annotations

import json
import shutil
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np

from attacks.case import Case, Verdict, similar
from attacks.hinge import Prepared
from attacks.lists.makers import FIT, a_folder, both, file, given, gone, sparse

ANY: tuple[Verdict, ...] = ("refused", "failed", "accepted")
REFUSED: tuple[Verdict, ...] = ("refused",)
TRAIN = (
    "reart train-flow --out out --preset smoke --set steps={} --set validate_every=1 --set validation_pairs=1 "
    "--set points=64 --set batch=1 --set 'robots=[]' --set robot_share=0 --set 'validation_robots=[]'"
)
STEPS = 2
SHIPPED = Path(__file__).parents[3] / "stages" / "flow" / "network" / "weights.safetensors"
NETWORK = FIT + " --set flow.estimator=network --set flow.network.weights=w.safetensors"


def trained(folder: Path, prepared: Prepared) -> None:
    """A training that was broken off after its first step: made once."""
    kept = prepared.folder / "training"
    if not (kept / "checkpoint.safetensors").exists():
        ran = prepared.run(TRAIN.format(STEPS).replace("--out out", "--out training"), prepared.folder)
        if ran.code != 0:
            raise RuntimeError(f"train-flow: exit code {ran.code}\n{ran.words}")
    shutil.copytree(kept, folder / "out")


def checkpoint(
    name: str,
    change: Callable[[bytes], bytes],
    file_name: str = "checkpoint.safetensors",
    may: tuple[Verdict, ...] = ANY,
) -> Case:
    def make(folder: Path, prepared: Prepared) -> None:
        trained(folder, prepared)
        path = folder / "out" / file_name
        path.write_bytes(change(path.read_bytes()))

    return Case(f"checkpoint: {name}", TRAIN.format(STEPS), make, may=may)


def weights(name: str, change: Callable[[bytes], bytes], may: tuple[Verdict, ...] = REFUSED) -> Case:
    return Case(
        f"weights: {name}",
        NETWORK,
        both(given("frames"), file("w.safetensors", change(SHIPPED.read_bytes()))),
        may=may,
    )


def head(change: Callable[[dict], object]) -> Callable[[bytes], bytes]:  # type: ignore[type-arg]
    """Another header before the same numbers."""

    def changed(content: bytes) -> bytes:
        (length,) = struct.unpack("<Q", content[:8])
        header = json.loads(content[8 : 8 + length])
        other = change(header)
        text = other if isinstance(other, bytes) else json.dumps(header).encode()
        return struct.pack("<Q", len(text)) + text + content[8 + length :]

    return changed


def nan(content: bytes) -> bytes:
    (length,) = struct.unpack("<Q", content[:8])
    numbers = np.frombuffer(content[8 + length :], "<f4").copy()
    numbers[::50] = np.nan
    return content[: 8 + length] + numbers.tobytes()


def huge(content: bytes) -> bytes:
    return content[:-4000] + np.full(1000, 1e30, "<f4").tobytes()


def flip_at(share: float) -> Callable[[bytes], bytes]:
    def flip(content: bytes) -> bytes:
        changed = bytearray(content)
        changed[int(share * (len(content) - 1))] ^= 0x10
        return bytes(changed)

    return flip


def notes(**values: str) -> Callable[[dict], object]:  # type: ignore[type-arg]
    return lambda header: header["__metadata__"].update(values)


CASES = [
    *[checkpoint(f"a flipped byte at {share:.1%}", flip_at(share)) for share in (0.0, 0.0055, 0.01, 0.03, 0.3, 0.9)],
    *[
        checkpoint(f"cut to {share:.0%}", lambda content, share=share: content[: int(share * len(content))])  # type: ignore[misc]
        for share in (0.0, 0.01, 0.5, 0.99)
    ],
    checkpoint("numbers that are NaN", nan),
    weights("numbers that are NaN", nan),
    Case(
        "a killed loader",
        "(for try in $(seq 600); do sleep 0.1; loader=$(pgrep -s 0 -f '[s]pawn_main.*-fork' | head -1); "
        '[ "$loader" ] && sleep 2 && kill -9 $loader && break; done) & ' + TRAIN.format(2000),
        may=("failed", "refused"),
        says="killed|ended|loader|SIGKILL",
    ),
    *similar(
        checkpoint("a step of words", head(notes(step="two"))),
        checkpoint("a step of -1", head(notes(step="-1"))),
        checkpoint("a step of 10 ** 30", head(notes(step=str(10**30)))),
        checkpoint("no notes", head(lambda header: header.pop("__metadata__"))),
        checkpoint("notes that lack the step", head(lambda header: header["__metadata__"].pop("step"))),
        checkpoint(
            "a tensor that is missing", head(lambda header: header.pop(next(iter(set(header) - {"__metadata__"}))))
        ),
        checkpoint(
            "a tensor of another name",
            head(
                lambda header: header.update(
                    {"optimizer.x.exp_avg": header.pop(sorted(set(header) - {"__metadata__"})[0])}
                )
            ),
        ),
        checkpoint("a header that nests", head(lambda header: b"[" * 100_000)),
        checkpoint("a header of 2 ** 60 bytes", lambda content: struct.pack("<Q", 2**60) + content[8:]),
        checkpoint("text", lambda content: b"hello"),
        checkpoint("a log that is empty", lambda content: b"", "log.jsonl"),
        checkpoint("a log of bytes", lambda content: bytes(range(256)), "log.jsonl"),
        checkpoint("a log that is cut", lambda content: content[: len(content) - 9], "log.jsonl"),
        checkpoint("a log that nests", lambda content: b"[" * 100_000, "log.jsonl"),
        Case(
            "checkpoint: a log that is missing",
            TRAIN.format(STEPS),
            both(trained, gone("out/log.jsonl")),
            may=ANY,
        ),
        Case(
            "checkpoint: a folder",
            TRAIN.format(STEPS),
            a_folder("out/checkpoint.safetensors"),
            may=ANY,
        ),
        Case("checkpoint: 3 GiB of zeros", TRAIN.format(STEPS), sparse("out/checkpoint.safetensors"), may=REFUSED),
        weights("text", lambda content: b"hello"),
        weights("nothing", lambda content: b""),
        weights("cut in the middle", lambda content: content[: len(content) // 2]),
        weights("a header of 2 ** 60 bytes", lambda content: struct.pack("<Q", 2**60) + content[8:]),
        weights("a header that nests", head(lambda header: b"[" * 100_000)),
        weights("no notes", head(lambda header: header.pop("__metadata__"))),
        weights("another format", head(notes(format="other"))),
        weights(
            "numbers of 1e30",
            lambda content: content[:-4000] + np.full(1000, 1e30, "<f4").tobytes(),
            ("refused", "failed"),
        ),
        weights("a pickle", lambda content: b"\x80\x04K\x01."),
        Case("weights: 3 GiB of zeros", NETWORK, both(given("frames"), sparse("w.safetensors")), may=REFUSED),
        Case(
            "weights: a pipe",
            f"mkfifo w.safetensors; {NETWORK}",
            given("frames"),
            may=REFUSED,
            seconds=30,
            writes=("w.safetensors",),
        ),
        Case("assets that are not there", TRAIN.format(STEPS) + " --assets nowhere", may=ANY),
        Case(
            "robots that are not there",
            "reart train-flow --out out --preset smoke --set 'robots=[\"../x\"]'",
            may=REFUSED,
        ),
        Case("settings of another training", TRAIN.format(STEPS + 1), trained, may=REFUSED),
    ),
]
