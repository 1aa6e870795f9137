"""A robot file with joints that belong to no leg: an arm of two links, and a lidar that slides on a rail."""

from __future__ import annotations

from pathlib import Path

from stadera.robot import Robot, load_robot


def with_arm(robot: str, folder: Path, mass: float = 2.0) -> Robot:
    """A known robot by URDF, with an arm of this mass [kg] and a lidar of 0.15 times that on its trunk."""
    plain = load_robot(robot)
    assert plain.source is not None
    path = folder / f"{robot}_arm.urdf"
    path.write_text(_with_arm(plain.source.read_text(), plain.trunk, mass))
    return load_robot(path)


def _joint(name: str, parent: str, child: str, xyz: str, axis: str, kind: str = "revolute") -> str:
    return (
        f'<joint name="{name}" type="{kind}"><origin xyz="{xyz}" rpy="0.1 0 0.2"/><parent link="{parent}"/>'
        f'<child link="{child}"/><axis xyz="{axis}"/><limit lower="-2" upper="2" velocity="10" effort="50"/></joint>'
    )


def _with_arm(model: str, trunk: str, mass: float) -> str:
    """A URDF's text with the arm and the lidar."""

    def link(name: str, share: float, x: float) -> str:
        m = share * mass
        return (
            f'<link name="{name}"><inertial><origin xyz="{x} 0.01 0.02"/><mass value="{m}"/><inertia ixx="{0.002 * m}" '
            f'ixy="{0.0003 * m}" ixz="0" iyy="{0.01 * m}" iyz="0" izz="{0.01 * m}"/></inertial></link>'
        )

    arm = (
        link("upper", 0.6, 0.12)
        + link("fore", 0.4, 0.1)
        + link("lidar", 0.15, 0.02)
        + _joint("shoulder", trunk, "upper", "0.1 0 0.08", "0 1 0")
        + _joint("elbow", "upper", "fore", "0.25 0 0", "0 0.6 0.8")
        + _joint("lift", trunk, "lidar", "-0.1 0 0.1", "0 0 1", "prismatic")
    )
    return model.replace("</robot>", f"{arm}</robot>")
