"""The page poses a model as KinematicTree does, whatever the kinds of its joints."""

import fnmatch
import json
import tomllib
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from schemas.joints import JOINT_KINDS, JointKind
from schemas.model_file import ModelFile, ModelJoint, ModelPart, Result
from schemas.report import Report
from stages.kernels.kinematics.tree import KinematicTree
from stages.report.scene import scene_data
from stages.report.stage import VIEWER, report_page

FRAMES, PARTS, ROOT = 5, 6, 1
FAR = np.array([1000.0, -500.0, 200.0])
JOINTS = (  # kind, parent, child; a joint may come before that of its parent
    ("cylindrical", 4, 0),
    ("spherical", 2, 3),
    ("revolute", 1, 2),
    ("prismatic", 2, 4),
    ("floating", 3, 5),
)


@pytest.fixture(scope="module")
def kinds():
    """Kinds that no other file knows: a turn with a slide about one axis, and all turns with all slides."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(JOINT_KINDS, "cylindrical", JointKind("cylindrical", "C", "axis", "axis"))
        patch.setitem(JOINT_KINDS, "floating", JointKind("floating", "F", "all", "all"))
        yield JOINT_KINDS


@pytest.fixture(scope="module")
def tree(kinds):
    """A branching tree on a root that moves in the world, with every kind of joint."""
    rng = np.random.default_rng(0)
    names, parent, child = zip(*JOINTS, strict=True)
    axis = rng.normal(size=(len(JOINTS), 3))
    return KinematicTree(
        kinds=tuple(kinds[name] for name in names),
        parent=np.array(parent),
        child=np.array(child),
        axis=axis / np.linalg.norm(axis, axis=1, keepdims=True),
        point=FAR + rng.normal(scale=50, size=(len(JOINTS), 3)),
        root=ROOT,
        free_root=True,
    )


@pytest.fixture(scope="module")
def coordinates(tree):
    """Angles around a radian, and lengths around twenty units."""
    return np.random.default_rng(1).normal(size=(FRAMES, tree.size)) * tree.units(20.0)


@pytest.fixture(scope="module")
def result(tree, coordinates):
    """The model that is so posed."""
    rng = np.random.default_rng(2)
    joints = []
    for j, kind in enumerate(tree.kinds):
        states = coordinates[:, tree.coordinates_of(j)]
        sizes = np.linalg.norm(states, axis=1, keepdims=True) if kind.is_ball else states
        joints.append(
            ModelJoint(
                id=j,
                name=f"joint_{j}",
                parent=int(tree.parent[j]),
                child=int(tree.child[j]),
                type=kind.name,
                axis=tuple(tree.axis[j]),
                point=tuple(tree.point[j]),
                lower=numbers(sizes.min(axis=0)),
                upper=numbers(sizes.max(axis=0)),
                states=tuple(map(numbers, states)),
            )
        )
    model = ModelFile(
        units="millimetre",
        frames=FRAMES,
        canonical_frame=2,
        root=ROOT,
        parts=tuple(ModelPart(id=i, name=f"part_{i}", point_count=20) for i in range(PARTS)),
        joints=tuple(joints),
    )
    return Result(
        model=model,
        canonical_points=FAR + rng.normal(scale=50, size=(20 * PARTS, 3)),
        labels=np.repeat(np.arange(PARTS), 20),
        T_frame_canonical=tree.Ts_pose_canonical(coordinates),
    )


def numbers(values):
    return values.tolist()[0] if len(values) == 1 else tuple(values.tolist())


def script(name):
    return files("stages.report").joinpath("viewer", name).read_text()


def in_view(Ts, scene):
    """Transforms of the input's coordinates as those of the view, which the page works in."""
    centre, half = np.array(scene["centre"]), scene["half"]
    Ts = Ts.copy()
    Ts[..., :3, 3] = (Ts[..., :3, :3] @ centre + Ts[..., :3, 3] - centre) / half
    return Ts


def test_the_scripts_forward_kinematics_are_those_of_the_tree(run_script, tree, coordinates, result):
    scene = scene_data(result, [FAR + np.ones((3, 3))] * FRAMES)
    found = run_script(f"""
        "use strict";
        {script("math.js")}
        {script("kinematics.js")}
        const data = {json.dumps(scene)}, tree = treeInView(data);
        return data.T_frame_root.map((_, t) =>
          partTransforms(tree, tree.joints.map((joint) => joint.states[t]), tree.Ts_root[t]));
    """)
    found = np.reshape(found, (FRAMES, PARTS, 4, 4)).swapaxes(-1, -2)
    np.testing.assert_allclose(found, in_view(tree.Ts_pose_canonical(coordinates), scene), atol=1e-9)


def test_joints_at_zero_leave_the_parts_where_they_are(run_script, result):
    scene = scene_data(result, [FAR + np.ones((3, 3))] * FRAMES)
    found = run_script(f"""
        "use strict";
        {script("math.js")}
        {script("kinematics.js")}
        const tree = treeInView({json.dumps(scene)});
        return partTransforms(tree, tree.joints.map((joint) => joint.basis.map(() => 0)), identity());
    """)
    np.testing.assert_allclose(np.reshape(found, (PARTS, 4, 4)), np.tile(np.eye(4), (PARTS, 1, 1)), atol=1e-12)


def test_on_the_page_a_joint_of_any_kind_has_a_slider_for_each_number_of_its_state(
    browser, tmp_path, tree, coordinates, result
):
    report = Report(residuals=np.zeros((FRAMES, PARTS)), sampling=0.0)
    page = tmp_path / "report.html"
    page.write_text(report_page("any kind", result, [result.canonical_points] * FRAMES, report))
    browser.open(page)
    browser.evaluate("reart.setFrame(4)")
    coordinates = coordinates[4].copy()
    for j, kind in enumerate(tree.kinds):
        sliders = f"document.querySelectorAll('input[data-joint=\"{j}\"]')"
        assert browser.evaluate(f"{sliders}.length") == kind.size
        labels = browser.evaluate(f"[...{sliders}].map((slider) => slider.ariaLabel)")
        assert len(set(labels)) == kind.size
        for k in range(kind.size):
            value = browser.evaluate(
                f"(({{ [{k}]: slider }}) => {{ slider.value = 0.7 * slider.max + 0.3 * slider.min;"
                f"slider.dispatchEvent(new Event('input')); return Number(slider.value); }})({sliders})"
            )
            coordinates[tree.coordinates_of(j).start + k] = value
    middles = result.canonical_points.reshape(PARTS, 20, 3).mean(axis=1)
    [Ts] = tree.Ts_pose_canonical(coordinates[None])
    expected = np.einsum("pij,pj->pi", Ts[:, :3, :3], middles) + Ts[:, :3, 3]
    np.testing.assert_allclose(browser.evaluate("reart.centroids"), expected, atol=0.05)  # of 500; 16 bits a coordinate
    assert [text for text in browser.complaints if "GPU stall" not in text] == []


def test_no_kind_of_joint_is_named_in_the_script():
    text = "".join(map(script, VIEWER))
    assert [name for name in ("revolute", "prismatic", "spherical", "screw") if name in text] == []


def test_every_file_of_the_script_has_its_place_and_is_installed():
    there = {path.name for path in files("stages.report").joinpath("viewer").iterdir()}
    assert sorted(VIEWER) == sorted(there)
    project = tomllib.loads((Path(__file__).parents[3] / "pyproject.toml").read_text())
    patterns = project["tool"]["setuptools"]["package-data"]["stages.report"]
    assert all(any(fnmatch.fnmatch(f"viewer/{name}", pattern) for pattern in patterns) for name in VIEWER)
