from __future__ import annotations

import numpy as np
import pytest
import trimesh

from schemas.errors import InputError
from stages.ingest.roboart.surface import areas, link_triangles, sample_triangles
from stages.ingest.roboart.urdf import read_urdf


def one_link(urdf, *shapes):
    path = urdf.write(urdf.link("a", *shapes))
    (triangles,) = link_triangles(read_urdf(path), np.zeros(1, dtype=np.int64), path, (), 64.0)
    return triangles


def extents(triangles):
    return np.ptp(triangles.reshape(-1, 3), axis=0)


def test_points_fall_on_triangles_in_proportion_to_area():
    triangles = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 0, 5], [3, 0, 5], [0, 3, 5]]], dtype=float)
    points, chosen = sample_triangles(triangles, 20_000, np.random.default_rng(0))
    np.testing.assert_allclose(areas(triangles), [0.5, 4.5])
    assert np.mean(chosen) == pytest.approx(0.9, abs=0.01)
    np.testing.assert_allclose(points[:, 2], 5.0 * chosen, atol=1e-12)
    np.testing.assert_allclose(points[chosen == 1].mean(axis=0), [1, 1, 5], atol=0.03)  # the centroid
    inner = (points[chosen == 1, :2].sum(axis=1) < 1.5).mean()  # a quarter of the triangle's area
    assert inner == pytest.approx(0.25, abs=0.015)


def test_mesh_scale_and_origin_are_applied_scale_first(urdf):
    trimesh.creation.box([1, 2, 3]).export(urdf.folder / "box.stl")
    triangles = one_link(
        urdf, urdf.shape('<mesh filename="box.stl" scale="2 1 0.5"/>', "5 0 0", "0 0 1.5707963267948966")
    )
    np.testing.assert_allclose(extents(triangles), [2, 2, 1.5], atol=1e-6)
    np.testing.assert_allclose(triangles.reshape(-1, 3).mean(axis=0), [5, 0, 0], atol=1e-6)


def test_the_unit_of_a_dae_file_is_honoured_and_its_up_axis_is_not(urdf):
    text = trimesh.exchange.dae.export_collada(trimesh.creation.box([1, 2, 3])).decode()
    assert "Y_UP" in text
    text = text.replace("<up_axis>", '<unit name="millimeter" meter="0.001"/><up_axis>')
    (urdf.folder / "box.dae").write_text(text)
    triangles = one_link(urdf, urdf.shape('<mesh filename="box.dae"/>'))
    np.testing.assert_allclose(extents(triangles), [0.001, 0.002, 0.003])


def test_a_two_sided_mesh_counts_once(urdf):
    box = trimesh.creation.box([1, 2, 3])
    inside_out = box.copy()
    inside_out.invert()
    trimesh.util.concatenate([box, inside_out]).export(urdf.folder / "twice.stl")
    assert areas(one_link(urdf, urdf.shape('<mesh filename="twice.stl"/>'))).sum() == pytest.approx(22)


def test_collision_shapes_stand_in_only_where_a_rigid_group_has_no_visual(urdf):
    proxy = urdf.box("2 2 2", role="collision")
    path = urdf.write(
        urdf.link("seen", urdf.box("1 1 1"), proxy),
        urdf.link("motor", proxy),
        urdf.link("unseen", proxy),
        urdf.joint("weld", "fixed", "seen", "motor"),
        urdf.joint("hinge", "revolute", "motor", "unseen", urdf.moves("1 0 0", -1, 1)),
    )
    pieces = link_triangles(read_urdf(path), np.array([0, 0, 2]), path, (), 64.0)
    assert [areas(piece).sum() for piece in pieces] == pytest.approx([6, 0, 24])


def test_a_mesh_that_cannot_be_read_is_refused_by_name(urdf):
    (urdf.folder / "broken.obj").write_text("hello")
    with pytest.raises(InputError, match=r"broken\.obj") as caught:
        one_link(urdf, urdf.shape('<mesh filename="broken.obj"/>'))
    assert "\n" not in str(caught.value)
