"""Settings, presets and options that cannot be met."""

from __future__ import annotations

import shlex

from attacks.case import Case, Verdict, similar
from attacks.lists.makers import FIT, both, file, given, sparse

REFUSED: tuple[Verdict, ...] = ("refused",)
OWN: tuple[Verdict, ...] = ("refused", "failed")  # a function that there is, and that fails


def setting(text: str, may: tuple[Verdict, ...] = REFUSED, seconds: float = 60) -> Case:
    name = f"--set {text}" if len(text) < 60 else f"--set {text[:40]}... of {len(text)}"
    return Case(
        name,
        f"{FIT} --set {quoted(text)}",
        given("frames"),
        may=may,
        seconds=seconds,
        check=lambda folder, ran: "" if ran.seconds < 40 else f"took {ran.seconds:.0f} s",
    )


def option(words: str, command: str = FIT, may: tuple[Verdict, ...] = REFUSED, writes: tuple[str, ...] = ()) -> Case:
    return Case(f"{words[:60]}", f"{command} {words}", given("frames"), may=may, seconds=60, writes=writes)


def preset(name: str, content: bytes, may: tuple[Verdict, ...] = REFUSED) -> Case:
    return Case(
        f"preset: {name}",
        "reart fit frames --out out --preset mine.toml",
        both(given("frames"), file("mine.toml", content)),
        may=may,
        seconds=60,
    )


def quoted(text: str) -> str:
    return shlex.quote(text)


RUN = 'reart run --dataset scans --data frames --workdir out --preset "$TINY"'

