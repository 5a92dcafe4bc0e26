"""URDFs of one's own whose numbers, names, meshes or XML are not to be trusted."""

from __future__ import annotations

import struct
from collections.abc import Mapping

from attacks.case import Case, Maker, Verdict, similar
from attacks.lists.makers import a_folder, a_pipe, both, file, sparse, zeros_in_zip

REFUSED: tuple[Verdict, ...] = ("refused",)
EITHER: tuple[Verdict, ...] = ("refused", "accepted")
RUN = (
    'reart run --dataset urdf --data arm.urdf --workdir out --preset "$TINY" '
    "--set ingest.roboart.frames=3 --set ingest.roboart.points=200"
)
ARM = """<?xml version="1.0"?>
<robot name="arm">
  <link name="base"><visual><geometry><box size="0.4 0.4 0.1"/></geometry></visual></link>
  <link name="upper"><visual><origin xyz="0 0 0.3"/>
    <geometry><cylinder radius="0.05" length="0.6"/></geometry></visual></link>
  <link name="lower"><visual><origin xyz="0.2 0 0"/><geometry><box size="0.4 0.1 0.1"/></geometry></visual></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><origin xyz="0 0 0.05"/>
    <axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/><origin xyz="0 0 0.6"/>
    <axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
</robot>
"""
BOX = '<box size="0.4 0.1 0.1"/>'
CUBE = "".join(f"v {x} {y} {z}\n" for x in (0, 1) for y in (0, 1) for z in (0, 1)) + (
    "f 1 2 4\nf 1 4 3\nf 5 7 8\nf 5 8 6\nf 1 5 6\nf 1 6 2\nf 3 4 8\nf 3 8 7\nf 1 3 7\nf 1 7 5\nf 2 6 8\nf 2 8 4\n"
)


def arm(name: str, changes: Mapping[str, str], may: tuple[Verdict, ...] = REFUSED, says: str = "") -> Case:
    """The arm with some of its text exchanged, once each."""
    text = ARM
    for old, new in changes.items():
        if old not in text:
            raise ValueError(f"{name}: {old!r} is not in the description")
        text = text.replace(old, new, 1)
    return Case(name, RUN, file("arm.urdf", text), may=may, says=says, seconds=60)


def raw(name: str, content: bytes, may: tuple[Verdict, ...] = REFUSED) -> Case:
    return Case(name, RUN, file("arm.urdf", content), may=may, seconds=60)


def mesh(name: str, path: str, make: Maker | bytes | str, may: tuple[Verdict, ...] = REFUSED, more: str = "") -> Case:
    """The lower arm's shape is a mesh."""
    text = ARM.replace(BOX, f'<mesh filename="{path}"{more}/>')
    content = file(path, make) if isinstance(make, bytes | str) else make
    return Case(f"mesh: {name}", RUN, both(file("arm.urdf", text), content), may=may, seconds=60)


def zipped(path: str, member: str, head: bytes = b"") -> Maker:
    return lambda folder, prepared: zeros_in_zip(folder / path, {member: head}, 3 * 2**30)


def stl(triangles: int, body: bytes = b"") -> bytes:
    return b"\0" * 80 + struct.pack("<I", triangles) + body


LAUGHS = (
    '<?xml version="1.0"?><!DOCTYPE r [<!ENTITY a0 "ha">'
    + "".join(f'<!ENTITY a{k} "{f"&a{k - 1};" * 10}">' for k in range(1, 11))
    + "]>"
)
AXIS, SIZE, ORIGIN = 'axis xyz="0 1 0"', 'size="0.4 0.1 0.1"', 'origin xyz="0 0 0.6"'
ELBOW = '<joint name="elbow"'
MIMIC = '<mimic joint="shoulder" multiplier="{}" offset="{}"/></joint>'


def mimic(multiplier: str, offset: str = "0") -> dict[str, str]:
    head, tail = ARM.rsplit("</joint>", 1)
    last = head[head.rindex("<axis") :]
    return {ARM[len(head) - len(last) :]: last + MIMIC.format(multiplier, offset) + tail}


