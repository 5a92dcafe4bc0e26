"""The exact edit distance of unordered rooted trees whose nodes carry no labels.

Renaming costs nothing, so only shapes count, and the distance is n + m - 2 M with M the most nodes that
can be matched one to one such that a is above b exactly where a's match is above b's (Tai, 1979). The
problem is NP-hard; the recursion below is exponential, yet fast for the few dozen parts of an object:
it is memoised on shapes and cut off by a bound that is nearly always tight.

A forest is the sorted tuple of its trees, and a tree is written as the forest below its root: the single
node is `()`, and the forest of one single node `((),)`.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from typing import TypeAlias

import numpy as np
from jaxtyping import Int64

Forest: TypeAlias = "tuple[Forest, ...]"
Pair: TypeAlias = "tuple[Forest, Forest]"


def unordered_tree_edit_distance(
    parents_a: Int64[np.ndarray, "nodes_a"], parents_b: Int64[np.ndarray, "nodes_b"]
) -> int:
    """The fewest insertions and deletions of nodes that make one tree's shape the other's (A.9).

    `parents[i]` is the parent of node i, -1 for the root. Children have no order; deleting a node hands
    its children to its parent. Raises ValueError where `parents` is not one rooted tree.
    """
    tree_a, tree_b = _shape(parents_a), _shape(parents_b)
    # Some best match pairs the roots: moving a root's partner up to the other root breaks no relation.
    matched = 1 + _Matcher().most_matched(tree_a, tree_b)
    return len(parents_a) + len(parents_b) - 2 * matched


def _shape(parents: Int64[np.ndarray, "nodes"]) -> Forest:
    """The canonical shape of a tree: the forest below its root."""
    children: dict[int, list[int]] = {}
    for node, parent in enumerate(parents.tolist()):
        children.setdefault(parent, []).append(node)

    def below(node: int) -> Forest:
        return tuple(sorted(below(child) for child in children.get(node, ())))

    roots = children.get(-1, [])
    if len(roots) != 1:
        raise ValueError(f"parents: found {len(roots)} roots (entries of -1), expected exactly one")
    shape = below(roots[0])
    if _size(shape) != len(parents):
        raise ValueError(f"parents: {len(parents) - _size(shape)} nodes do not hang on the root, expected a tree")
    return shape


class _Matcher:
    """The most nodes of two forests that can be matched, memoised on the forests' shapes."""

    def __init__(self) -> None:
        self.known: dict[Pair, int] = {}

    def most_matched(self, a: Forest, b: Forest) -> int:
        if a > b:
            a, b = b, a
        if (a, b) not in self.known:
            self.known[a, b] = self._search(a, b)
        return self.known[a, b]

    def _search(self, a: Forest, b: Forest) -> int:
        """Branch on the largest tree's root: it stays unmatched, or is matched with some node of the other forest."""
        if not a or not b:
            return 0
        if max(map(_size, b)) > max(map(_size, a)):
            a, b = b, a
        tree = max(a, key=lambda t: (_size(t), t))
        rest = _without(a, tree)
        bound = _bound(a, b)
        options: list[tuple[int, Pair, Pair]] = [(0, (_union(rest, tree), b), ((), ()))]
        options += [(1, (rest, other), (tree, below)) for below, other in _splits(b)]
        ranked = sorted(((gain + _bound(*p) + _bound(*q), gain, p, q) for gain, p, q in set(options)), reverse=True)
        best = 0
        for optimistic, gain, p, q in ranked:
            if optimistic <= best or best == bound:
                break
            best = max(best, gain + self.most_matched(*p) + self.most_matched(*q))
        return best


@lru_cache(maxsize=65536)
def _splits(forest: Forest) -> frozenset[Pair]:
    """(what is below, what is neither below nor above) for every node of the forest."""
    return frozenset(_each_split(forest))


def _each_split(forest: Forest) -> Iterator[Pair]:
    for tree in set(forest):
        rest = _without(forest, tree)
        yield tree, rest
        for below, other in _splits(tree):
            yield below, _union(rest, other)


@lru_cache(maxsize=65536)
def _size(tree: Forest) -> int:
    return 1 + sum(map(_size, tree))


@lru_cache(maxsize=65536)
def _long_paths(forest: Forest) -> tuple[int, ...]:
    """Path lengths, longest first, when each node's path goes on to its deepest child and the others start anew."""
    lengths: list[int] = []
    for tree in forest:
        longest, *others = _long_paths(tree) or (0,)
        lengths += [longest + 1, *others]
    return tuple(sorted(lengths, reverse=True))


def _bound(a: Forest, b: Forest) -> int:
    """An upper bound: deleting a node shortens exactly one of the long paths, by one, so those of the matched
    nodes are no longer, path by path, than those of either forest."""
    return sum(map(min, _long_paths(a), _long_paths(b)))


def _without(forest: Forest, tree: Forest) -> Forest:
    index = forest.index(tree)
    return forest[:index] + forest[index + 1 :]


def _union(a: Forest, b: Forest) -> Forest:
    return tuple(sorted(a + b))
