"""A mesh file may hold triangles and nothing else: no archive, no further file, no more than it is large."""

import io
import re
import zipfile
from pathlib import Path

import numpy as np
import pytest
import trimesh

from schemas.errors import InputError
from stages.ingest.roboart.mesh_reading import read_mesh

BOX = trimesh.creation.box([1, 2, 3])
DAE = trimesh.exchange.dae.export_collada(BOX).decode()
GEOMETRY = re.search(r"<instance_geometry.*?</instance_geometry>", DAE, re.DOTALL).group()
PLY = """ply
format ascii 1.0
comment TextureFile /dev/zero
element vertex 3
property float x
property float y
property float z
element face 1
property list uchar int vertex_indices
end_header
0 0 0
1 0 0
0 1 0
3 0 1 2
"""
OBJ = "mtllib /dev/zero\nusemtl a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


def dae_of_nodes(depth):
    """Nodes, each of which repeats the one before ten times."""
    nodes = "".join(
        f'<node id="n{k}">{f"""<instance_node url="#n{k - 1}"/>""" * 10 if k else GEOMETRY}</node>'
        for k in range(depth)
    )
    text = DAE.replace("<library_visual_scenes>", f"<library_nodes>{nodes}</library_nodes><library_visual_scenes>")
    return text.replace(
        f"{GEOMETRY}</node></visual_scene>", f'<instance_node url="#n{depth - 1}"/></node></visual_scene>'
    )


def dae_with_texture():
    image = '<library_images><image id="i"><init_from>/dev/zero</init_from></image></library_images>'
    sampler = (
        '<newparam sid="s"><surface type="2D"><init_from>i</init_from></surface></newparam>'
        '<newparam sid="t"><sampler2D><source>s</source></sampler2D></newparam>'
    )
    text = DAE.replace("<library_effects>", f"{image}<library_effects>").replace("<technique ", f"{sampler}<technique ")
    return re.sub(
        "<diffuse>.*?</diffuse>", '<diffuse><texture texture="t" texcoord="u"/></diffuse>', text, flags=re.DOTALL
    )


def archive():
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("box.dae", " " * 2**20)
    return buffer.getvalue()


def read(folder, name, content, max_mib=64.0):
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return read_mesh(path, f"meshes/{name}", Path("robot.urdf"), max_mib)


def refusal(folder, name, content, max_mib=64.0):
    with pytest.raises(InputError) as caught:
        read(folder, name, content, max_mib)
    message = str(caught.value)
    assert message.startswith(f"robot.urdf: mesh 'meshes/{name}'")
    assert "\n" not in message
    return message


@pytest.mark.parametrize("name", ["box.3mf", "box.zip", "box.glb", "box.gltf", "box.zae", "box.stl.gz", "box"])
def test_other_formats_are_refused_by_name(tmp_path, name):
    assert "expected one of .stl, .obj, .dae, .ply; convert it" in refusal(tmp_path, name, archive())


@pytest.mark.parametrize("name", ["box.stl", "box.STL", "box.obj", "box.ply", "box.dae"])
def test_the_formats_that_are_meant_are_read(tmp_path, name):
    content = BOX.export(file_type=Path(name).suffix[1:].lower()) if "dae" not in name else DAE
    assert read(tmp_path, name, content).shape == (12, 3, 3)


def test_a_larger_file_than_the_setting_allows_is_refused_unread(tmp_path):
    content = BOX.export(file_type="stl")
    assert len(read(tmp_path, "box.stl", content, len(content) / 2**20)) == 12
    assert "raise ingest.roboart.max_mesh_mib" in refusal(tmp_path, "box.stl", content, (len(content) - 1) / 2**20)


@pytest.mark.parametrize(("name", "content"), [("a.ply", PLY), ("a.obj", OBJ), ("a.dae", dae_with_texture())])
def test_no_other_file_is_opened_for_textures_and_materials(tmp_path, name, content, monkeypatch):
    def refuse(*args, **kwargs):
        raise AssertionError("a further file is looked for")

    monkeypatch.setattr(trimesh.resolvers.FilePathResolver, "get", refuse)
    assert len(read(tmp_path, name, content)) in (1, 12)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.dae", f'<!DOCTYPE x [<!ENTITY a "{"b" * 99}">]>{DAE.partition("?>")[2]}', "document type declaration"),
        ("a.dae", dae_of_nodes(12), "found nodes that repeat each other"),
        ("a.dae", archive(), "cannot be read as a mesh"),
        ("a.dae", DAE.replace("<up_axis>", '<unit name="x" meter="nan"/><up_axis>'), "found NaN"),
        ("a.dae", DAE.replace("<node ", f"{'<node>' * 9000}<node ", 1), "cannot be read as a mesh"),
        ("a.ply", PLY.replace("vertex 3", "vertex 99999999999"), "found 99999999999 elements declared in a file of"),
        ("a.ply", PLY.replace("3 0 1 2", "3 0 1 -7"), "cannot be read as a mesh"),
        ("a.ply", PLY.replace("1 0 0", "inf 0 0"), "found NaN, infinity"),
        ("a.obj", OBJ.replace("f 1 2 3", "f 1 2 99"), "cannot be read as a mesh"),
        ("a.obj", OBJ.replace("f 1 2 3", "f 1 2"), "found no triangles"),
        ("a.obj", OBJ.replace("v 1 0 0", "v nan 0 0") + "v 0 0 1\nf 1 3 4\n", "found NaN, infinity"),
        ("a.obj", OBJ.replace("v 1 0 0", "v 1e300 0 0"), "found NaN, infinity or numbers beyond 1e+09"),
        ("a.obj", "v 0 0 0\n", "found no triangles"),
        ("a.stl", "", "found no triangles"),
        ("a.stl", BOX.export(file_type="stl")[:-7], "found no triangles"),
    ],
)
def test_what_asks_for_more_than_it_is_or_holds_no_surface_is_refused(tmp_path, name, content, message):
    assert message in refusal(tmp_path, name, content)


@pytest.mark.parametrize("counts", ["2000000000", "2000000000 -1999999964"])
def test_polygons_of_more_corners_than_indices_are_refused(tmp_path, counts):
    text = re.sub("<triangles([^>]*)>", rf"<polylist\1><vcount>{counts}</vcount>", DAE)
    assert "corners, expected as many" in refusal(tmp_path, "a.dae", text.replace("</triangles>", "</polylist>"))


def test_a_part_that_is_repeated_a_few_times_is_read_each_time(tmp_path):
    assert dae_of_nodes(2) != DAE
    assert len(np.unique(read(tmp_path, "a.dae", dae_of_nodes(2)).reshape(-1, 3), axis=0)) == 8
