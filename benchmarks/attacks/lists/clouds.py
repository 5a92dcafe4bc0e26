"""Frames as PLY and PCD whose headers and bodies do not agree, or say more than they should."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from attacks.case import Case, Check, Verdict, similar
from attacks.hinge import Prepared
from attacks.lists.makers import FIT, both, each_frame, found, given, gone, said, sparse

Writer = Callable[[np.ndarray], bytes]
XYZ = "property float x\nproperty float y\nproperty float z\n"
REFUSED: tuple[Verdict, ...] = ("refused",)
EITHER: tuple[Verdict, ...] = ("refused", "accepted")
READ: tuple[Verdict, ...] = ("accepted",)


def lines(p: np.ndarray, more: str = "") -> str:
    return "".join(f"{x:.6f} {y:.6f} {z:.6f}{more}\n" for x, y, z in p)


def ply(
    name: str,
    header: str,
    body: Writer = lambda p: lines(p).encode(),
    may: tuple[Verdict, ...] = EITHER,
    kind: str = "ascii",
    first: bytes = b"ply\n",
    check: Check | None = None,
) -> Case:
    """PLY frames; N in the header stands for the number of points."""

    def write(path: Path, p: np.ndarray) -> None:
        head = f"format {kind} 1.0\n{header.replace('N', str(len(p)))}end_header\n"
        path.write_bytes(first + head.encode("latin1") + body(p))

    return Case(name, FIT, each_frame(write, ".ply"), may=may, check=check or found())


def pcd(
    name: str,
    changes: dict[str, str],
    body: Writer = lambda p: lines(p).encode(),
    may: tuple[Verdict, ...] = EITHER,
    first: str = "",
    check: Check | None = None,
) -> Case:
    """PCD frames with some lines of the header changed."""

    def write(path: Path, p: np.ndarray) -> None:
        head = {
            "VERSION": "0.7",
            "FIELDS": "x y z",
            "SIZE": "4 4 4",
            "TYPE": "F F F",
            "COUNT": "1 1 1",
            "WIDTH": "#",
            "HEIGHT": "1",
            "VIEWPOINT": "0 0 0 1 0 0 0",
            "POINTS": "#",
            "DATA": "ascii",
        } | changes
        text = "".join(f"{key} {value}\n" for key, value in head.items() if value).replace("#", str(len(p)))
        path.write_bytes((first + text).encode("latin1") + body(p))

    return Case(name, FIT, each_frame(write, ".pcd"), may=may, check=check or found())


def compressed(folder: Path, prepared: Prepared) -> None:
    """Compressed PCD, and an Open3D that fails to load for want of a system's library."""
    import open3d

    (folder / "frames").mkdir()
    for t in range(2):
        cloud = open3d.geometry.PointCloud(
            open3d.utility.Vector3dVector(np.random.default_rng(t).uniform(size=(200, 3)))
        )
        open3d.io.write_point_cloud(str(folder / "frames" / f"f{t}.pcd"), cloud, compressed=True)
    (folder / "fake" / "open3d").mkdir(parents=True)
    (folder / "fake" / "open3d" / "__init__.py").write_text(
        'raise OSError("libusb-1.0.so.0: cannot open shared object")\n'
    )


def floats(p: np.ndarray) -> bytes:
    return p.astype("<f4").tobytes()


def with_lists(p: np.ndarray) -> bytes:
    return b"".join(row.astype("<f4").tobytes() + b"\x02" + np.array([7, 8], "<i4").tobytes() for row in p)


def after_faces(p: np.ndarray) -> bytes:
    return (b"\x03" + np.array([0, 1, 2], "<i4").tobytes()) * 2 + floats(p)


VERTEX = f"element vertex N\n{XYZ}"
FACES = "element face 2\nproperty list uchar int vertex_indices\n"

