from __future__ import annotations

import os
import pickle
import struct
import subprocess
from pathlib import Path

import numpy as np
import pytest

from schemas.errors import InputError
from stages.ingest.restricted_pickle import load_arrays

NUMPY_RECONSTRUCT = b"cnumpy._core.multiarray\n_reconstruct\n"
EMPTY_ARRAY = NUMPY_RECONSTRUCT + b"(cnumpy\nndarray\n(K\x00tC\x01btR"
FLOAT64 = b"cnumpy\ndtype\n(X\x02\x00\x00\x00f8I00\nI01\ntR"


def saved(tmp_path: Path, data: bytes) -> Path:
    path = tmp_path / "state_0.pkl"
    path.write_bytes(data)
    return path


def refusal(tmp_path: Path, data: bytes) -> str:
    path = saved(tmp_path, data)
    with pytest.raises(InputError) as caught:
        load_arrays(path)
    message = str(caught.value)
    assert message.startswith(str(path))
    assert "\n" not in message
    return message


class Calls:
    def __init__(self, function: object, *arguments: object) -> None:
        self.reduced = (function, arguments)

    def __reduce__(self) -> tuple:
        return self.reduced


@pytest.mark.parametrize("protocol", range(6))
def test_plain_data_and_arrays_come_back_the_same_from_every_protocol(tmp_path: Path, protocol: int) -> None:
    rng = np.random.default_rng(0)
    shared = np.arange(4)
    data = {
        "pc": rng.normal(size=(5, 3)),
        "column_major": np.asfortranarray(rng.normal(size=(2, 3)).astype(np.float32)),
        "big_endian": np.arange(3, dtype=">i4"),
        "empty": np.empty((0, 3)),
        "zero_dimensional": np.array(2.5),
        "mask": np.array([True, False]),
        "half": np.ones(2, dtype=np.float16),
        "again": [shared, shared, (1, 2, 3, 4), (), (1,), (1, 2)],
        "plain": [None, True, False, -1, 10**30, 1.5, "naïve", b"\x00\xff", b"", {}, []],
        7: {"nested": {"deep": ["x"]}},
    }
    loaded = load_arrays(saved(tmp_path, pickle.dumps(data, protocol)))
    assert list(loaded) == list(data)
    for key in ("pc", "column_major", "big_endian", "empty", "zero_dimensional", "mask", "half"):
        np.testing.assert_array_equal(loaded[key], data[key])
        assert loaded[key].dtype.newbyteorder("=") == data[key].dtype.newbyteorder("=")
        assert loaded[key].shape == data[key].shape
    np.testing.assert_array_equal(loaded["again"][1], shared)
    assert loaded["again"][2:] == [(1, 2, 3, 4), (), (1,), (1, 2)]
    assert loaded["plain"] == data["plain"]
    assert [type(value) for value in loaded["plain"]] == [type(value) for value in data["plain"]]
    assert loaded[7] == data[7]


@pytest.mark.parametrize("protocol", range(6))
def test_numpy_scalars_come_out_as_python_numbers_also_as_keys(tmp_path: Path, protocol: int) -> None:
    loaded = load_arrays(saved(tmp_path, pickle.dumps({np.int64(3): np.float32(0.5)}, protocol)))
    assert loaded == {3: 0.5}
    assert [type(value) for pair in loaded.items() for value in pair] == [int, float]


def test_arrays_pickled_by_older_numpy_and_python_2_are_read(tmp_path: Path) -> None:
    state = b"(K\x01K\x02\x85" + FLOAT64 + b"I00\nU\x10" + struct.pack("<2d", 1.5, -2.0) + b"tb."
    old = (b"\x80\x02" + EMPTY_ARRAY + state).replace(b"numpy._core", b"numpy.core")
    assert b"numpy.core.multiarray" in old
    np.testing.assert_array_equal(load_arrays(saved(tmp_path, old)), [1.5, -2.0])


@pytest.mark.parametrize("protocol", range(6))
def test_a_pickle_that_calls_something_is_refused_without_running_it(tmp_path: Path, protocol: int) -> None:
    trace = tmp_path / "it_ran"
    for call in (
        Calls(os.system, f"touch {trace}"),
        Calls(subprocess.check_output, ["touch", str(trace)]),
        Calls(eval, f"open({str(trace)!r}, 'w')"),
        Calls(Path.touch, trace),
        Calls(np.save, str(trace), 0),
    ):
        for payload in (call, {"pc": call}, [np.zeros(2), call]):
            message = refusal(tmp_path, pickle.dumps(payload, protocol))
            assert "refused, not run" in message
            assert not list(tmp_path.glob("it_ran*"))


