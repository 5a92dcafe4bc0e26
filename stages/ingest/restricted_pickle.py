"""Arrays from an untrusted pickle, without unpickling it.

A pickle is a program for a small stack machine. Python's own machine can be restricted to certain names. But even then
a hostile file can hang it (by hashing nested tuples), exhaust memory (by one large memo index) or pass odd states to
the objects that it builds. So this module only *reads* the program, with the standard library's disassembler. The
functions below execute the few operations that plain data and numpy arrays need, and each checks its arguments. Nothing
is imported, and no foreign callable is ever called.
"""

from __future__ import annotations

import math
import pickletools
import re
from collections.abc import Callable
from pathlib import Path
from types import FunctionType
from typing import Any

import numpy as np

from schemas.errors import InputError
from stages.ingest.messages import one_line, out_of_memory, unreadable

_ADVICE = "expected only numbers, texts, containers and plain numpy arrays; save the arrays again, best as .npz"
_KEY_TYPES = (str, int, float, bool, bytes, type(None))
_RESULT_TYPES = (*_KEY_TYPES, np.ndarray)


class _RefusedError(Exception):
    """The pickle contains an operation that plain data and arrays do not need."""


def load_arrays(path: Path) -> Any:
    """Load a pickle of plain data and numpy arrays.

    The result consists of dict, list, tuple, str, int, float, bool, None, bytes and arrays of booleans, integers or
    floats. numpy scalars become Python numbers. Raises InputError, naming the file and the refused operation, for
    everything else. Also raises InputError for a damaged file and for one that cannot be read.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise unreadable(path, error) from error
    try:
        return _run(data)
    except _RefusedError as refusal:
        raise InputError(f"{path}: refused, not run, since the pickle {one_line(refusal)}; {_ADVICE}") from None
    except MemoryError as error:
        raise out_of_memory(path) from error
    except Exception as error:  # any exception is due to a damaged or hostile file
        raise InputError(f"{path}: cannot be read as a pickle ({one_line(error)}); {_ADVICE}") from error


def _run(data: bytes) -> Any:
    machine = _Machine(budget=4 * len(data))
    for opcode, argument, _ in pickletools.genops(data):
        if opcode.name == "STOP":
            break
        if opcode.name in _CONSTANTS:
            machine.stack.append(argument)
        elif opcode.name in _OPERATIONS:
            _OPERATIONS[opcode.name](machine, argument)
        elif opcode.name not in _FRAMING:
            raise _RefusedError(f"uses the operation {opcode.name}")
    (result,) = machine.stack
    _check_result(result)
    return result


def _check_result(result: Any) -> None:
    """Refuse a result with one of the machine's internal objects, such as a dtype."""
    seen: set[int] = set()
    front = [result]
    while front:
        value = front.pop()
        if id(value) in seen:
            continue
        seen.add(id(value))
        if isinstance(value, dict):
            front += value.values()
        elif isinstance(value, list | tuple):
            front += value
        elif not isinstance(value, _RESULT_TYPES):
            raise _RefusedError(f"holds a {type(value).__name__}")


