from dataclasses import replace

import numpy as np
import pytest

from schemas.config import FinalFitConfig
from schemas.joints import PRISMATIC
from stages.final_fit.pruning import join, prune
from stages.final_fit.working import Fit
from stages.kernels.alignment.registration import Registration

PRICE, ITERATIONS = FinalFitConfig().part_price, FinalFitConfig().prune_iterations


def check_tree(fit):
    """Numbers are 0..parts-1, every part is a child once or the root, and all joints hang on it."""
    chain = fit.chain
    assert fit.labels.max() < chain.parts
    assert sorted([chain.tree.root, *chain.tree.child]) == list(range(chain.parts))
    known = {chain.tree.root}
    for joint in chain.tree.order:
        assert chain.tree.parent[joint] in known
        known.add(chain.tree.child[joint])
    assert len(known) == chain.parts
    np.testing.assert_array_equal(chain.joint_states[2], 0)


def cut(case, part, chosen, before=False):
    """The same thing with `chosen` points of a part cut off as the last part, linked to it by a joint that rests; or,
    where `before`, put between the part and its parent."""
    chain, new = case.chain, case.chain.parts
    joints = chain.joints()
    own = next((j for j in joints if j.child == part), joints[0])
    rest = replace(own, parent=new if before else part, child=part if before else new, states=0 * own.states)
    if before:
        place = joints.index(own)
        joints[place : place + 1] = [replace(own, child=new), rest]
    else:
        joints.append(rest)
    return Fit(chain.with_joints(joints), np.where(chosen, new, case.labels))


def end_of(case, part, share=0.03):
    """The points of a part with the greatest y, up to a share of all points."""
    members = np.flatnonzero(case.labels == part)
    return np.isin(
        np.arange(len(case.labels)), members[np.argsort(-case.frames.p[members, 1])[: int(share * len(case.labels))]]
    )


@pytest.mark.parametrize(
    ("part", "before", "share"), [(0, False, 0.03), (0, False, 0.2), (2, False, 0.03), (2, True, 0.03)]
)
def test_a_part_cut_in_two_is_joined_again(housed, part, before, share):
    fit = cut(housed, part, end_of(housed, part, share), before)
    check_tree(fit)
    pruned = prune(fit, housed.frames, PRICE, ITERATIONS)
    check_tree(pruned)
    np.testing.assert_array_equal(pruned.labels, housed.labels)
    np.testing.assert_array_equal(pruned.chain.tree.parents, housed.chain.tree.parents)
    np.testing.assert_allclose(pruned.chain.Ts, housed.chain.Ts, atol=0.03)


def test_several_pieces_are_joined_one_after_another(housed):
    first = replace(housed, fit=cut(housed, 2, end_of(housed, 2, 0.02)))
    pruned = prune(cut(first, 0, end_of(first, 0)), housed.frames, PRICE, ITERATIONS)
    check_tree(pruned)
    np.testing.assert_array_equal(pruned.labels, housed.labels)


def test_a_true_part_stays_however_small(hinge_case):
    """Of the turning lid eight points are left in the canonical frame."""
    p, clouds = hinge_case.frames.p, list(hinge_case.frames.registration.frames)
    kept = (hinge_case.labels == 0) | np.isin(np.arange(400), np.argsort(-p[:, 0])[:8])
    clouds[2] = p[kept]
    frames = replace(hinge_case.frames, registration=Registration(clouds, 2), p_all=clouds[2], index=np.arange(208))
    fit = Fit(hinge_case.chain, hinge_case.labels[kept])
    assert prune(fit, frames, PRICE, ITERATIONS) is fit
    assert prune(fit, frames, 1e9, ITERATIONS).chain.parts == 1  # but for its price it would have gone


def apart(case, onto):
    """The hinge with half of its body's points as a part of their own, which keeps still though it hangs on the lid, or
    moves as the lid does though it hangs on the body."""
    new, own = case.chain.parts, case.chain.joint(0)
    half = np.isin(np.arange(len(case.labels)), np.flatnonzero(case.labels == 1 - onto)[::2])
    joint = replace(own, parent=onto, child=new, states=own.states if onto == 0 else -own.states)
    return Fit(case.chain.with_joints([own, joint]), np.where(half, new, case.labels))


