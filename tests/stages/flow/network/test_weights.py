import pickle

import pytest
import torch
from safetensors.torch import save

from schemas.errors import InputError
from stages.flow.network.model import FeatureNetwork
from stages.flow.network.weights import FORMAT, SHIPPED, load_network, read_safetensors, safetensors_bytes, weights_file


@pytest.fixture(scope="module")
def network():
    torch.manual_seed(3)
    return FeatureNetwork()


def test_weights_come_back_as_they_were_written(network, tmp_path):
    path = tmp_path / "weights.safetensors"
    path.write_bytes(weights_file(network, {"steps": "7"}))
    read = load_network(path)
    assert not read.training
    for name, value in network.state_dict().items():
        torch.testing.assert_close(read.state_dict()[name], value, rtol=0, atol=0)


def _changed(state, name, change):
    return {**state, name: change(state[name])}


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (
            lambda state: _changed(state, "head.weight", lambda value: value[:, :5].contiguous()),
            r"head\.weight: found shape \(64, 5\)",
        ),
        (lambda state: {name: value for name, value in state.items() if name != "head.bias"}, "found no head.bias"),
        (lambda state: {**state, "more": torch.zeros(2)}, "found more"),
        (lambda state: _changed(state, "head.bias", lambda value: value * torch.nan), "head.bias: found NaN"),
    ],
)
def test_weights_of_another_network_are_refused(network, change, complaint, tmp_path):
    path = tmp_path / "weights.safetensors"
    path.write_bytes(save(change(network.state_dict()), {"format": FORMAT}))
    with pytest.raises(InputError, match=complaint):
        load_network(path)


@pytest.mark.parametrize(
    "content", [pickle.dumps({"head.bias": [1.0]}), b"", b"\xff" * 100, b"\x10\0\0\0\0\0\0\0" + b"{" * 16]
)
def test_anything_but_safetensors_is_refused_unread(content, tmp_path):
    path = tmp_path / "weights.pt"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"weights\.pt: found something else than safetensors"):
        load_network(path)


def test_a_file_of_another_format_and_a_missing_one_are_refused(network, tmp_path):
    path = tmp_path / "weights.safetensors"
    path.write_bytes(save(network.state_dict(), {"format": "another"}))
    with pytest.raises(InputError, match="found format 'another'"):
        load_network(path)
    with pytest.raises(InputError, match="found no such file"):
        load_network(tmp_path / "nothing")


def test_the_shipped_weights_are_small_and_can_be_loaded():
    assert SHIPPED.stat().st_size < 10_000_000
    load_network(SHIPPED)


def test_the_same_tensors_give_the_same_bytes_in_any_order():
    tensors = {"b": torch.arange(3.0), "a": torch.ones(2, 2).T, "c": torch.tensor(7)}
    notes = {"format": "f", **{letter: letter for letter in "abcdefgh"}}
    other = {"c": torch.tensor(7), "a": torch.ones(2, 2), "b": torch.arange(3.0)}
    turned = dict(reversed(notes.items()))
    # the library's own order of the notes is drawn anew each time
    assert {safetensors_bytes(tensors, notes), safetensors_bytes(other, turned)} == {safetensors_bytes(tensors, notes)}


def test_other_programs_read_what_is_written(tmp_path):
    from safetensors.torch import load_file

    path = tmp_path / "x.safetensors"
    path.write_bytes(safetensors_bytes({"a": torch.arange(4.0), "n": torch.tensor(3)}, {"format": "f"}))
    torch.testing.assert_close(load_file(path), {"a": torch.arange(4.0), "n": torch.tensor(3)})


def test_a_changed_value_is_found_by_the_digest(tmp_path):
    path = tmp_path / "x.safetensors"
    content = bytearray(safetensors_bytes({"a": torch.arange(4.0)}, {"format": "f"}))
    content[-1] ^= 1
    path.write_bytes(content)
    with pytest.raises(InputError, match="the file is damaged"):
        read_safetensors(path, "f")


def test_a_large_file_is_refused_unread(tmp_path):
    path = tmp_path / "x.safetensors"
    with path.open("wb") as file:
        file.truncate(600 * 2**20)
    with pytest.raises(InputError, match="found 600 MiB, expected at most"):
        load_network(path)
