import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from schemas.sequence import GroundTruth, TrueJoint
from stages.evaluation.travel import joint_travels

ANGLES, SLIDES = [0.0, 0.4, -0.3], [0.0, -0.1, 0.2]


def motion(turn, slide):
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec([0, 0, turn]).as_matrix()
    T[0, 3] = slide
    return T


def test_the_longest_way_between_two_frames_is_by_the_joint_alone_and_in_spacings():
    """A plate that turns about z carries another that slides along x: a grid of 0.1, a radius of 0.5."""
    x, y = np.meshgrid(np.arange(-0.4, 0.41, 0.1), np.arange(-0.3, 0.31, 0.1))
    plate = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    Ts = np.stack([[np.eye(4), motion(a, 0), motion(a, 0) @ motion(0, s)] for a, s in zip(ANGLES, SLIDES, strict=True)])
    own = [np.concatenate([plate + [0, 0, height] for height in (0, 1, 2)]) for _ in Ts]
    labels = np.repeat([0, 1, 2], len(plate))
    frames = [np.einsum("nij,nj->ni", T[labels, :3, :3], p) + T[labels, :3, 3] for T, p in zip(Ts, own, strict=True)]
    joints = tuple(
        TrueJoint(name=name, parent=p, child=p + 1, type=kind, axis=axis, point=(0, 0, 0), states=states)
        for p, (name, kind, axis, states) in enumerate(
            [("turn", "revolute", (0, 0, 1), ANGLES), ("slide", "prismatic", (1, 0, 0), SLIDES)]
        )
    )
    truth = GroundTruth(
        labels=np.tile(labels, 3),
        Ts_frame_first=Ts,
        Ts_novel_first=np.empty((0, 3, 4, 4)),
        parent=np.array([-1, 0, 1]),
        part_names=("a", "b", "c"),
        joints=joints,
    )
    chord = 2 * 0.5 * np.sin(0.7 / 2)
    assert joint_travels(truth, frames, [labels] * 3) == pytest.approx([chord / 0.1, 0.3 / 0.1])
    unseen = [np.where(labels == 2, 1, labels)] * 3
    assert joint_travels(truth, frames, unseen)[1] == 0
