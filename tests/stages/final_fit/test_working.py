import numpy as np
import pytest

from schemas.config import FinalFitConfig, ProjectionConfig
from schemas.joints import PRISMATIC, REVOLUTE, SPHERICAL
from stages.final_fit.working import Fit, chain_of, relative_motions, to_chain, to_model, working_frames
from stages.kernels.kinematics.chain import Chain, Joint
from stages.kernels.kinematics.closed_form import fit_joint
from stages.kernels.kinematics.tree import joint_transforms
from stages.projection.stage import link_parts


def model_of(truth, scale=1.0, Ts=None):
    Ts = (truth.Ts_frame_canonical if Ts is None else Ts).copy()
    Ts[..., :3, 3] *= scale
    return link_parts(scale * truth.sequence.frames()[2], truth.canonical_labels, Ts, 2, ProjectionConfig())


def frames_of(truth, scale=1.0, points=400):
    return working_frames(
        truth.sequence.replace(points=scale * truth.sequence.points), 2, FinalFitConfig(points=points)
    )


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_joint_types_do_not_depend_on_the_unit(two_part_object, scale):
    truth = two_part_object
    chain = to_chain(model_of(truth, scale), frames_of(truth, scale), 0.5)
    assert chain.tree.kinds == (truth.kind,)
    states = truth.kind.units(scale) * truth.states
    sign = np.sign(chain.tree.axis[0] @ truth.axis)
    np.testing.assert_allclose(sign * chain.states, states, atol=1e-6 * max(scale, 1))
    assert chain.states[2, 0] == 0
    assert not chain.tree.free_root


def test_a_root_is_free_where_it_moves_more_than_spacings(hinge):
    frames = frames_of(hinge)
    Ts = hinge.Ts_frame_canonical.copy()
    Ts[[0, 1, 3, 4], :, 1, 3] += 0.9 * frames.spacing
    model = model_of(hinge, Ts=Ts)
    assert model.root == 0
    held, free = to_chain(model, frames, 1.0), to_chain(model, frames, 0.5)
    assert (held.tree.free_root, free.tree.free_root) == (False, True)
    np.testing.assert_array_equal(held.T_frame_root, np.tile(np.eye(4), (5, 1, 1)))
    np.testing.assert_array_equal(free.T_frame_root, Ts[:, 0])


def test_every_joint_has_its_own_best_type():
    """Relative motions of several pairs at once, of both types."""
    rng = np.random.default_rng(0)
    states = np.array([-0.5, -0.2, 0.0, 0.3, 0.4])
    axis = rng.normal(size=(3, 3))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    angle, distance = np.outer([1, 0, -1], states), np.outer([0, 0.5, 0], states)
    motions = np.concatenate([angle[..., None] * axis[:, None], distance[..., None] * axis[:, None]], axis=-1)
    joints = joint_transforms(rng.normal(scale=0.2, size=(3, 1, 3)), motions)
    root = joint_transforms(np.zeros(3), rng.normal(size=(5, 6)))
    Ts = np.stack([root, root @ joints[0], root @ joints[1], root @ joints[1] @ joints[2]], axis=1)
    parent, child = np.array([0, 0, 2]), np.array([1, 2, 3])
    np.testing.assert_allclose(relative_motions(Ts, parent, child), joints, atol=1e-12)
    fits = fit_joint([REVOLUTE, PRISMATIC], relative_motions(Ts, parent, child), rng.normal(scale=0.3, size=(3, 30, 3)))
    assert [fits.kind_of((joint,)) for joint in range(3)] == [REVOLUTE, PRISMATIC, REVOLUTE]
    assert fits.rms.max() < 1e-5
    signs = np.sign((fits.axis * axis).sum(axis=1))
    np.testing.assert_allclose(fits.axis, signs[:, None] * axis, atol=1e-6)
    found = np.stack([fits.states_of((joint,))[:, 0] for joint in range(3)])
    np.testing.assert_allclose(found, signs[:, None] * (angle + distance), atol=1e-6)


def test_working_frames_take_the_same_points_as_their_index_says(hinge):
    frames = frames_of(hinge, points=150)
    assert [len(p) for p in frames.registration.frames] == [150] * 5
    np.testing.assert_array_equal(frames.p, hinge.sequence.frames()[2][frames.index])


def test_a_chain_becomes_the_model_it_came_from(two_part_object):
    truth = two_part_object
    model, frames = model_of(truth), frames_of(truth, points=150)
    chain = to_chain(model, frames, 0.5)
    back = to_model(model, Fit(chain, model.labels[frames.index]), frames)
    np.testing.assert_array_equal(back.labels, model.labels)
    np.testing.assert_allclose(back.Ts_frame_canonical, model.Ts_frame_canonical, atol=1e-6)
    np.testing.assert_array_equal(back.Ts_frame_canonical, chain.Ts)
    np.testing.assert_array_equal(back.states, chain.states)
    assert back.joint_types == (truth.kind.name,)
    np.testing.assert_allclose((back.axis * back.point).sum(axis=1), 0, atol=1e-12)


def test_a_ball_joints_centre_stays_where_it_is_in_the_model(hinge):
    model, frames = model_of(hinge), frames_of(hinge, points=150)
    turns, centre = np.zeros((5, 3)), np.array([0.1, 0.2, 0.3])
    turns[[0, 1, 3, 4]] = np.random.default_rng(0).normal(scale=0.3, size=(4, 3))
    ball = Joint(SPHERICAL, 0, 1, np.array([0.0, 1.0, 0.0]), centre, turns)
    chain = Chain.of([ball], 0, np.tile(np.eye(4), (5, 1, 1)), free_root=False)
    back = to_model(model, Fit(chain, model.labels[frames.index]), frames)
    assert back.joint_types == ("spherical",)
    np.testing.assert_array_equal(back.point, [centre])
    np.testing.assert_allclose(chain_of(back, free_root=False).Ts, back.Ts_frame_canonical, atol=1e-12)


def test_refining_lowers_the_misfit_and_keeps_labels(two_parts):
    states = two_parts.chain.states + np.array([0.03, -0.03, 0, 0.03, -0.03])[:, None]
    start = Fit(Chain(two_parts.chain.tree, states), two_parts.labels)
    refined = two_parts.frames.refine(start, 8)
    cost = [two_parts.frames.point_costs(f.labels, f.chain.Ts).sum() for f in (start, refined, two_parts.fit)]
    assert cost[1] < 1.05 * cost[2] < cost[0]
    np.testing.assert_allclose(refined.chain.states, two_parts.chain.states, atol=0.01)
    np.testing.assert_array_equal(refined.labels, start.labels)


def test_parts_that_no_working_point_shows_are_parts_all_the_same(hinge):
    """One point of the lid, which the working points leave out, is a part."""
    frames = frames_of(hinge, points=100)
    labels = hinge.canonical_labels.copy()
    labels[np.setdiff1d(np.flatnonzero(labels == 1), frames.index)[0]] = 2
    Ts = hinge.Ts_frame_canonical[:, [0, 1, 1]]
    chain = to_chain(link_parts(hinge.sequence.frames()[2], labels, Ts, 2, ProjectionConfig()), frames, 0.5)
    assert chain.parts == 3
    np.testing.assert_allclose(chain.Ts[:, 1], Ts[:, 1], atol=1e-4)
