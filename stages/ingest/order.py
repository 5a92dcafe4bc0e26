"""The order of frames by the numbers in their names."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal

_NUMBER = re.compile(
    r"(?:(?<![^\W_])(?<![-.)\]])[+-])?"  # a sign, unless a word ends before it
    r"(?:(?<![0-9.])[0-9]+\.([0-9]+)(?:[eE][+-][0-9]+(?![^\W_]))?(?!\.?[0-9])"  # a decimal, unlike 1.2.3
    r"|(?<![0-9.,])[0-9]+,([0-9]+)(?![.,]?[0-9])"  # with a decimal comma
    r"|(?<![^\W_])[0-9]+[eE][+-][0-9]+(?![^\W_])"  # 1e-05
    r"|[0-9]+)"
)
_WHOLE = re.compile(r"([0-9]+)")
_SHOWN = 4
Key = list[str | int | Decimal]


@dataclass(frozen=True)
class Order:
    """Names in order, and the reason to doubt that order, if there is one."""

    names: list[str]
    doubt: str = ""

    def message(self) -> str:
        """The order and its doubt, in one line."""
        shown = ", ".join(self.names[:_SHOWN])
        if len(self.names) > _SHOWN:
            shown += f", ..., {self.names[-1]}" if len(self.names) > _SHOWN + 1 else f", {self.names[-1]}"
        return f"{self.doubt}; the frames are taken in this order: {shown}; rename them by numbers if that is wrong"


def in_order(names: Sequence[str]) -> Order:
    """Sort names by the numbers in them: frame_2 before frame_10, 0.9 before 1.05, -1 before 1, 1.2.9 before 1.2.10.

    The numbers of all names are read in the same way: as decimals, unless they end like versions (1.9, 1.10).
    """
    found = [match for name in names for match in _NUMBER.finditer(name)]
    fractions = [match[1] or match[2] for match in found if match[1] or match[2]]
    padded = any(len(fraction) > 1 and fraction.endswith("0") for fraction in fractions)
    uneven = padded and len(set(map(len, fractions))) > 1
    surely_decimal = any(len(fraction) > 1 and fraction.startswith("0") for fraction in fractions)
    as_versions = uneven and not surely_decimal
    whole = sorted(names, key=natural_key)
    decimal = sorted(names, key=lambda name: (_key(name), name))
    ordered = whole if as_versions else decimal
    doubt = _doubt({name: _key(name) for name in ordered})
    differ = fractions and whole != decimal and (uneven or not surely_decimal)
    if not doubt and (differ or any(match[2] for match in found)):
        doubt = f"the numbers in the names are taken for {'versions' if as_versions else 'decimals'}"
    return Order(ordered, doubt)


def natural_key(name: str) -> tuple[Key, str]:
    """The sort key of natural order for whole numbers, which puts frame_2 before frame_10."""
    return _whole_key(name), name


def _whole_key(name: str) -> Key:
    pieces = _WHOLE.split(name)  # text and digits alternate, so that only like pieces are compared
    return [int(piece) if index % 2 else piece.casefold() for index, piece in enumerate(pieces)]


def _key(name: str) -> Key:
    key: Key = []
    end = 0
    for match in _NUMBER.finditer(name):
        key += [name[end : match.start()].casefold(), Decimal(match[0].replace(",", "."))]
        end = match.end()
    return [*key, name[end:].casefold()]


def _texts(name: str) -> list[str]:
    return [match[0] for match in _NUMBER.finditer(name)]


def _unevenly_padded(texts: list[str]) -> bool:
    """Whether some numbers begin with zeros and others are shorter, as 05 and 2. They may be decimal places."""
    padded = [len(text) for text in texts if re.fullmatch("0[0-9]+", text)]
    return bool(padded) and min(map(len, texts)) < max(padded)


def _doubt(keys: dict[str, Key]) -> str:
    """A reason to doubt the order of names; empty if there is none."""
    if len(keys) < 2:
        return ""
    numbers = [tuple(key[1::2]) for key in keys.values()]
    if len({tuple(key[::2]) for key in keys.values()}) > 1:
        return "the names differ in more than their numbers"
    if not numbers[0]:
        return "the names hold no numbers"
    if len(set(numbers)) < len(numbers):
        return "two names hold the same number"
    varied = [place for place, values in enumerate(zip(*numbers, strict=True)) if len(set(values)) > 1]
    between = "".join(map(str, next(iter(keys.values()))[2 * varied[0] + 2 : 2 * varied[-1] + 1 : 2]))
    if re.search(r"[^\W\d_TtZz]", between):  # 2024-01-02T10-11-12 is one number
        return "several numbers in the names vary"
    if any(_unevenly_padded([texts[place] for texts in map(_texts, keys)]) for place in varied if place > 0):
        return "some later numbers in the names begin with zeros"
    if all(Decimal(values[varied[0]]) < 0 for values in numbers):
        return "a minus in the names is taken for a sign"
    return ""
