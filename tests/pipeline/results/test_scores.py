import shutil

import pytest

from pipeline.results.report_tables import joint_table
from pipeline.results.scores import PlannedSequence, gather, groups_of, read_scores, score_of
from pipeline.run.task import upstream_first
from pipeline.run.tasks import EvaluationTask, final_tasks
from pipeline.store import artifacts
from schemas.config import PipelineConfig
from schemas.errors import InputError
from schemas.metrics import JointVerdict
from schemas.scores import SequenceScore


def by_level(scores):
    return {(group.level, group.name): group for group in scores.groups}


def test_every_evaluated_sequence_is_scored_with_its_robot_type_and_split(evaluated):
    scores = gather(evaluated.request())
    assert [score.sequence for score in scores.sequences] == ["bolt", "ur5"]
    bolt, ur5 = scores.sequences
    assert (bolt.robot, bolt.type, bolt.split) == ("bolt", "biped", "test")
    assert (ur5.type, ur5.figures.ari) == ("arm", 0.5)
    assert scores.missing == ()
    assert scores.config == PipelineConfig.model_validate(scores.config).model_dump(mode="json")


def test_candidates_of_a_stage_are_one_cost_and_its_memory_is_the_greatest(evaluated):
    cost = gather(evaluated.request()).sequences[0].costs["relaxed_fit"]
    assert cost.seconds == pytest.approx(2 * 3.5)
    assert cost.peak_memory_mib == 101


def test_means_are_told_by_robot_type_split_and_over_all(evaluated):
    groups = by_level(gather(evaluated.request()))
    assert groups["type", "arm"].figures.ari == 0.5
    assert groups["all", "all"].figures.ari == pytest.approx(0.7)
    assert groups["split", "test"].sequences == 2
    assert ("robot", "bolt") in groups


def test_confidence_is_judged_over_all_joints_of_a_group(evaluated):
    def verdicts(*pairs):
        return tuple(JointVerdict(confidence=confidence, right=right) for confidence, right in pairs)

    evaluated.finish("cassie", verdicts=verdicts((0.9, True), (0.5, False)))
    evaluated.finish("panda", verdicts=verdicts((0.2, True), (0.8, True)))
    scores = gather(evaluated.request("cassie", "panda"))
    groups = by_level(scores)
    assert groups["all", "all"].figures.confidence_auc == pytest.approx(2 / 3)
    assert groups["type", "biped"].figures.confidence_auc == 1
    assert groups["type", "arm"].figures.confidence_auc is None  # nothing is wrong there
    assert [row.cells[-3].text for row in joint_table(scores).rows if row.section == "all"] == ["0.667"]


def test_a_split_leaves_the_others_out(evaluated):
    evaluated.finish("panda", ari=0.1)
    names = {split: gather(evaluated.request("bolt", "panda"), split).sequences for split in ("test", "validation")}
    assert [score.sequence for score in names["test"]] == ["bolt"]
    assert [score.sequence for score in names["validation"]] == ["panda"]
    with pytest.raises(InputError, match="test, train, validation"):
        gather(evaluated.request(), "tset")


def test_files_have_no_robots_and_no_splits(tmp_path, scan_request):
    scores = gather(scan_request)
    assert [entry.state for entry in scores.missing] == ["missing"]
    with pytest.raises(InputError, match="has no splits"):
        gather(scan_request, "test")


def test_what_has_no_evaluation_is_named_with_the_reason(evaluated):
    request = evaluated.request("bolt", "ur5", "a1")
    evaluation = EvaluationTask(job=evaluated.job("bolt"))
    shutil.rmtree(evaluation.directory)
    evaluation.fail(InputError("it broke"))
    other = PipelineConfig.model_validate(request.config.model_dump() | {"seed": 5})
    missing = {entry.sequence: entry for entry in gather(request).missing}
    assert missing["bolt"].state == "failed"
    assert missing["bolt"].message == "evaluation: it broke"
    assert missing["bolt"].log == str(evaluation.place.log)
    assert missing["a1"].state == "missing"
    stale = gather(evaluated.request("ur5").model_copy(update={"config": other})).missing
    assert [entry.state for entry in stale] == ["stale"]


def test_a_changed_byte_is_told_and_not_scored(evaluated):
    manifest = EvaluationTask(job=evaluated.job("bolt")).directory / artifacts.MANIFEST
    manifest.write_text(manifest.read_text().replace("0.9", "1.0"))
    scores = gather(evaluated.request())
    assert [score.sequence for score in scores.sequences] == ["ur5"]
    assert [(entry.sequence, entry.state) for entry in scores.missing] == [("bolt", "corrupt")]


def test_a_robot_that_this_machine_lacks_is_unavailable_unless_it_was_asked_for(evaluated):
    evaluated.lacked.add("ur5")
    assert [entry.state for entry in gather(evaluated.request("bolt", "ur5")).missing] == ["failed"]
    everything = gather(evaluated.request("bolt").model_copy(update={"sequences": None})).missing
    assert {entry.sequence: entry.state for entry in everything}["ur5"] == "unavailable"


def test_an_evaluation_stands_without_what_it_was_computed_from(evaluated):
    job = evaluated.job("bolt")
    for task in upstream_first(final_tasks(job)):
        if task.stage != "evaluation":
            shutil.rmtree(task.directory)
    score = score_of(PlannedSequence.of(job))
    assert isinstance(score, SequenceScore)
    assert (set(score.costs), score.result) == ({"evaluation"}, None)


def test_an_evaluation_survives_its_file(evaluated, tmp_path):
    scores = gather(evaluated.request())
    path = tmp_path / "evaluation.json"
    path.write_text(scores.model_dump_json(indent=1))
    assert read_scores(path) == scores


@pytest.mark.parametrize(("content", "complaint"), [(None, "cannot be read"), ("{}", "dataset"), ("{", "JSON")])
def test_what_is_no_evaluation_is_refused(tmp_path, content, complaint):
    path = tmp_path / "evaluation.json"
    if content is not None:
        path.write_text(content)
    with pytest.raises(InputError, match=complaint):
        read_scores(path)


def test_no_sequence_has_no_means():
    assert list(groups_of([])) == []