CASES = [
    setting("flow.estimator=:"),
    setting("flow.geometric.stiffness=[]"),
    setting("canonical_frame.candidates=100000", ("refused", "accepted")),
    setting("canonical_frame.frames=[99]"),
    *similar(
        *[
            setting(f"flow.estimator={value}")
            for value in (
                "a:",
                ":b",
                "::",
                "json:nothing",
                "nowhere:f",
                ".:f",
                "a..b:f",
                "frames/x:f",
                "json:__name__",
                "é:é",
                "-c:f",
                "''",
                "a\nb",
                "'a:b:c'",
            )
        ],
        *[
            setting(f"flow.estimator={value}", OWN)
            for value in ("os:system", "os.path:join", "sys:exit", "os:_exit", "os:abort")
        ],
        setting("flow.estimator=geometric ", ("refused", "accepted")),
        setting("relaxed_fit.solver=:"),
        setting("relaxed_fit.solver=sys:exit", OWN),
        setting("flow.geometric.stiffness=[nan]"),
        setting("flow.geometric.stiffness=[-1]"),
        setting("flow.geometric.stiffness=[inf, 1]"),
        setting("flow.geometric.stiffness=[0]", ("refused", "accepted")),
        setting(f"flow.geometric.stiffness=[{', '.join(['1'] * 5000)}]", ("refused", "accepted")),
        setting("flow.geometric.max_distance=inf", ("refused", "accepted")),
        setting("flow.geometric.max_distance=nan"),
        setting("flow.geometric.max_distance=1e-300", ("refused", "accepted")),
        setting("final_fit.reach=inf", ("refused", "accepted")),
        setting("final_fit.part_price=nan"),
        setting("projection.lambda_spatial=1e308", ("refused", "accepted")),
        setting("canonical_frame.frames=[-1]"),
        setting("canonical_frame.frames=[0, 0]", ("refused", "accepted")),
        setting("canonical_frame.frames=[0, 6]"),
        setting("canonical_frame.frames=[1.5]"),
        setting("canonical_frame.frames=[99999999999999999999]"),
        setting("canonical_frame.fits=100000", ("refused", "accepted")),
        setting("ingest.every=0"),
        setting("ingest.every=6"),
        setting("ingest.every=99999999999999999999"),
        setting("ingest.min_points=401"),
        setting("seed=-1"),
        setting("seed=99999999999999999999999999", ("refused", "accepted")),
        setting("seed=true", ("refused", "accepted")),
        setting("seed=1.5"),
        setting("flow.geometric.points=1000000000000", ("refused", "accepted")),
        setting("flow.geometric.nodes=1000000000000", ("refused", "accepted")),
        setting("final_fit.points=99999999999999999999", ("refused", "accepted")),
        setting("flow.network.weights=/dev/zero"),
        setting("flow.network.weights=."),
        setting("flow.network.weights=nowhere.safetensors"),
        setting("flow.network.weights=''"),
        setting("relaxed_fit.alternating.start_parts=100000", ("refused", "accepted")),
        setting("relaxed_fit.alternating.patch_points=100000", ("refused", "accepted")),
        setting("export.density=inf"),
        setting("export.metres_per_unit=1e-9", ("refused", "accepted")),
        setting("export.limit_margin=1e300", ("refused", "accepted")),
        setting("export.limit_margin=inf"),
        setting("export.effort=inf", ("refused", "accepted")),
        setting("export.reach=1e-300", ("refused", "accepted")),
        setting("evaluation=5"),
        setting("=5"),
        setting("final_fit"),
        setting("final_fit..points=5"),
        setting("final_fit.points=5 = 6"),
        setting("a" * 20000 + "=1"),
        setting(".".join(["a"] * 20000) + "=1"),
        setting("flow.geometric.stiffness=" + "[" * 5000),
        setting("flow.geometric.stiffness=" + "[" * 5000 + "]" * 5000),
        setting("flow.estimator=" + "{a=" * 2000 + "1" + "}" * 2000),
        setting("final_fit.points=" + "9" * 10000),
        setting("ingest.units=parsec"),
        setting("ingest.source=roboart", ("refused", "accepted")),
        option("--workers 100000", may=("accepted",)),
        option("--truth nowhere.npz"),
        option("--truth frames", may=("refused", "accepted")),
        option("--truth /dev/null"),
        option("--preset nowhere.toml"),
        option("--preset ."),
        option("--preset /dev/zero.toml"),
        option("--preset ../tiny"),
        option("--sequences nowhere", RUN),
        option("--sequences ''", RUN),
        option("--sequences '*'", RUN),
        option("--sequences ../frames", RUN),
        option("--dataset ../..", RUN),
        option("--dataset scans-noisy", RUN),
        option("--data nowhere", RUN),
        option("--data ''", RUN, ("refused", "accepted")),
        option("--workdir frames/frame_0.npy", RUN),
        option("--workdir /proc/self", RUN),
        option("--workdir ''", RUN, ("refused", "accepted"), writes=("scans",)),
        option("--workdir " + "a/" * 3000, RUN),
        option("--workdir " + "a" * 300, RUN),
        preset("nothing", b"", ("accepted",)),
        preset("bytes", bytes(range(256))),
        preset("a list", b"seed = [1]\n"),
        preset("a table for a value", b"[seed]\nx = 1\n"),
        preset("a value for a table", b"flow = 1\n"),
        preset("a key twice", b"seed = 1\nseed = 2\n"),
        preset("nested", b"x = " + b"[" * 20000),
        preset("nested tables", b"x = " + b"{x = " * 5000),
        preset("a long key", b".".join([b"a"] * 5000) + b" = 1\n"),
        preset("a date", b"seed = 1979-05-27T07:32:00Z\n"),
        preset("a byte order mark", b"\xef\xbb\xbfseed = 1\n", ("refused", "accepted")),
        Case(
            "preset: 3 GiB of zeros",
            "reart fit frames --out out --preset mine.toml",
            both(given("frames"), sparse("mine.toml")),
            may=REFUSED,
        ),
        Case(
            "preset: a pipe",
            "mkfifo p.toml; reart fit frames --out out --preset p.toml",
            given("frames"),
            may=REFUSED,
            seconds=30,
            writes=("p.toml",),
        ),
        Case("version", "reart --version", may=("accepted",)),
        Case("short help", "reart -h && reart fit -h", may=("accepted",)),
    ),
]
