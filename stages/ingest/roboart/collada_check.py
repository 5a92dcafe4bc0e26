"""A check of the size to which a COLLADA file unfolds. A few lines can expand to any amount of memory."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field
from xml.etree import ElementTree


def check_collada(content: bytes, most: int) -> None:
    """Raise ValueError for a file that declares a document type, or unfolds to more than `most` characters of indices.

    Raises ElementTree.ParseError for a file that is not XML, such as an archive.
    """
    survey = _Survey()
    parser = ElementTree.XMLParser(target=survey)
    parser.feed(content)
    parser.close()
    if survey.corners > survey.characters:
        raise ValueError(f"found polygons of {survey.corners} corners, expected as many as there are indices")
    if (unfolded := survey.unfolded(survey.whole)) > most:
        raise ValueError(f"found nodes that repeat each other {unfolded / len(content):.3g} times the file's size")


@dataclass(eq=False)
class _Piece:
    """A geometry, a node, or the whole: the characters of its own indices, its nested pieces, and its references."""

    characters: int = 1  # an empty piece costs time, too
    inside: list[_Piece] = field(default_factory=list)
    named: list[str] = field(default_factory=list)
    unfolded: int = -1


class _Survey:
    """The target of an XML parser, which keeps only the sizes of elements."""

    def __init__(self) -> None:
        self.whole = _Piece()
        self.open = [self.whole]
        self.by_name: dict[str, list[_Piece]] = defaultdict(list)
        self.text: list[str] = []
        self.characters = 0
        self.corners = 0

    def doctype(self, name: str, pubid: str | None, system: str | None) -> None:
        raise ValueError("found a document type declaration, <!DOCTYPE>, expected none")

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        self.text = []
        name = _local(tag)
        if name in ("geometry", "node"):
            piece = _Piece()
            self.open[-1].inside.append(piece)
            self.open.append(piece)
            self.by_name[attributes.get("id", "")].append(piece)
        elif name in ("instance_geometry", "instance_node"):
            self.open[-1].named.append(attributes.get("url", "").removeprefix("#"))

    def data(self, text: str) -> None:
        self.text.append(text)

    def end(self, tag: str) -> None:
        name, text = _local(tag), self.text
        self.text = []
        if name in ("geometry", "node"):
            self.open.pop()
        elif name == "p":
            characters = sum(map(len, text))
            self.open[-1].characters += characters
            self.characters += characters
        elif name == "vcount":
            counts = [int(word) for word in "".join(text).split()]
            self.corners += sum(map(abs, counts))

    def close(self) -> None:
        """Finish, as an XML parser's target must."""

    def unfolded(self, piece: _Piece) -> int:
        """The characters of a piece and of all nested and referenced pieces, counted at every repetition."""
        if piece.unfolded < 0:
            piece.unfolded = 0  # if it refers to itself
            repeated = [*piece.inside, *(found for name in piece.named for found in self.by_name.get(name, ()))]
            piece.unfolded = piece.characters + sum(self.unfolded(one) for one in repeated)
        return piece.unfolded


def _local(tag: str) -> str:
    """An element's name without its namespace."""
    return tag.rpartition("}")[2]
