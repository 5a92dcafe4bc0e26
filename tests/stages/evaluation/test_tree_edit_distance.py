from __future__ import annotations

import time
from collections.abc import Iterator
from functools import cache
from itertools import combinations_with_replacement

import numpy as np
import pytest

from stages.evaluation.tree_edit_distance import unordered_tree_edit_distance


def parents(shape: tuple) -> np.ndarray:
    """The parents array of a tree written as the tuple of the trees below its root."""
    found: list[int] = []

    def visit(tree: tuple, parent: int) -> None:
        node = len(found)
        found.append(parent)
        for child in tree:
            visit(child, node)

    visit(shape, -1)
    return np.array(found)


def trees(nodes: int) -> set[tuple]:
    """All shapes of rooted trees with so many nodes: every smaller shape with a leaf added anywhere."""

    def grown(tree: tuple) -> Iterator[tuple]:
        yield tuple(sorted((*tree, ())))
        for i, child in enumerate(tree):
            for larger in grown(child):
                yield tuple(sorted((*tree[:i], larger, *tree[i + 1 :])))

    return {()} if nodes == 1 else {larger for tree in trees(nodes - 1) for larger in grown(tree)}


@cache
def after_deletions(forest: tuple) -> tuple[frozenset, ...]:
    """By number of deleted nodes, all forests that remain."""

    def deleted(forest: tuple) -> Iterator[tuple]:
        for i, tree in enumerate(forest):
            rest = forest[:i] + forest[i + 1 :]
            yield tuple(sorted(rest + tree))
            for smaller in deleted(tree):
                yield tuple(sorted((*rest, smaller)))

    levels = [frozenset([forest])]
    while () not in levels[-1]:
        levels.append(frozenset(smaller for larger in levels[-1] for smaller in deleted(larger)))
    return tuple(levels)


def brute_force_distance(a: tuple, b: tuple) -> int:
    """The fewest deletions from both that leave the same forest."""
    levels_a, levels_b = after_deletions((a,)), after_deletions((b,))
    return min(i + j for i, x in enumerate(levels_a) for j, y in enumerate(levels_b) if x & y)


def random_tree(rng: np.random.Generator, nodes: int) -> np.ndarray:
    """A random tree of one of the families: recursive, caterpillar, spider, balanced, stringy, star."""
    family = rng.integers(6)
    spine, legs, arity = int(rng.integers(2, nodes)), int(rng.integers(1, 8)), int(rng.integers(2, 4))
    reach = int(rng.integers(1, 7))
    parent_of = [
        lambda i: int(rng.integers(i)),
        lambda i: i - 1 if i < spine else int(rng.integers(spine)),
        lambda i: max(0, i - legs),
        lambda i: (i - 1) // arity,
        lambda i: max(0, i - 1 - int(rng.integers(reach))),
        lambda i: 0,
    ][family]
    return np.array([-1] + [parent_of(i) for i in range(1, nodes)])


def renumbered(rng: np.random.Generator, tree: np.ndarray) -> np.ndarray:
    order = rng.permutation(len(tree))
    shuffled = np.empty_like(tree)
    shuffled[order] = np.where(tree < 0, -1, order[tree])
    return shuffled


def test_equals_brute_force_on_all_pairs_of_trees_up_to_six_nodes() -> None:
    shapes = [shape for nodes in range(1, 7) for shape in sorted(trees(nodes))]
    assert len(shapes) == 1 + 1 + 2 + 4 + 9 + 20
    for a, b in combinations_with_replacement(shapes, 2):
        assert unordered_tree_edit_distance(parents(a), parents(b)) == brute_force_distance(a, b), (a, b)


def test_renumbering_nodes_changes_nothing() -> None:
    rng = np.random.default_rng(0)
    for _ in range(30):
        a, b = random_tree(rng, 12), random_tree(rng, 15)
        assert unordered_tree_edit_distance(a, renumbered(rng, a)) == 0
        distance = unordered_tree_edit_distance(a, b)
        assert distance == unordered_tree_edit_distance(renumbered(rng, b), renumbered(rng, a))


def test_removing_a_leaf_costs_one() -> None:
    rng = np.random.default_rng(1)
    for _ in range(30):
        tree = random_tree(rng, 14)  # in every family the last node is a leaf
        assert unordered_tree_edit_distance(tree, tree[:-1]) == 1


@pytest.mark.parametrize("nodes", [1, 2, 7, 20])
def test_a_single_node_is_all_other_nodes_away(nodes: int) -> None:
    tree = random_tree(np.random.default_rng(nodes), nodes) if nodes > 2 else np.arange(-1, nodes - 1)
    assert unordered_tree_edit_distance(np.array([-1]), tree) == nodes - 1


def test_a_star_and_a_path_share_two_nodes() -> None:
    star, path = np.array([-1] + [0] * 9), np.arange(-1, 9)
    assert unordered_tree_edit_distance(star, path) == 2 * 8


def test_triangle_inequality() -> None:
    rng = np.random.default_rng(2)
    for _ in range(40):
        a, b, c = (random_tree(rng, int(rng.integers(3, 14))) for _ in range(3))
        ab, bc, ac = (unordered_tree_edit_distance(*pair) for pair in ((a, b), (b, c), (a, c)))
        assert ac <= ab + bc


def test_twenty_nodes_take_less_than_a_second() -> None:
    rng = np.random.default_rng(3)
    for _ in range(100):
        a, b = random_tree(rng, 20), random_tree(rng, 20)
        started = time.process_time()
        unordered_tree_edit_distance(a, b)
        assert time.process_time() - started < 1, (a, b)


@pytest.mark.parametrize("wrong", [[-1, -1], [1, 0], [-1, 2, 1], [-1, 7]])
def test_refuses_what_is_not_one_tree(wrong: list[int]) -> None:
    with pytest.raises(ValueError, match="parents: "):
        unordered_tree_edit_distance(np.array(wrong), np.array([-1]))
