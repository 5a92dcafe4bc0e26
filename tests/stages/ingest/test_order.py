from __future__ import annotations

import pytest

from stages.ingest.order import in_order

PLAIN = [
    ["Frame_1", "frame_2", "FRAME_3", "frame_10"],
    ["frame_2", "frame_10"],
    ["0.9", "1.05", "1.2"],
    ["-1", "1"],
    ["a_-10", "a_-5", "a_0", "a_5"],
    ["1e-05", "0.0001", "0.05"],
    ["scan-1", "scan-2", "scan-10"],
    ["scan_1.2.3", "scan_1.2.10"],
    ["t=0.5s", "t=1.25s", "t=10.0s"],
    ["0.10", "0.25", "1.00"],
    ["1699999999.123456789", "1699999999.123456790"],
    ["2024-01-02_03-04-05", "2024-01-02_03-05-01"],
    ["frame_1_of_10", "frame_2_of_10", "frame_10_of_10"],
    ["FRAME_1", "frame_2"],
    ["state 1 (lamp)", "state 2 (lamp)"],
    ["0.05", "0.10", "0.25", "0.50"],
    ["scan_1_08", "scan_1_09", "scan_1_10", "scan_2_01", "scan_2_100"],
    ["only"],
]
DOUBTFUL = {
    "taken for versions": ["1.8", "1.9", "1.10"],
    "taken for decimals": ["1.11", "1.9"],
    "taken for decimals (a mixture)": ["0.05", "0.10", "0.25", "0.5"],
    "taken for decimals (with versions' zeros)": ["1.05", "1.10", "1.9"],
    "taken for decimals (commas)": ["0,9", "1,05", "1,2"],
    "taken for decimals (commas and a word)": ["t_0,25", "t_0,5", "t_1,0"],
    "taken for decimals (thousands)": ["1,000", "2,000", "900"],
    "taken for versions (commas)": ["1,8", "1,9", "1,10"],
    "begin with zeros": ["0_9", "1_2", "1_05"],
    "begin with zeros (dashes)": ["0-9", "1-2", "1-05"],
    "begin with zeros (one first number)": ["t1_2", "t1_05"],
    "no numbers": ["end", "start"],
    "more than their numbers": ["a_1", "b_1"],
    "several numbers": ["cam1_frame1", "cam1_frame2", "cam2_frame1"],
    "a sign": ["-3", "-2", "-1"],
    "the same number": ["01", "1"],
}


@pytest.mark.parametrize("names", PLAIN, ids=lambda names: names[0])
def test_plain_numbering_is_ordered_without_a_word(names: list[str]) -> None:
    for suffix in (".ply", ""):
        expected = [name + suffix for name in names]
        order = in_order(expected[::-1])
        assert order.names == expected
        assert order.doubt == ""


@pytest.mark.parametrize(("doubt", "names"), DOUBTFUL.items(), ids=DOUBTFUL)
def test_an_order_that_is_not_plain_says_why(doubt: str, names: list[str]) -> None:
    order = in_order([f"{name}.ply" for name in reversed(names)])
    if doubt != "no numbers":
        assert order.names == [f"{name}.ply" for name in names]
        assert doubt.split(" (")[0] in order.doubt
    assert order.doubt
    assert f"in this order: {', '.join(order.names)}" in order.message()


def test_the_message_stays_short() -> None:
    order = in_order([f"frame{letter}" for letter in "abcdefgh"])
    assert "framea, frameb, framec, framed, ..., frameh;" in order.message()