def test_the_refusal_names_the_global_that_was_asked_for(tmp_path: Path) -> None:
    assert "posix.system" in refusal(tmp_path, pickle.dumps(Calls(os.system, "true")))
    assert "builtins.eval" in refusal(tmp_path, b"cbuiltins\neval\n(V1+1\ntR.")
    assert "numpy.f2py.compile" in refusal(tmp_path, b"cnumpy.f2py\ncompile\n.")


HOSTILE = {
    "persistent id": b"Pmodule\n.",
    "binary persistent id": b"\x80\x02K\x01Q.",
    "extension registry": b"\x80\x02\x82\x01.",
    "class instance by INST": b"(ios\nsystem\n.",
    "class instance by OBJ": b"(cnumpy\ndtype\nX\x01\x00\x00\x00Oo.",
    "new object": b"cnumpy\nndarray\n(K\x00t\x81.",
    "array with hostile shape in new object": b"cnumpy\nndarray\n(K\x00t}\x92.",
    "out-of-band buffer": b"\x80\x05\x97.",
    "ndarray called": b"cnumpy\nndarray\n(I1000000000000\ntR.",
    "reconstruct of a huge shape": NUMPY_RECONSTRUCT + b"(cnumpy\nndarray\n(I1000000000000\ntC\x01btR.",
    "reconstruct of another type": NUMPY_RECONSTRUCT + b"(cnumpy\ndtype\n(K\x00tC\x01btR.",
    "reconstruct without arguments": NUMPY_RECONSTRUCT + b")R.",
    "arguments that are no tuple": NUMPY_RECONSTRUCT + b"]R.",
    "dtype object": b"cnumpy\ndtype\n(X\x01\x00\x00\x00OI00\nI01\ntR.",
    "dtype with fields": b"cnumpy\ndtype\n(](X\x01\x00\x00\x00aX\x02\x00\x00\x00f8tatR.",
    "dtype by name of a global": b"cnumpy\ndtype\n(cnumpy\nndarray\ntR.",
    "dtype of a huge text": b"cnumpy\ndtype\n(X\x0b\x00\x00\x00U1000000000I00\nI01\ntR.",
    "dtype state with fields": FLOAT64 + b"(K\x03X\x01\x00\x00\x00<N]}K\x08K\x01K\x00tb.",
    "dtype as the result": FLOAT64 + b".",
    "function as the result": NUMPY_RECONSTRUCT + b".",
    "array state of a huge shape": EMPTY_ARRAY + b"(K\x01I1000000000000\n\x85" + FLOAT64 + b"I00\nC\x00tb.",
    "array state of an infinite shape": EMPTY_ARRAY + b"(K\x01(I0\nI" + b"9" * 40 + b"\nt" + FLOAT64 + b"I00\nC\x00tb.",
    "array state of a negative shape": EMPTY_ARRAY
    + b"(K\x01(I-1\nI-2\nt"
    + FLOAT64
    + b"I00\nC\x10"
    + bytes(16)
    + b"tb.",
    "array state with a list as data": EMPTY_ARRAY + b"(K\x01K\x01\x85" + FLOAT64 + b"I00\n]K\x01atb.",
    "array state with a text as dtype": EMPTY_ARRAY
    + b"(K\x01K\x01\x85X\x01\x00\x00\x00OI00\nC\x08"
    + bytes(8)
    + b"tb.",
    "array state that is a dict": EMPTY_ARRAY + b"}X\x01\x00\x00\x00aK\x01sb.",
    "state of a function": NUMPY_RECONSTRUCT + b"}X\x08\x00\x00\x00__code__K\x01sb.",
    "state of a dict": b"}}b.",
    "encode with another codec": b"c_codecs\nencode\n(X\x03\x00\x00\x00abcX\x06\x00\x00\x00base64tR.",
    "encode of beyond latin 1": b"c_codecs\nencode\n(X\x03\x00\x00\x00\xe2\x82\xacX\x06\x00\x00\x00latin1tR.",
    "memo that was never set": b"h\x07.",
    "text longer than the file": b"\x80\x04\x8d" + struct.pack("<Q", 2**40) + b"abc.",
    "bytearray longer than the file": b"\x80\x05\x96" + struct.pack("<Q", 2**40) + b"abc.",
    "frame longer than the file": b"\x80\x04\x95" + struct.pack("<Q", 2**40),
    "integer of a million digits": b"I" + b"9" * 1_000_000 + b"\n.",
    "a tuple as a key, nested so that hashing it never ends": b"})" + b"q\x00h\x00\x86" * 60 + b"Ns.",
    "deep tuples as a key": b"}" + b")" + b"\x85" * 100_000 + b"Ns.",
    "dtype that takes for ever to show": b"cnumpy\ndtype\n(]" + b"q\x00](h\x00h\x00e" * 60 + b"tR.",
    "global that takes for ever to hash": b")" + b"q\x00h\x00\x86" * 60 + b"h\x00\x93.",
    "list as a key": b"}]Ns.",
    "append to a number": b"K\x01K\x02a.",
    "items of a list": b"]K\x01K\x02s.",
    "odd number of items": b"}(K\x01u.",
    "empty stack": b"R.",
    "mark without end": b"t.",
    "two results": b"K\x01K\x02.",
    "no end": b"K\x01",
    "empty file": b"",
    "text": b"hello world",
}


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_and_broken_pickles_get_one_line(tmp_path: Path, name: str) -> None:
    refusal(tmp_path, HOSTILE[name])


