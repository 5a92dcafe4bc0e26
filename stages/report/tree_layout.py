"""Layout of a drawn tree."""

from __future__ import annotations

from collections.abc import Iterable

import networkx as nx
import numpy as np


def tree_layout(links: Iterable[tuple[int, int]], root: int) -> dict[int, tuple[float, int]]:
    """The position (x, depth) of each node: leaves side by side, each parent above the middle of its children.

    `links` are pairs (parent, child) of a tree. No lines cross. x is between 1 and the number of leaves.
    """
    graph = nx.DiGraph()
    graph.add_node(root)
    graph.add_edges_from(links)
    depth = nx.shortest_path_length(graph, root)
    layout: dict[int, tuple[float, int]] = {}
    leaves = 0
    for node in nx.dfs_postorder_nodes(graph, root):
        children = list(graph.successors(node))
        if not children:
            leaves += 1
        x = float(np.mean([layout[child][0] for child in children])) if children else float(leaves)
        layout[node] = (x, depth[node])
    return layout
