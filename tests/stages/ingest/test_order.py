from __future__ import annotations

import pytest

from stages.ingest.order import in_order

PLAIN = [
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
    ["only"],
]
DOUBTFUL = {
    "taken for versions": ["1.8", "1.9", "1.10"],
    "taken for decimals": ["1.11", "1.9"],
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
        assert doubt in order.doubt
    assert order.doubt
    assert f"in this order: {', '.join(order.names)}" in order.message()


def test_the_message_stays_short() -> None:
    order = in_order([f"frame{letter}" for letter in "abcdefgh"])
    assert "framea, frameb, framec, framed, ..., frameh;" in order.message()