def test_one_text_cannot_become_more_bytes_than_the_file_could_hold(tmp_path: Path) -> None:
    text = b"\x80\x02X" + struct.pack("<I", 100_000) + b"a" * 100_000 + b"q\x00("
    encode = b"c_codecs\nencode\nh\x00X\x06\x00\x00\x00latin1\x86R"
    assert "far more data" in refusal(tmp_path, text + encode * 1000 + b"t.")


def test_a_memo_index_of_billions_takes_no_memory(tmp_path: Path) -> None:
    assert load_arrays(saved(tmp_path, b"\x80\x04Nr\xff\xff\xff\xff.")) is None


def test_deep_and_cyclic_containers_come_back_without_recursion(tmp_path: Path) -> None:
    deep = load_arrays(saved(tmp_path, b"]" * 100_000 + b"a" * 99_999 + b"."))
    assert isinstance(deep, list)
    cyclic = load_arrays(saved(tmp_path, b"]q\x00h\x00a."))
    assert cyclic[0] is cyclic


def test_changing_a_byte_order_leaves_numpy_alone(tmp_path: Path) -> None:
    state = b"(K\x03X\x01\x00\x00\x00>NNNJ\xff\xff\xff\xffJ\xff\xff\xff\xffK\x00tb"
    refusal(tmp_path, FLOAT64 + state + b".")
    assert np.dtype("f8").isnative


@pytest.mark.parametrize("kept", [0.2, 0.5, 0.9, 0.999])
def test_a_truncated_pickle_is_refused(tmp_path: Path, kept: float) -> None:
    data = pickle.dumps({"pc": np.ones((50, 3)), "part_id": np.zeros(50, dtype=int)})
    refusal(tmp_path, data[: int(len(data) * kept)])


def test_a_missing_file_gets_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"absent\.pkl"):
        load_arrays(tmp_path / "absent.pkl")


def test_arrays_of_objects_texts_and_records_are_refused(tmp_path: Path) -> None:
    for array in (
        np.array([{}, None], dtype=object),
        np.array(["a"]),
        np.zeros(2, dtype=[("x", "f8")]),
        np.zeros(1, "c16"),
    ):
        assert "dtype" in refusal(tmp_path, pickle.dumps({"pc": array}))


def test_damaged_bytes_anywhere_end_in_a_result_or_one_line(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    whole = pickle.dumps({"pc": np.ones((2, 3)), "part_id": np.zeros(2, dtype=int), 3: np.int64(1)}, 2)
    messages = []
    for _ in range(400):
        damaged = np.frombuffer(whole, np.uint8).copy()
        damaged[rng.integers(len(damaged), size=2)] = rng.integers(256, size=2)
        try:
            load_arrays(saved(tmp_path, damaged.tobytes()))
            messages.append("")
        except InputError as error:
            messages.append(str(error))
    assert 0 < messages.count("") < 400
    assert not any("\n" in message for message in messages)
