import numpy as np

from schemas.joints import REVOLUTE, SPHERICAL
from stages.final_fit.rooting import rooted_in_the_middle
from stages.final_fit.working import Fit
from stages.kernels.kinematics.chain import Chain, Joint
from stages.kernels.kinematics.tree import joint_transforms

FRAMES = 4
LABELS = np.repeat(np.arange(4), [5, 10, 40, 10])


def chain(free_root):
    """Foot 0, shin 1, trunk 2 and head 3, in a row; the foot is the root."""
    rng = np.random.default_rng(0)
    axis = rng.normal(size=(3, 3))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    kinds = (REVOLUTE, SPHERICAL, REVOLUTE)
    joints = [
        Joint(kind, j, j + 1, axis[j], rng.normal(size=3), rng.normal(size=(FRAMES, kind.size)))
        for j, kind in enumerate(kinds)
    ]
    return Chain.of(joints, 0, joint_transforms(np.zeros(3), rng.normal(size=(FRAMES, 6))), free_root)


def test_all_parts_move_as_before_and_the_trunk_is_the_root():
    before = chain(free_root=True)
    after = rooted_in_the_middle(Fit(before, LABELS)).chain
    assert after.tree.root == 2
    assert after.tree.parents.tolist() == [1, 2, -1, 2]
    np.testing.assert_allclose(after.Ts, before.Ts, atol=1e-12)


def test_a_root_that_stands_still_stays_the_root():
    fit = Fit(chain(free_root=False), LABELS)
    assert rooted_in_the_middle(fit) is fit
