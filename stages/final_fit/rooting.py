"""The root of a body that nothing holds: labels and links have changed since projection chose it."""

from __future__ import annotations

from dataclasses import replace

import networkx as nx
import numpy as np

from stages.final_fit.working import Fit
from stages.kernels.kinematics.chain import Chain
from stages.projection.stage import middle_part


def rooted_in_the_middle(fit: Fit) -> Fit:
    """The same motions with the part in the middle of the tree for the root; a root that stands still stays it."""
    chain, tree = fit.chain, fit.chain.tree
    links = nx.Graph(list(zip(tree.parent.tolist(), tree.child.tolist(), strict=True)))
    links.add_nodes_from(range(tree.parts))
    root = middle_part(links, np.bincount(fit.labels, minlength=tree.parts))
    if root == tree.root or not tree.free_root:
        return fit
    above, part = set(), root  # the parts from the new root up to the old one, whose joints turn round
    while part != tree.root:
        above.add(part)
        part = int(tree.parents[part])
    joints = [
        replace(joint, parent=joint.child, child=joint.parent, states=-joint.states) if joint.child in above else joint
        for joint in chain.joints()
    ]
    return Fit(Chain.of(joints, root, chain.Ts[:, root], free_root=True), fit.labels)
