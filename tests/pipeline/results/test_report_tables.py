import csv
import io

import pytest

from pipeline.results.comparison import compare
from pipeline.results.report_tables import (
    COMPARED,
    brief_tables,
    comparison_tables,
    full_tables,
    joint_table,
    memory_table,
    number,
    quality_table,
    seconds_table,
    stage_table,
    to_csv,
    to_markdown,
)
from pipeline.results.scores import gather
from schemas.scores import MEASURES, MissingScore


@pytest.fixture
def scores(evaluated):
    return gather(evaluated.request())


def cells(table, name):
    row = next(row for row in table.rows if row.name == name)
    return dict(zip(table.columns, [row.name, *(cell.text for cell in row.cells)], strict=True))


def test_quality_is_told_by_sequence_type_split_and_in_the_mean(scores):
    table = quality_table(scores)
    names = [row.name for row in table.rows]
    assert names == ["bolt", "ur5", "type arm (1)", "type biped (1)", "split test (2)", "mean (2)"]
    bolt = cells(table, "bolt")
    assert (bolt["parts"], bolt["ARI"], bolt["recon cm"], bolt["recon %"]) == ("3/4", "0.900", "0.500", "0.300")
    assert cells(table, "ur5")["recon cm"] == "-"
    assert cells(table, "mean (2)")["ARI"] == "0.700"


def test_columns_that_nobody_has_a_figure_for_are_left_out(scores):
    assert "acc5" not in quality_table(scores).columns


def test_robots_have_means_where_they_have_several_sequences(scores):
    groups = [g.model_copy(update={"sequences": 2}) if g.name == "bolt" else g for g in scores.groups]
    several = scores.model_copy(update={"groups": tuple(groups)})
    assert "robot bolt (2)" in [row.name for row in quality_table(several).rows]


def test_a_single_sequence_has_no_means(evaluated):
    assert [row.name for row in quality_table(gather(evaluated.request("bolt"))).rows] == ["bolt"]


def test_costs_are_told_by_stage(scores):
    assert cells(seconds_table(scores), "bolt")["relaxed_fit s"] == "7.0"
    assert cells(memory_table(scores), "bolt")["relaxed_fit MiB"] == "101"
    assert cells(stage_table(scores), "relaxed_fit") == {
        "stage": "relaxed_fit",
        "mean s": "7.0",
        "share": "11.8%",
        "peak MiB": "101",
    }
    assert cells(joint_table(scores), "bolt")["joints"] == "0/1"


def test_a_screen_ends_with_quality_and_a_document_begins_with_it(scores):
    assert brief_tables(scores)[-1] == full_tables(scores)[0] == quality_table(scores)


def test_what_is_missing_is_told_in_a_document(scores):
    missing = MissingScore(sequence="a1", state="failed", message="it broke | badly", log="a1/flow-0.log")
    [table] = [t for t in full_tables(scores.model_copy(update={"missing": (missing,)})) if t.title == "Not evaluated"]
    assert "| a1 | failed | it broke \\| badly | a1/flow-0.log |" in to_markdown(table)


def test_markdown_has_as_many_cells_in_every_line(scores):
    for table in full_tables(scores):
        _, _, *lines = to_markdown(table).splitlines()
        assert {line.count("|") for line in lines} == {len(table.columns) + 1}


def test_csv_holds_every_figure_unrounded_and_every_mean(scores):
    lines = list(csv.DictReader(io.StringIO(to_csv(scores))))
    assert [(line["level"], line["name"]) for line in lines][:3] == [
        ("sequence", "bolt"),
        ("sequence", "ur5"),
        ("robot", "bolt"),
    ]
    bolt = lines[0]
    assert set(MEASURES) < set(bolt)
    assert (float(bolt["ari"]), bolt["acc5"], float(bolt["relaxed_fit_seconds"])) == (0.9, "", 7.0)


def test_better_and_worse_are_told_by_a_mark_and_a_sign(scores):
    bolt, ur5 = scores.sequences
    figures = ur5.figures.model_copy(update={"ari": 0.6, "chamfer_percent": 0.7})
    after = scores.model_copy(update={"sequences": (bolt, ur5.model_copy(update={"figures": figures}))})
    by_sequence, _costs, means = comparison_tables(compare(scores, after, "old.json"))
    row = cells(by_sequence, "ur5")
    assert (row["ARI"], row["Chamfer %"]) == ("+0.100 ▲", "+0.200 ▼")
    assert cells(by_sequence, "bolt")["ARI"] == "0.000 ="
    mean = cells(means, "ARI")
    assert (mean["before"], mean["after"], mean["change"], mean["verdict"]) == ("0.700", "0.750", "+0.050", "▲ better")
    assert cells(means, "parts")["verdict"] == "-"


@pytest.mark.parametrize(
    ("value", "decimals", "text"), [(None, 3, "-"), (2.0, 1, "2"), (2.5, 1, "2.5"), (2.0, 2, "2.00"), (10.4, 0, "10")]
)
def test_means_of_whole_numbers_have_one_decimal_and_whole_numbers_none(value, decimals, text):
    assert number(value, decimals) == text


def test_everything_that_has_a_direction_is_compared_in_percent_rather_than_centimetres():
    compared = {name for names in COMPARED.values() for name in names}
    assert compared == {name for name, measure in MEASURES.items() if measure.better and not name.endswith("_cm")}
