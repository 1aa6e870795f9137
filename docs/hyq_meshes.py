"""Makes hyq.json, the meshes of HyQ for the demo's scene, from example-robot-data: python docs/hyq_meshes.py SHARE

SHARE is the folder share/ that contains example-robot-data/. A mesh is stored as triangles of 16-bit integers in
base64: corners between the least and greatest value of each coordinate, with an error of at most 10 µm, and the three
corners of each face. Parts above the back are left out (the frame that protects HyQ when it rolls over), because the
plant has a plate there, on which boxes land.
"""

from __future__ import annotations

import json
import sys
from base64 import b64encode
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

BACK = 0.105  # m, above the trunk's origin: slightly above the highest point of the body
MOST = 65535


def packed(corners: np.ndarray, faces: np.ndarray) -> dict[str, Any]:
    """Corners (k, 3) [m] and faces (n, 3), without corners that belong to no face."""
    used, faces = np.unique(faces, return_inverse=True)
    corners = corners[used]
    low, high = corners.min(axis=0), corners.max(axis=0)
    step = (high - low) / MOST
    shares = np.rint((corners - low) / step).astype("<u2")
    text = {"corners": shares, "faces": faces.reshape(-1, 3).astype("<u2")}
    return {"low": low.tolist(), "step": step.tolist()} | {k: b64encode(v.tobytes()).decode() for k, v in text.items()}


def main(share: Path) -> None:
    """Writes hyq.json into the package."""
    urdf = share / "example-robot-data/robots/hyq_description/robots/hyq_no_sensors.urdf"
    model = pin.buildModelFromUrdf(str(urdf), pin.JointModelFreeFlyer())
    shapes = pin.GeometryModel()
    pin.buildGeomFromUrdf(model, str(urdf), pin.GeometryType.VISUAL, shapes, [str(share)])
    meshes, parts = {}, []
    for shape in shapes.geometryObjects:
        if not shape.meshPath.endswith(".dae"):
            continue
        name, geometry = Path(shape.meshPath).stem, shape.geometry
        corners = np.array(geometry.vertices())
        faces = np.array([[geometry.tri_indices(k)[c] for c in range(3)] for k in range(geometry.num_tris)])
        if name == "trunk":
            faces = faces[corners[faces][:, :, 2].max(axis=1) < BACK]
        meshes[name] = packed(corners, faces)
        turn = Rotation.from_matrix(shape.placement.rotation).as_quat()
        joint = model.names[shape.parentJoint]
        place = {"at": shape.placement.translation.round(6).tolist(), "turn": turn.round(9).tolist()}
        parts.append({"joint": None if joint == "root_joint" else joint, "mesh": name, **place})
    found = json.dumps({"meshes": meshes, "parts": parts}, separators=(",", ":"))
    vendor = Path(__file__).parent.parent / "src/stadera/lab/report/vendor"
    (vendor / "hyq.json").write_text(found + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
