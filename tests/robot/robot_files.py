"""Small robot files for tests, made in memory: a quadruped whose parts can be bent one at a time."""

from __future__ import annotations

from pathlib import Path

CORNERS = {"LF": (0.3, 0.2), "RF": (0.3, -0.2), "LH": (-0.3, 0.2), "RH": (-0.3, -0.2)}


def urdf_link(name: str, mass: float | str = 1.0, extra: str = "") -> str:
    return (
        f'<link name="{name}"><inertial><origin xyz="0 0 -0.1"/><mass value="{mass}"/>'
        f'<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.005"/></inertial>{extra}</link>'
    )


def urdf_joint(name: str, parent: str, child: str, xyz: str, axis: str, kind: str = "revolute") -> str:
    limit = '<limit lower="-2" upper="2" velocity="10" effort="50"/>' if kind in ("revolute", "prismatic") else ""
    return (
        f'<joint name="{name}" type="{kind}"><origin xyz="{xyz}"/><parent link="{parent}"/><child link="{child}"/>'
        f'<axis xyz="{axis}"/>{limit}</joint>'
    )


SPHERE = '<collision><origin xyz="0 0 -0.3"/><geometry><sphere radius="0.02"/></geometry></collision>'


def urdf_leg(
    prefix: str, corner: tuple[float, float], shank: str = SPHERE, knee: str = "revolute", mass: float | str = 1.0
) -> str:
    x, y = corner
    side = 0.05 if y > 0 else -0.05
    return (
        urdf_joint(f"{prefix}_a", "base", f"{prefix}_hip", f"{x} {y} 0", "1 0 0")
        + urdf_link(f"{prefix}_hip")
        + urdf_joint(f"{prefix}_b", f"{prefix}_hip", f"{prefix}_thigh", f"0 {side} 0", "0 1 0")
        + urdf_link(f"{prefix}_thigh")
        + urdf_joint(f"{prefix}_c", f"{prefix}_thigh", f"{prefix}_shank", "0 0 -0.3", "0 1 0", knee)
        + urdf_link(f"{prefix}_shank", mass, shank)
    )


def urdf(legs: str, trunk: str = urdf_link("base", 20.0), extra: str = "") -> str:
    return f'<?xml version="1.0"?>\n<robot name="toy">{trunk}{legs}{extra}</robot>'


def quadruped(**changes: str) -> str:
    """The toy quadruped; keys are leg names, values replace that leg's text."""
    return urdf("".join(changes.get(name, urdf_leg(name.lower(), corner)) for name, corner in CORNERS.items()))


RIM = (
    '<collision><origin xyz="0 0.02 0" rpy="1.5707963 0 0"/><geometry><cylinder radius="0.07" length="0.04"/>'
    "</geometry></collision>"
)


def wheeled(wheel: str = RIM, name: str = "roll", kind: str = "continuous") -> str:
    """The toy quadruped with wheels on its shanks, off the middle of their axles; links of that name, and joints."""
    legs = "".join(
        urdf_leg(leg.lower(), corner, "")
        + urdf_joint(f"{leg}_d", f"{leg.lower()}_shank", f"{leg}_{name}", "0 0 -0.3", "0 1 0", kind)
        + urdf_link(f"{leg}_{name}", 0.5, wheel)
        for leg, corner in CORNERS.items()
    )
    return urdf(legs)


def write(folder: Path, text: str, name: str = "toy.urdf") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def mjcf_leg(name: str, corner: tuple[float, float]) -> str:
    """A leg whose joints have anchors off their bodies' origins, references off zero and an oblique axis."""
    x, y = corner
    return f"""
    <body name="{name}_hip" pos="{x} {y} 0" euler="5 0 0" childclass="limb">
      <joint name="{name}_a" pos="0.01 0.02 0.03" axis="1 0 0" ref="20" range="-60 60" class="weak"/>
      <inertial pos="0.01 0.02 0" mass="1.5" fullinertia="0.01 0.02 0.015 0.001 0.002 0.003"/>
      <body name="{name}_thigh" pos="0 {0.1 if y > 0 else -0.1} 0">
        <joint name="{name}_b" axis="0.1 -1 0" range="-120 120"/>
        <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.03"/>
        <body name="{name}_shank" pos="0 0 -0.3">
          <joint name="{name}_c" pos="0.01 0 0" axis="0 -1 0" range="-150 150" frictionloss="0.3"/>
          <geom type="box" size="0.02 0.02 0.14" pos="0 0 -0.14"/>
          <body name="{name}_pad" pos="0 0 -0.3"><geom size="0.025" mass="0.1"/><site name="{name}_toe"/></body>
        </body>
      </body>
    </body>"""


def mjcf(include: str = "") -> str:
    """A toy quadruped in MJCF that uses defaults, degrees and, if given, an include instead of its legs."""
    legs = include or "".join(mjcf_leg(name, corner) for name, corner in CORNERS.items())
    motors = "".join(f'<motor joint="{n}_{j}" gear="2" ctrlrange="-15 15"/>' for n in CORNERS for j in "abc")
    return f"""<mujoco model="toy">
  <!-- a remark to be kept -->
  <compiler angle="degree" autolimits="true"/>
  <default><default class="limb"><joint damping="0.4" armature="0.02"/><default class="weak"><joint armature="0.5"/>
  </default></default></default>
  <worldbody><geom type="plane" size="1 1 1"/>
  <body name="torso" pos="0 0 0.8"><freejoint/><geom type="box" size="0.3 0.15 0.1"/><site name="imu" pos="0.1 0 0"/>
  {legs}
  </body></worldbody>
  <actuator>{motors}</actuator>
</mujoco>"""
