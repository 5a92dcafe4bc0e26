import networkx as nx
import numpy as np
import pytest

from schemas.config import FinalFitConfig, ProjectionConfig
from stages.figure import draw, tree_layout, true_colours
from stages.final_fit import fit_final
from stages.kernels.palette import part_colours
from stages.projection import link_parts
from stages.result import to_result


@pytest.fixture
def result(hinge):
    parts = link_parts(
        hinge.sequence.frames()[2], hinge.canonical_labels, hinge.Ts_frame_canonical, 2, ProjectionConfig()
    )
    still = FinalFitConfig(iterations=0)
    return to_result(
        fit_final(parts, hinge.sequence, hinge.true_flow(), still, np.random.default_rng(0)), hinge.sequence
    )


def test_shows_points_parts_pose_and_tree(result):
    figure = draw(result)
    titles = [axes.get_title() for axes in figure.axes]
    assert titles[1] == "2 parts, 1 joints"
    assert len(titles) == 4
    posed = np.stack(figure.axes[2].collections[0]._offsets3d, axis=1)
    frame = int(titles[2].rsplit(" ", 1)[1])
    T_points = result.T_frame_canonical[frame, result.labels]
    expected = np.einsum("nij,nj->ni", T_points[:, :3, :3], result.canonical_points) + T_points[:, :3, 3]
    np.testing.assert_allclose(np.sort(posed[:, 0]), np.sort(expected[:, 0]), atol=1e-6)


def test_draws_the_joint_axis_where_it_is(result):
    (line,) = draw(result).axes[1].lines
    ends = np.stack(line.get_data_3d(), axis=1)
    direction = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    joint = result.model.joints[0]
    assert abs(direction @ np.array(joint.axis)) == pytest.approx(1)
    np.testing.assert_allclose(np.cross(ends[0] - np.array(joint.point), direction), 0, atol=1e-6)


def test_parents_stand_above_the_middle_of_their_children():
    layout = tree_layout(nx.DiGraph([(0, 1), (0, 2), (2, 3), (2, 4)]), 0)
    assert layout[2][0] == pytest.approx((layout[3][0] + layout[4][0]) / 2)
    assert layout[0][1] > layout[1][1] == layout[2][1] > layout[3][1]
    assert len({place for place in layout.values()}) == 5


def test_true_parts_stand_beside_the_predicted_ones_in_their_colours(result):
    labels_true = 1 - result.labels  # the same parts by other numbers
    figure = draw(result, labels_true)
    titles = [axes.get_title() for axes in figure.axes]
    assert (len(titles), titles[2]) == (5, "2 true parts")
    np.testing.assert_array_equal(true_colours(result.labels, labels_true), part_colours(2)[result.labels])


def test_a_true_part_that_was_not_found_has_a_colour_of_its_own():
    labels, labels_true = np.array([0, 0, 0, 1]), np.array([0, 0, 2, 1])
    colours = true_colours(labels, labels_true)
    np.testing.assert_array_equal(colours[[0, 3]], part_colours(2))
    assert not (colours[2] == part_colours(2)).all(axis=1).any()