class _Machine:
    """The stack and the memo of a pickle, and the operations on them."""

    def __init__(self, budget: int) -> None:
        self.stack: list[Any] = []
        self.marks: list[int] = []
        self.memo: dict[int, Any] = {}
        self.budget = budget  # bytes for arrays; without a bound one text could become many arrays

    def take(self, count: int) -> list[Any]:
        """Pop the topmost `count` values."""
        if len(self.stack) < count:
            raise ValueError("the stack is empty")
        start = len(self.stack) - count
        values = self.stack[start:]
        del self.stack[start:]
        return values

    def take_marked(self) -> list[Any]:
        """Pop the values above the last mark."""
        if not self.marks:
            raise ValueError("there is no mark")
        return self.take(max(len(self.stack) - self.marks.pop(), 0))

    def memoize(self, index: int) -> None:
        self.memo[index] = self.stack[-1]

    def recall(self, index: int) -> None:
        if index not in self.memo:
            raise ValueError(f"there is no memo {index}")
        self.stack.append(self.memo[index])

    def extend_list(self, values: list[Any]) -> None:
        if type(self.stack[-1]) is not list:
            raise _RefusedError(f"appends to a {type(self.stack[-1]).__name__}")
        self.stack[-1].extend(values)

    def extend_dict(self, values: list[Any]) -> None:
        if type(self.stack[-1]) is not dict:
            raise _RefusedError(f"sets items of a {type(self.stack[-1]).__name__}")
        for key, value in zip(values[::2], values[1::2], strict=True):
            if type(key) not in _KEY_TYPES:
                raise _RefusedError(f"has a {type(key).__name__} as a key")
            self.stack[-1][key] = value

    def push_dict(self, values: list[Any]) -> None:
        self.stack.append({})
        self.extend_dict(values)

    def push_global(self, module: Any, name: Any) -> None:
        # only texts may be hashed or shown, since either could take for ever for nested tuples
        if type(module) is not str or type(name) is not str:
            raise _RefusedError(f"asks for a global by a {type(module).__name__} and a {type(name).__name__}")
        if (module, name) not in _GLOBALS:
            raise _RefusedError(f"asks for {module}.{name}")
        self.stack.append(_GLOBALS[module, name])

    def reduce(self) -> None:
        function, arguments = self.take(2)
        if type(function) is not FunctionType or type(arguments) is not tuple:
            raise _RefusedError(f"calls {_shown(function)} with {_shown(arguments)}")
        result = function(*arguments)
        self.spend(result.nbytes if isinstance(result, np.ndarray) else len(result) if type(result) is bytes else 0)
        self.stack.append(result)

    def build(self) -> None:
        (state,) = self.take(1)
        target = self.stack[-1]
        if isinstance(target, np.ndarray):
            _fill_array(target, state)
            self.spend(target.nbytes)
        elif isinstance(target, np.dtype):
            _set_byte_order(target, state)
        else:
            raise _RefusedError(f"sets the state of a {type(target).__name__}")

    def spend(self, size: int) -> None:
        self.budget -= size
        if self.budget < 0:
            raise _RefusedError("makes far more data than the file holds")


# Replacements for the functions that numpy's pickles call.


def _array_to_fill(subtype: Any, shape: Any, typecode: Any) -> np.ndarray:
    """Replace numpy's `_reconstruct`: make an array whose shape, dtype and data `_fill_array` sets."""
    if subtype is not _ARRAY_TYPE or shape != (0,) or typecode not in (b"b", "b"):
        raise _RefusedError("builds an array in an unknown way")
    return np.empty(0)


def _fill_array(array: np.ndarray, state: Any) -> None:
    _, shape, dtype, column_major, data = state
    data = _as_bytes(data)
    _check_size(data, dtype, shape)
    array.__setstate__((1, shape, dtype, column_major is True or column_major == 1, data))  # type: ignore[arg-type]


def _array_from_buffer(buffer: Any, dtype: Any, shape: Any, order: Any) -> np.ndarray:
    """Replace numpy's `_frombuffer` (pickle protocol 5)."""
    data = _as_bytes(buffer)
    _check_size(data, dtype, shape)
    if order not in ("C", "F"):
        raise _RefusedError(f"builds an array in the order {_shown(order)}")
    return np.frombuffer(data, dtype).reshape(shape, order=order) if data else np.zeros(shape, dtype)


def _scalar(dtype: Any, data: Any) -> bool | int | float:
    """Replace numpy's `scalar`. Returns a Python number."""
    data = _as_bytes(data)
    _check_size(data, dtype, ())
    return np.frombuffer(data, dtype)[0].item()


def _dtype(code: Any, *_flags: Any) -> np.dtype[Any]:
    """Replace numpy's `dtype`, for booleans, integers and floats. `_set_byte_order` may change the returned copy."""
    if type(code) is not str or not re.fullmatch(r"b1|[iu][1248]|f[248]", code):
        raise _RefusedError(f"asks for an array of dtype {_shown(code)}")
    return np.dtype(code, copy=True)


def _set_byte_order(dtype: np.dtype[Any], state: Any) -> None:
    order = state[1]
    if order not in ("<", ">", "=", "|") or any(entry is not None for entry in state[2:5]):
        raise _RefusedError("gives a dtype an unknown state")
    dtype.__setstate__((3, order, None, None, None, -1, -1, 0))  # type: ignore[attr-defined]


def _latin1(text: Any, encoding: Any) -> bytes:
    """Replace `_codecs.encode`, in the one form in which older protocols write bytes."""
    if encoding != "latin1":
        raise _RefusedError(f"calls _codecs.encode with {_shown(encoding)}")
    return _as_bytes(text)


def _empty_bytes() -> bytes:
    """Replace `bytes()`, which older protocols use for empty bytes."""
    return b""