CASES = [
    ply("ply with a byte order mark", VERTEX, first=b"\xef\xbb\xbfply\n", may=READ),
    ply("ply with X Y Z", VERTEX.replace(" x\n", " X\n").replace(" y\n", " Y\n").replace(" z\n", " Z\n"), may=READ),
    ply(
        "ply with a list on vertices",
        f"{VERTEX}property list uchar int near\n",
        lambda p: lines(p, " 2 7 8").encode(),
        may=READ,
    ),
    ply(
        "binary ply with a list on vertices",
        f"{VERTEX}property list uchar int near\n",
        with_lists,
        may=READ,
        kind="binary_little_endian",
    ),
    ply("binary ply with faces first", FACES + VERTEX, after_faces, may=READ, kind="binary_little_endian"),
    ply(
        "ply with a property twice",
        f"{VERTEX}property float x\n",
        lambda p: lines(p, " 9").encode(),
        may=EITHER,
        check=said("twice|second time|x"),
    ),
    pcd("pcd whose POINTS and WIDTH differ", {"WIDTH": "100"}, may=EITHER, check=said("WIDTH")),
    pcd("pcd whose POINTS are fewer", {"POINTS": "100"}, may=EITHER, check=said("POINTS")),
    Case(
        "pcd where Open3D cannot load",
        f'PYTHONPATH="$PWD/fake:$PYTHONPATH" {FIT}',
        compressed,
        may=REFUSED,
        says="Open3D",
    ),
    *similar(
        ply(
            "ply with ascii faces first", FACES + VERTEX, lambda p: b"3 0 1 2\n3 0 1 2\n" + lines(p).encode(), may=READ
        ),
        ply(
            "ply with lists of floats and doubles",
            f"{VERTEX}property list float double near\n",
            lambda p: lines(p, " 2 7 8").encode(),
        ),
        ply(
            "ply with a negative list",
            f"{VERTEX}property list char int near\n",
            lambda p: b"".join(row.astype("<f4").tobytes() + b"\xff" for row in p),
            may=REFUSED,
            kind="binary_little_endian",
        ),
        ply(
            "ply with an endless list",
            f"{VERTEX}property list uint double near\n",
            lambda p: b"".join(row.astype("<f4").tobytes() + b"\xff\xff\xff\xff" for row in p),
            may=REFUSED,
            kind="binary_little_endian",
        ),
        ply(
            "ply with x as a list",
            "element vertex N\nproperty list uchar float x\nproperty float y\nproperty float z\n",
            lambda p: "".join(f"1 {x} {y} {z}\n" for x, y, z in p).encode(),
        ),
        ply("ply with an element twice", VERTEX + VERTEX, lambda p: (lines(p) + lines(p)).encode()),
        ply("ply with 999999999999 points", VERTEX.replace("N", "999999999999"), may=REFUSED),
        ply(
            "binary ply with 999999999999 points",
            VERTEX.replace("N", "999999999999"),
            floats,
            may=REFUSED,
            kind="binary_little_endian",
        ),
        ply(
            "ply with an element of 999999999999 before",
            "element junk 999999999999\nproperty float a\n" + VERTEX,
            may=REFUSED,
        ),
        ply(
            "binary ply with lists of 999999999999 before",
            "element junk 999999999999\nproperty list uchar int a\n" + VERTEX,
            floats,
            may=REFUSED,
            kind="binary_little_endian",
        ),
        ply(
            "ply with an empty element before",
            "element junk 0\nproperty list uchar int a\n" + VERTEX,
            floats,
            may=READ,
            kind="binary_little_endian",
        ),
        ply(
            "ply with a thousand properties",
            VERTEX + "".join(f"property uchar a{k}\n" for k in range(1000)),
            lambda p: b"".join(row.astype("<f4").tobytes() + bytes(1000) for row in p),
            may=READ,
            kind="binary_little_endian",
        ),
        ply("ply with -5 points", VERTEX.replace("N", "-5"), may=REFUSED),
        ply("ply with no points", VERTEX.replace("N", "0"), lambda p: b"", may=REFUSED),
        ply("ply with integers", VERTEX.replace("float", "int"), may=EITHER),
        ply("ply with texts in it", VERTEX, lambda p: b"a b c\n" * len(p), may=REFUSED),
        ply("ply with NaN everywhere", VERTEX, lambda p: b"nan nan nan\n" * len(p), may=REFUSED),
        ply("ply cut in the middle", VERTEX, lambda p: floats(p)[:-5], may=REFUSED, kind="binary_little_endian"),
        ply("ply with more than it declares", VERTEX, lambda p: floats(p) * 2, kind="binary_little_endian"),
        ply("ply of another format", VERTEX, may=REFUSED, kind="binary_middle_endian"),
        ply("ply without a format", VERTEX, may=REFUSED, kind=""),
        ply("ply with comments in latin-1", f"comment Gerät\nobj_info 3\n{VERTEX}", may=READ),
        ply("ply whose comment says end_header", f"comment end_header\n{VERTEX}", may=READ),
        ply(
            "ply with carriage returns",
            VERTEX.replace("\n", "\r\n"),
            lambda p: lines(p).replace("\n", "\r\n").encode(),
            first=b"ply\r\n",
        ),
        ply("ply with y missing", VERTEX.replace("property float y\n", ""), may=REFUSED),
        ply("ply with a property before any element", f"property float a\n{VERTEX}", may=REFUSED),
        Case(
            "ply without an end of its header",
            FIT,
            each_frame(
                lambda path, p: path.write_bytes(b"ply\nformat ascii 1.0\n" + b"comment a\n" * 3_000_000),
                ".ply",
                frames=2,
            ),
            may=REFUSED,
        ),
        Case(
            "ply of 3 GiB of zeros",
            FIT,
            both(
                given("frames"),
                gone("frames/*"),
                *(
                    sparse(
                        f"frames/f{t}.ply",
                        b"ply\nformat binary_little_endian 1.0\n"
                        + VERTEX.replace("N", "134000000").encode()
                        + b"end_header\n",
                    )
                    for t in range(2)
                ),
            ),
            may=REFUSED,
        ),
        pcd(
            "pcd with x twice",
            {"FIELDS": "x x y z", "SIZE": "4 4 4 4", "TYPE": "F F F F", "COUNT": "1 1 1 1"},
            lambda p: b"".join(b"9 " + f"{x} {y} {z}\n".encode() for x, y, z in p),
            check=said("twice|second time|x"),
        ),
        pcd("pcd with X Y Z", {"FIELDS": "X Y Z"}),
        pcd(
            "pcd with fields of padding",
            {"FIELDS": "x y z _", "SIZE": "4 4 4 1", "TYPE": "F F F U", "COUNT": "1 1 1 4", "DATA": "binary"},
            lambda p: b"".join(row.astype("<f4").tobytes() + bytes(4) for row in p),
            may=READ,
        ),
        pcd("pcd with a COUNT of a billion", {"COUNT": "1 1 1000000000"}, may=REFUSED),
        pcd("pcd with a COUNT of 0", {"COUNT": "1 1 0"}, may=REFUSED),
        pcd("pcd with a COUNT of 2", {"COUNT": "2 1 1"}, lambda p: lines(p, " 0").encode()),
        pcd("pcd of 999999999999 points", {"POINTS": "999999999999", "WIDTH": "999999999999"}, floats, may=REFUSED),
        pcd(
            "pcd of 1e12 by 1e12 points", {"POINTS": "", "WIDTH": "999999999999", "HEIGHT": "999999999999"}, may=REFUSED
        ),
        pcd("pcd whose size is negative", {"POINTS": "-1", "WIDTH": "-1"}, may=REFUSED),
        pcd("pcd with a size of 2", {"SIZE": "2 2 2", "DATA": "binary"}, floats, may=REFUSED),
        pcd("pcd without FIELDS", {"FIELDS": ""}, may=REFUSED),
        pcd("pcd without WIDTH and POINTS", {"WIDTH": "", "POINTS": ""}, may=REFUSED),
        pcd("pcd without VERSION", {"VERSION": ""}),
        pcd("pcd with a byte order mark", {}, first="\xef\xbb\xbf"),
        pcd("pcd compressed, of garbage", {"DATA": "binary_compressed"}, lambda p: bytes(4000), may=REFUSED),
        pcd(
            "pcd compressed, of 4 GB",
            {"DATA": "binary_compressed", "POINTS": "350000000", "WIDTH": "350000000"},
            lambda p: (2000).to_bytes(4, "little") + (4_200_000_000).to_bytes(4, "little") + bytes(2000),
            may=REFUSED,
        ),
        pcd("pcd of an unknown kind", {"DATA": "parquet"}, may=REFUSED),
        pcd(
            "pcd with NaN for what was not seen",
            {},
            lambda p: ("nan nan nan\n" * 50 + lines(p[50:])).encode(),
            may=READ,
        ),
    ),
]