@pytest.mark.parametrize("onto", [0, 1])
def test_pieces_of_one_rigid_part_that_do_not_hang_on_each_other_are_joined(hinge_case, onto):
    fit = apart(hinge_case, onto)
    check_tree(fit)
    pruned = prune(fit, hinge_case.frames, PRICE, ITERATIONS)
    check_tree(pruned)
    np.testing.assert_array_equal(pruned.labels, hinge_case.labels)
    np.testing.assert_allclose(pruned.chain.Ts, hinge_case.chain.Ts, atol=0.03)


def test_what_hangs_on_a_part_that_joins_its_sibling_comes_after_that(housed):
    arm = housed.chain.joint(1)
    first, second = (replace(housed.chain.joint(0), child=child) for child in (1, 3))
    fit = Fit(housed.chain.with_joints([first, arm, second]), housed.labels)
    joined = join(fit, housed.frames, 1, 3)
    check_tree(joined)
    np.testing.assert_array_equal(joined.chain.tree.parents, [-1, 2, 0])


def test_a_part_cannot_be_joined_with_one_that_hangs_below_its_children(housed):
    with pytest.raises(ValueError, match="do not hang on the root"):
        join(cut(housed, 2, end_of(housed, 2)), housed.frames, 1, 3)


def test_a_part_that_fits_elsewhere_and_leaves_its_own_place_empty_is_joined(hinge_case):
    """Points of the body's edge slide onto other points, which they fit by chance."""
    fit, frames = cut(hinge_case, 0, end_of(hinge_case, 0, 0.05)), hinge_case.frames
    slide = np.array([0.5, 0.5, 0.0, 0.5, 0.5])
    astray = replace(fit.chain.joint(1), kind=PRISMATIC, axis=np.array([0.0, -1.0, 0.0]), states=slide[:, None])
    fit = frames.refine(Fit(fit.chain.with_joints([fit.chain.joint(0), astray]), fit.labels), ITERATIONS)
    price = 0.5 * (frames.cost(join(fit, frames, 2, 0)) - frames.cost(fit))
    assert price > 0
    np.testing.assert_array_equal(prune(fit, frames, price, ITERATIONS).labels, hinge_case.labels)


def test_joining_onto_the_parent_hangs_children_there(housed):
    joined = join(housed.fit, housed.frames, 1, 0)
    check_tree(joined)
    np.testing.assert_array_equal(joined.labels, np.array([0, 0, 1])[housed.labels])
    np.testing.assert_array_equal(joined.chain.tree.parents, [-1, 0])


def test_joining_onto_the_only_child_leaves_it_where_it_was(housed):
    joined = join(housed.fit, housed.frames, 1, 2)
    check_tree(joined)
    np.testing.assert_array_equal(joined.labels, np.array([0, 1, 1])[housed.labels])
    np.testing.assert_array_equal(joined.chain.tree.parents, [-1, 0])


def test_joining_keeps_joints_that_it_does_not_touch(housed):
    joined = join(cut(housed, 0, end_of(housed, 0)), housed.frames, 3, 0)
    check_tree(joined)
    for name in ("parent", "child", "axis", "point"):
        np.testing.assert_array_equal(getattr(joined.chain.tree, name), getattr(housed.chain.tree, name))
    assert joined.chain.tree.kinds == housed.chain.tree.kinds
    np.testing.assert_array_equal(joined.chain.states, housed.chain.states)


def test_the_root_is_joined_onto_its_child(hinge_case):
    drift = np.tile(np.eye(4), (5, 1, 1))
    drift[:, 1, 3] = [0.1, -0.2, 0.0, 0.1, 0.3]
    moved = hinge_case.moved(drift)
    joined = join(moved.fit, moved.frames, 0, 1)
    assert (joined.chain.parts, joined.chain.tree.root, joined.chain.tree.free_root) == (1, 0, True)
    np.testing.assert_array_equal(joined.labels, 0)
    np.testing.assert_allclose(joined.chain.Ts[:, 0], moved.chain.Ts[:, 1])
