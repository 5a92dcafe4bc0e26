import pytest

from pipeline.results.comparison import changed_settings, compare, verdict
from pipeline.results.scores import gather
from schemas.scores import MEASURES


@pytest.fixture
def before(evaluated):
    return gather(evaluated.request())


def changed(scores, sequence, **figures):
    sequences = tuple(
        score.model_copy(update={"figures": score.figures.model_copy(update=figures)})
        if score.sequence == sequence
        else score
        for score in scores.sequences
    )
    return scores.model_copy(update={"sequences": sequences})


def test_what_is_the_same_is_neither_better_nor_worse(before):
    found = compare(before, before, "old.json")
    assert {d.verdict for entry in found.sequences for d in entry.differences.values()} == {"same", None}
    assert found.settings == ()


@pytest.mark.parametrize(
    ("name", "change", "expected"),
    [
        ("ari", 0.1, "better"),
        ("ari", -0.1, "worse"),
        ("recon_percent", 0.1, "worse"),
        ("recon_percent", -0.1, "better"),
        ("tree_edit_distance", -1.0, "better"),
        ("seconds", 30.0, "worse"),
        ("ari", 0.0004, "same"),
        ("parts_found", 3.0, None),
    ],
)
def test_each_measure_has_its_own_direction(name, change, expected):
    assert verdict(MEASURES[name], change) == expected


def test_differences_are_told_of_each_sequence_and_of_the_means(before):
    found = compare(before, changed(before, "ur5", ari=0.7), "old.json")
    ur5 = next(entry for entry in found.sequences if entry.name == "ur5").differences["ari"]
    assert (ur5.before, ur5.after, ur5.verdict) == (0.5, 0.7, "better")
    assert found.mean.differences["ari"].change == pytest.approx(0.1)


def test_means_are_over_what_both_have(evaluated, before):
    evaluated.finish("a1", ari=0.0)
    after = gather(evaluated.request("ur5", "a1"))
    found = compare(before, after, "old.json")
    assert (found.only_before, found.only_after) == (("bolt",), ("a1",))
    assert found.mean.differences["ari"].before == found.mean.differences["ari"].after == 0.5
    nothing = compare(before, gather(evaluated.request("a1")), "old.json")
    assert (nothing.mean, nothing.sequences) == (None, ())


def test_a_figure_that_one_side_lacks_has_no_difference(before):
    found = compare(changed(before, "bolt", ari=None), before, "old.json")
    bolt = next(entry for entry in found.sequences if entry.name == "bolt")
    assert "ari" not in bolt.differences


def test_settings_that_differ_are_named_with_both_values():
    before = {"seed": 0, "flow": {"estimator": "a", "geometric": {"nodes": 250}}}
    after = {"seed": 0, "flow": {"estimator": "a", "geometric": {"nodes": 150}}, "new": 1}
    assert list(changed_settings(before, after)) == ["flow.geometric.nodes: 250 -> 150", "new: None -> 1"]
