import numpy as np
import pytest

from schemas.config import FinalFitConfig, ProjectionConfig
from schemas.sequence import NO_PART, GroundTruth, IngestedSequence, TrueJoint
from stages.final_fit.stage import compute_final_fit
from stages.kernels.labelling.colours import distinct_colours
from stages.projection.stage import link_parts
from stages.report.figure import AXIS_COLOUR, draw
from stages.result.stage import compute_result


@pytest.fixture
def result(hinge):
    parts = link_parts(
        hinge.sequence.frames()[2], hinge.canonical_labels, hinge.Ts_frame_canonical, 2, ProjectionConfig()
    )
    still = FinalFitConfig(iterations=0)
    return compute_result(
        compute_final_fit(parts, hinge.sequence, hinge.true_flow(), still, np.random.default_rng(0)), hinge.sequence
    )


@pytest.fixture
def ingested(hinge):
    """The hinge with its truth, whose parts have the opposite numbers."""
    Ts_frame_first = hinge.Ts_frame_canonical @ np.linalg.inv(hinge.Ts_frame_canonical[0])
    joint = TrueJoint(
        name="lid",
        parent=1,
        child=0,
        type="revolute",
        axis=tuple(hinge.axis),
        point=tuple(hinge.point),
        states=tuple(hinge.states[:, 0] - hinge.states[0, 0]),
    )
    truth = GroundTruth(
        labels=1 - np.concatenate(hinge.labels),
        Ts_frame_first=Ts_frame_first[:, ::-1].copy(),
        Ts_novel_first=np.zeros((0, 2, 4, 4)),
        parent=np.array([1, -1]),
        part_names=("lid", "body"),
        joints=(joint,),
    )
    return IngestedSequence(sequence=hinge.sequence, truth=truth)


def by_title(figure):
    return {axes.get_title(): axes for axes in figure.axes}


def line_of(axes):
    (line,) = (line for line in axes.lines if line.get_color() == AXIS_COLOUR)
    return np.stack(line.get_data_3d(), axis=1)


def test_shows_input_parts_tree_flow_and_pose(result):
    panels = by_title(draw(result))
    assert len(panels) == 5
    assert "2 parts, 1 joint" in panels
    title = next(title for title in panels if title.startswith("pose of frame"))
    posed = np.stack(panels[title].collections[0]._offsets3d, axis=1)
    T_points = result.T_frame_canonical[int(title.rsplit(" ", 1)[1]), result.labels]
    expected = np.einsum("nij,nj->ni", T_points[:, :3, :3], result.canonical_points) + T_points[:, :3, 3]
    np.testing.assert_allclose(np.sort(posed[:, 0]), np.sort(expected[:, 0]), atol=1e-6)


def test_draws_the_screw_axis_where_it_is(result):
    ends = line_of(by_title(draw(result))["2 parts, 1 joint"])
    direction = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    joint = result.model.joints[0]
    assert abs(direction @ np.array(joint.axis)) == pytest.approx(1)
    np.testing.assert_allclose(np.cross(ends[0] - np.array(joint.point), direction), 0, atol=1e-6)


def test_the_truth_stands_below_in_the_colours_of_the_parts_found(result, ingested):
    panels = by_title(draw(result, ingested))
    assert len(panels) == 9
    assert "input, 3 frames, late ones light" in panels
    found, true = panels["2 parts, 1 joint"], panels["2 true parts, 1 joint"]
    for axes in (found, true):
        colours = axes.collections[0].get_facecolors()[:, :3]
        np.testing.assert_allclose(np.unique(colours, axis=0), np.unique(distinct_colours(2), axis=0))
    direction = np.diff(line_of(true), axis=0)[0]
    assert np.linalg.norm(np.cross(direction, np.diff(line_of(found), axis=0)[0])) < 0.05 * direction @ direction
    assert np.linalg.norm(line_of(true).mean(axis=0) - line_of(found).mean(axis=0)) < 0.1


def test_points_of_no_part_are_not_drawn_among_the_true_parts(result, ingested):
    labels = ingested.truth.labels.copy()
    labels[::4] = NO_PART
    whole = by_title(draw(result, ingested))["2 true parts, 1 joint"].collections[0]
    panels = by_title(draw(result, ingested.replace(truth=ingested.truth.replace(labels=labels))))
    drawn = panels["2 true parts, 1 joint"].collections[0]
    np.testing.assert_array_equal(
        np.stack(drawn._offsets3d), np.delete(np.stack(whole._offsets3d), np.arange(0, 400, 4), axis=1)
    )
    none = ingested.truth.replace(labels=np.full_like(labels, NO_PART))
    assert len(by_title(draw(result, ingested.replace(truth=none)))) == 5


def test_a_truth_that_does_not_tell_the_tree_is_drawn_without_it(result, ingested):
    unknown = ingested.truth.replace(parent=np.array([-1, -1]), joints=())
    panels = by_title(draw(result, ingested.replace(truth=unknown)))
    assert {"true tree: unknown", "2 true parts, 0 joints"} <= set(panels)


def test_an_svg_of_many_points_stays_small(result, tmp_path):
    draw(result).savefig(tmp_path / "figure.svg", dpi=50)
    content = (tmp_path / "figure.svg").read_text()
    assert content.startswith("<?xml")
    assert content.count("<image") >= 4
    assert len(content) < 600_000