def _shown(value: Any) -> str:
    """Format a value for a message. Only texts are shown, since nested and shared values could be endless."""
    return repr(value) if type(value) is str else f"an object of type {type(value).__name__}"


def _as_bytes(data: Any) -> bytes:
    if isinstance(data, str):  # Python 2 and the oldest protocols write bytes as text
        return data.encode("latin1")
    if isinstance(data, bytes | bytearray):
        return bytes(data)
    raise _RefusedError(f"gives a {type(data).__name__} as an array's data")


def _check_size(data: bytes, dtype: Any, shape: Any) -> None:
    if not isinstance(dtype, np.dtype):
        raise _RefusedError(f"gives a {type(dtype).__name__} as an array's dtype")
    if type(shape) is not tuple or len(shape) > 8 or any(type(size) is not int or size < 0 for size in shape):
        raise _RefusedError("gives an array an impossible shape")
    if math.prod(shape) * dtype.itemsize != len(data):
        raise _RefusedError(f"gives {len(data)} bytes for an array of {shape} {dtype} values")


_ARRAY_TYPE = object()  # represents numpy.ndarray, which is only an argument of `_reconstruct`

_GLOBALS: dict[tuple[str, str], Any] = {
    ("numpy", "ndarray"): _ARRAY_TYPE,
    ("numpy", "dtype"): _dtype,
    ("_codecs", "encode"): _latin1,
    ("__builtin__", "bytes"): _empty_bytes,
    ("builtins", "bytes"): _empty_bytes,
}
for _core in ("numpy._core", "numpy.core"):  # numpy 2's spelling and the older one
    _GLOBALS[f"{_core}.multiarray", "_reconstruct"] = _array_to_fill
    _GLOBALS[f"{_core}.multiarray", "scalar"] = _scalar
    _GLOBALS[f"{_core}.numeric", "_frombuffer"] = _array_from_buffer

_FRAMING = {"PROTO", "FRAME"}
_CONSTANTS = {
    *("NONE", "INT", "BININT", "BININT1", "BININT2", "LONG", "LONG1", "LONG4", "FLOAT", "BINFLOAT"),
    *("STRING", "BINSTRING", "SHORT_BINSTRING", "UNICODE", "SHORT_BINUNICODE", "BINUNICODE", "BINUNICODE8"),
    *("BINBYTES", "SHORT_BINBYTES", "BINBYTES8", "BYTEARRAY8"),
}
_OPERATIONS: dict[str, Callable[[_Machine, Any], None]] = {
    "NEWTRUE": lambda machine, _: machine.stack.append(True),
    "NEWFALSE": lambda machine, _: machine.stack.append(False),
    "MARK": lambda machine, _: machine.marks.append(len(machine.stack)),
    "EMPTY_LIST": lambda machine, _: machine.stack.append([]),
    "LIST": lambda machine, _: machine.stack.append(machine.take_marked()),
    "APPEND": lambda machine, _: machine.extend_list(machine.take(1)),
    "APPENDS": lambda machine, _: machine.extend_list(machine.take_marked()),
    "EMPTY_TUPLE": lambda machine, _: machine.stack.append(()),
    "TUPLE": lambda machine, _: machine.stack.append(tuple(machine.take_marked())),
    "TUPLE1": lambda machine, _: machine.stack.append(tuple(machine.take(1))),
    "TUPLE2": lambda machine, _: machine.stack.append(tuple(machine.take(2))),
    "TUPLE3": lambda machine, _: machine.stack.append(tuple(machine.take(3))),
    "EMPTY_DICT": lambda machine, _: machine.stack.append({}),
    "DICT": lambda machine, _: machine.push_dict(machine.take_marked()),
    "SETITEM": lambda machine, _: machine.extend_dict(machine.take(2)),
    "SETITEMS": lambda machine, _: machine.extend_dict(machine.take_marked()),
    "GET": _Machine.recall,
    "BINGET": _Machine.recall,
    "LONG_BINGET": _Machine.recall,
    "PUT": _Machine.memoize,
    "BINPUT": _Machine.memoize,
    "LONG_BINPUT": _Machine.memoize,
    "MEMOIZE": lambda machine, _: machine.memoize(len(machine.memo)),
    "GLOBAL": lambda machine, names: machine.push_global(*names.split(" ", 1)),
    "STACK_GLOBAL": lambda machine, _: machine.push_global(*machine.take(2)),
    "REDUCE": lambda machine, _: machine.reduce(),
    "BUILD": lambda machine, _: machine.build(),
}
