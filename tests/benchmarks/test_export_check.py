import numpy as np
import pytest

from schemas.config import ExportConfig
from schemas.joints import PRISMATIC, REVOLUTE
from schemas.kinematic import KinematicModel
from schemas.sequence import PointSequence
from stages.export.stage import WRITERS, compute_export
from stages.kernels.kinematics.tree import KinematicTree
from stages.result.stage import compute_result


@pytest.fixture
def benchmark(load_benchmark):
    return load_benchmark("export_check")


def boxes(points):
    """Points on three boxes in a row, and the box of each."""
    rng = np.random.default_rng(0)
    box = rng.uniform(-0.5, 0.5, (points, 3))
    side = rng.integers(0, 3, points)
    box[np.arange(points), side] = np.sign(box[np.arange(points), side]) / 2
    return np.concatenate([box * [0.3, 0.2, 0.2] + [0.35 * k, 0, 0] for k in range(3)]), np.repeat([0, 1, 2], points)


@pytest.fixture(scope="module")
def model_and_files():
    """A hinge between the first two boxes and a slider to the third, and what is exported of it."""
    p, labels = boxes(900)
    states = np.tile([[0.3], [0.0], [-0.2]], (1, 2))
    axis, point = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]]), np.array([[0.175, 0.0, 0.0], [0.0, 0.0, 0.0]])
    tree = KinematicTree(
        kinds=(REVOLUTE, PRISMATIC),
        parent=np.array([0, 1]),
        child=np.array([1, 2]),
        axis=axis,
        point=point,
        root=0,
    )
    kinematic = KinematicModel(
        canonical_frame=1,
        root=0,
        labels=labels,
        Ts_frame_canonical=tree.Ts_pose_canonical(states),
        joint_parent=tree.parent,
        joint_child=tree.child,
        joint_types=("revolute", "prismatic"),
        axis=axis,
        point=point,
        states=states,
        e_spatial=np.zeros(2),
        e_1dof=np.zeros(2),
        energies={},
    )
    sequence = PointSequence(
        points=np.tile(p, (3, 1)),
        point_counts=np.array([len(p)] * 3),
        dropped_counts=np.zeros(3, dtype=np.int64),
        scale=1.0,
        centre=(0.0, 0.0, 0.0),
        units="metre",
        frame_names=("0", "1", "2"),
    )
    result = compute_result(kinematic, sequence)
    robot = compute_export(result, None, ExportConfig(triangles=800), "boxes")
    return result, {file: content for write in WRITERS.values() for file, content in write(robot).items()}


@pytest.fixture
def exported(benchmark, model_and_files, tmp_path, monkeypatch):
    """The exported robot in the current folder, and points on its true surface."""
    monkeypatch.chdir(tmp_path)
    result, files = model_and_files
    (tmp_path / "meshes").mkdir()
    for file, content in files.items():
        (tmp_path / file).write_bytes(content)
    return benchmark.Exported("boxes", result, tmp_path), boxes(20_000)[0]


def test_a_sound_export_has_no_faults(benchmark, exported):
    found = benchmark.check(*exported)
    assert not found.faults
    assert 0 < found.surface_percent < 1
    assert (found.links, found.joints, found.free_base) == (3, 2, False)


@pytest.mark.parametrize(
    ("file", "old", "new", "fault"),
    [
        ("robot.urdf", 'xyz="0.0 0.0 1.0"', 'xyz="0.0 0.0 -1.0"', "robot.urdf in mujoco: parts are off"),
        ("robot.xml", 'axis="0.0 1.0 0.0"', 'axis="0.0 0.9 0.1"', "robot.xml in mujoco: parts are off"),
        ("robot.urdf", '<parent link="part_1"', '<parent link="part_0"', "joint joint_0_1 moves others"),
        ("robot.urdf", 'contact="disable"', 'contact="enable"', "robot.urdf: links are pushed apart at once"),
    ],
)
def test_an_export_that_is_spoilt_is_found_out(benchmark, exported, file, old, new, fault):
    path = exported[0].folder / file
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    if "contact" in old:  # boxes side by side do not push each other
        for mesh in (path.parent / "meshes").glob("*_collision.stl"):
            mesh.write_bytes((path.parent / "meshes" / "part_0_collision.stl").read_bytes())
    assert fault in benchmark.check(*exported).faults


def test_a_mesh_with_a_hole_is_told(benchmark, exported):
    path = exported[0].folder / "meshes" / "part_1.stl"
    content = path.read_bytes()
    count = int.from_bytes(content[80:84], "little") - 1
    path.write_bytes(content[:80] + count.to_bytes(4, "little") + content[84:-50])
    found = benchmark.check(*exported)
    assert found.open_meshes == ("part_1.stl",)
    assert "part_1.stl is open, which robot.urdf does not say" in found.faults


def test_a_folder_without_exports_is_refused(benchmark, tmp_path, capsys):
    assert benchmark.main([str(tmp_path)]) == 2
    assert "found no export" in capsys.readouterr().err
