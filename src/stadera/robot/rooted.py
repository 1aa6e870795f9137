"""A model file with another of its links as the root: the trunk that its owner names.

Joints between the old root and the new one are turned round. A joint from P to C with the pose T at zero moves P, seen
from C, as one about its negative axis at C's origin, then T⁻¹: so C carries a link without mass by a joint of the same
name and position, and that link carries P, fixed.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stadera.errors import require_known
from stadera.inertia import InertialParameters
from stadera.robot.modelfile import FileLink, ModelFile


def rooted_at(file: ModelFile, name: str) -> ModelFile:
    """The file with a link as its root and trunk. UnknownNameError: no such link."""
    names = [link.name for link in file.links]
    require_known("link", (name,), names, file.name)
    links, child = list(file.links), names.index(name)
    up, still = links[child].parent, (np.eye(3), np.zeros(3))
    links[child] = FileLink(name, -1, *still, links[child].body, None, links[child].origin)
    while up >= 0:
        turned, at = file.links[child], child
        if (joint := turned.joint) is not None:
            around = replace(joint, axis=-joint.axis)
            links.append(FileLink(f"{joint.name}_turned_round", child, *still, InertialParameters.zero(), around))
            at = len(links) - 1
        R = turned.rotation.T
        links[up] = replace(links[up], parent=at, rotation=R, translation=-R @ turned.translation, joint=None)
        child, up = up, file.links[up].parent
    return _in_order(replace(file, trunk=name), links, names.index(name))


def _in_order(file: ModelFile, links: list[FileLink], root: int) -> ModelFile:
    """The file with these links, the root first and each after its parent."""
    order = [root]
    for k in order:
        order += [child for child, link in enumerate(links) if link.parent == k]
    places = {k: place for place, k in enumerate(order)} | {-1: -1}
    moved = tuple(replace(links[k], parent=places[links[k].parent]) for k in order)
    sites = {name: (places[k], R, p) for name, (k, R, p) in file.sites.items()}
    return replace(file, links=moved, sites=sites)