CASES = [
    *[
        arm(f"an axis of {value}", {AXIS: f'axis xyz="0 {value} 0"'}, says="arm.urdf.*shoulder")
        for value in ("nan", "inf")
    ],
    *[
        arm(f"an origin of {value}", {ORIGIN: f'origin xyz="0 0 {value}"'}, says="arm.urdf.*elbow")
        for value in ("nan", "inf")
    ],
    *[arm(f"a size of {value}", {SIZE: f'size="0.4 {value} 0.1"'}, says="arm.urdf.*lower") for value in ("nan", "inf")],
    *[arm(f"a multiplier of {value}", mimic(value), says="arm.urdf.*elbow") for value in ("nan", "inf")],
    arm("a radius of 0", {'radius="0.05"': 'radius="0"'}, says="arm.urdf.*upper"),
    arm(
        "a link twice",
        {'name="lower"': 'name="upper"', 'child link="lower"': 'child link="upper"'},
        says="arm.urdf.*upper",
    ),
    arm("a joint twice", {'name="elbow"': 'name="shoulder"'}, says="arm.urdf.*shoulder"),
    mesh("a .zip of 3 GiB", "part.zip", zipped("part.zip", "part.obj", CUBE.encode())),
    mesh("a .3mf of 3 GiB", "part.3mf", zipped("part.3mf", "3D/3dmodel.model", b"<model>")),
    *similar(
        arm("an axis of zero", {AXIS: 'axis xyz="0 0 0"'}),
        arm("an axis of two numbers", {AXIS: 'axis xyz="0 1"'}),
        arm("an axis of words", {AXIS: 'axis xyz="a b c"'}),
        arm("an axis of 1e-300", {AXIS: 'axis xyz="0 1e-300 0"'}, EITHER),
        arm("an axis of 1e300", {AXIS: 'axis xyz="0 1e300 1e300"'}, EITHER),
        arm("an origin of 1e300", {ORIGIN: 'origin xyz="0 0 1e300"'}),
        arm("angles of NaN", {ORIGIN: 'origin rpy="nan 0 0"'}),
        arm("angles of 1e300", {ORIGIN: 'origin rpy="1e300 0 0"'}, EITHER),
        arm("a negative radius", {'radius="0.05"': 'radius="-0.05"'}),
        arm("a length of 0", {'length="0.6"': 'length="0"'}, EITHER),
        arm("a size of 0", {SIZE: 'size="0 0 0"'}),
        arm("a negative size", {SIZE: 'size="0.4 -0.1 0.1"'}),
        arm("a size of 1e300", {SIZE: 'size="0.4 1e300 0.1"'}),
        arm("a size with commas", {SIZE: 'size="0,4 0,1 0,1"'}),
        arm("no radius", {'radius="0.05"': ""}),
        arm("a sphere of infinity", {BOX: '<sphere radius="inf"/>'}),
        arm("an unknown shape", {BOX: "<blob/>"}, EITHER),
        arm("a capsule of NaN", {BOX: '<capsule radius="nan" length="1"/>'}),
        arm("a limit of NaN", {'lower="-1"': 'lower="nan"'}),
        arm("a limit of infinity", {'upper="1"': 'upper="inf"'}, EITHER),
        arm("limits that are crossed", {'lower="-1"': 'lower="2"'}, EITHER),
        arm("no limits", {'<limit lower="-1" upper="1" effort="1" velocity="1"/>': ""}, EITHER),
        arm("an offset of NaN", mimic("1", "nan")),
        arm("a multiplier of 1e300", mimic("1e300")),
        arm("a multiplier of words", mimic("twice")),
        arm(
            "a mimic of itself",
            {ELBOW: '<joint name="elbow"', "</joint>\n</robot>": '<mimic joint="elbow"/></joint></robot>'},
        ),
        arm("a mimic of nothing", {"</joint>\n</robot>": '<mimic joint="nowhere"/></joint></robot>'}),
        arm("a link without a name", {'<link name="lower">': "<link>"}),
        arm(
            "a link named by nothing", {'<link name="lower">': '<link name="">', 'child link="lower"': 'child link=""'}
        ),
        arm("a joint without a name", {'name="elbow" ': ""}),
        arm(
            "a link named by markup",
            {'name="lower"': 'name="[/red]&lt;b&gt;"', 'child link="lower"': 'child link="[/red]&lt;b&gt;"'},
            EITHER,
        ),
        arm("a joint without a child", {'<child link="lower"/>': ""}),
        arm("a joint of a link that is not there", {'child link="lower"': 'child link="nowhere"'}),
        arm("a joint of one link", {'child link="lower"': 'child link="upper"'}),
        arm("a loop", {'parent link="base"': 'parent link="lower"'}),
        arm("two parents", {'parent link="upper"/><child link="lower"': 'parent link="base"/><child link="upper"'}),
        arm("two roots", {"</robot>": '<link name="other"/></robot>'}, EITHER),
        arm("a type that is unknown", {'name="elbow" type="revolute"': 'name="elbow" type="flying"'}, EITHER),
        arm("a type of spherical joints", {'name="elbow" type="revolute"': 'name="elbow" type="floating"'}, EITHER),
        arm(
            "no joint that moves",
            {'type="revolute"': 'type="fixed"', 'name="elbow" type="revolute"': 'name="elbow" type="fixed"'},
        ),
        arm(
            "an inertia of NaN",
            {"</visual></link>": '</visual><inertial><mass value="nan"/></inertial></link>'},
            EITHER,
        ),
        raw("nothing", b""),
        raw("bytes", bytes(range(256)) * 9),
        raw("another root element", b"<html></html>"),
        raw("a billion laughs", f"{LAUGHS}{ARM.partition('?>')[2].replace('name=', 'x=')}&a10;</r>".encode()),
        raw("entities in an attribute", (LAUGHS + ARM.partition("?>")[2].replace('"lower"', '"&a10;"')).encode()),
        raw(
            "an entity that is a file",
            (
                '<?xml version="1.0"?><!DOCTYPE r [<!ENTITY f SYSTEM "file:///etc/passwd">]>'
                + ARM.partition("?>")[2].replace('<link name="base">', '<link name="base">&f;')
            ).encode(),
            EITHER,
        ),
        raw("elements within elements", b"<robot>" + b"<a>" * 300_000),
        raw(
            "elements within elements, closed", b"<robot name='a'>" + b"<a>" * 100_000 + b"</a>" * 100_000 + b"</robot>"
        ),
        raw("UTF-16", ARM.replace('version="1.0"', 'version="1.0" encoding="utf-16"').encode("utf-16"), EITHER),
        raw("an encoding that is unknown", ARM.replace('version="1.0"', 'version="1.0" encoding="klingon"').encode()),
        raw("a byte order mark", b"\xef\xbb\xbf" + ARM.encode(), EITHER),
        raw(
            "a thousand links in a chain",
            (
                "<robot name='a'>"
                + "".join(
                    f'<link name="l{k}"><visual><geometry><box size="1 1 1"/></geometry></visual></link>'
                    for k in range(1001)
                )
                + "".join(
                    f'<joint name="j{k}" type="fixed"><parent link="l{k}"/><child link="l{k + 1}"/></joint>'
                    for k in range(1000)
                )
                + "</robot>"
            ).encode(),
        ),
        Case("a description of 3 GiB", RUN, sparse("arm.urdf", b"<robot>"), may=REFUSED, seconds=60),
        Case("a description that is a pipe", f"mkfifo arm.urdf; {RUN}", may=REFUSED, seconds=30, writes=("arm.urdf",)),
        mesh("missing", "part.obj", lambda folder, prepared: None),
        mesh("empty", "part.obj", ""),
        mesh("empty stl", "part.stl", b""),
        mesh("stl of 4 billion triangles", "part.stl", stl(4_000_000_000, bytes(500))),
        mesh("stl of NaN", "part.stl", stl(4, struct.pack("<12fH", *[float("nan")] * 12, 0) * 4)),
        mesh("stl of 3 GiB of zeros", "part.stl", sparse("part.stl", stl(64_424_000))),
        mesh("obj of 3 GiB of zeros", "part.obj", sparse("part.obj", CUBE.encode())),
        mesh("obj whose faces lead nowhere", "part.obj", CUBE + "f 1 2 99999999\n"),
        mesh("obj of NaN", "part.obj", CUBE.replace("1", "nan", 3)),
        mesh("obj whose material is a file elsewhere", "part.obj", "mtllib ../../../etc/passwd\n" + CUBE, EITHER),
        mesh("obj of bytes", "part.obj", bytes(range(256)) * 9),
        mesh("obj in capitals", "PART.OBJ", CUBE, EITHER),
        mesh("obj scaled by NaN", "part.obj", CUBE, more=' scale="nan 1 1"'),
        mesh("obj scaled by 0", "part.obj", CUBE, more=' scale="0 0 0"'),
        mesh("obj scaled by 1e300", "part.obj", CUBE, more=' scale="1e300 1 1"'),
        mesh("obj mirrored", "part.obj", CUBE, EITHER, more=' scale="-1 1 1"'),
        mesh("dae of nothing", "part.dae", "<COLLADA/>"),
        mesh("dae of laughs", "part.dae", f"{LAUGHS}<COLLADA>&a10;</COLLADA>"),
        mesh(
            "gltf of files elsewhere",
            "part.gltf",
            '{"asset":{"version":"2.0"},"buffers":[{"uri":"/etc/passwd","byteLength":9}]}',
        ),
        mesh(
            "glb that declares 4 GB",
            "part.glb",
            b"glTF" + struct.pack("<III", 2, 4_000_000_000, 4_000_000_000) + b"JSON",
        ),
        mesh("a zae of 3 GiB", "part.zae", zipped("part.zae", "part.dae", b"<COLLADA/>")),
        mesh("a tar", "part.tar.gz", b"\x1f\x8b\x08" + bytes(100)),
        mesh("an svg", "part.svg", "<svg/>"),
        mesh("a picture", "part.png", b"\x89PNG"),
        mesh("a pickle", "part.pkl", b"\x80\x04K\x01."),
        mesh(
            "a ply of 1e12 points",
            "part.ply",
            b"ply\nformat ascii 1.0\nelement vertex 999999999999\nproperty float x\n"
            b"property float y\nproperty float z\nend_header\n1 2 3\n",
        ),
        mesh("an off of 1e9 points", "part.off", "OFF\n1000000000 1 0\n0 0 0\n"),
        mesh("a pipe", "part.stl", a_pipe("part.stl")),
        mesh("a folder", "part.stl", a_folder("part.stl")),
        *[
            Case(
                f"mesh: at {path[:40]}",
                RUN,
                file("arm.urdf", ARM.replace(BOX, f'<mesh filename="{path}"/>')),
                may=REFUSED,
                seconds=60,
            )
            for path in (
                "http://127.0.0.1:9/part.obj",
                "/etc/passwd",
                "/dev/zero",
                "/dev/zero.obj",
                "package://../../etc/passwd",
                "file:///etc/passwd",
                "",
                ".",
                "a" * 5000 + ".obj",
                "x\n.obj",
                "model://x/part.stl",
                "%00.obj",
            )
        ],
    ),
]
