"""Arms and scenarios of the explorer's tests."""

from __future__ import annotations

from pathlib import Path

import bumpstop as bs
from bumpstop.model import Joint, Robot

ROOT = Path(__file__).resolve().parents[2]
LOWER_ARM = ROOT / "examples" / "02_lower_arm_downward.toml"
HAND = bs.load_scenario(ROOT / "examples" / "01_hand_downward.toml")


def twelve_joints() -> Robot:
    """A snake of twelve joints."""
    joints = tuple(
        Joint(
            name=f"j{j}",
            link=f"l{j}",
            kind="revolute",
            origin=(0.0, 0.0, 0.12),
            axis=(0.0, 1.0, 0.0) if j % 2 else (0.0, 0.0, 1.0),
            lower=-2.0,
            upper=2.0,
            velocity=2.0,
        )
        for j in range(12)
    )
    return Robot(name="snake", joints=joints, tip_origin=(0.0, 0.0, 0.1))


def urdf_of_twelve_joints() -> str:
    """The same as URDF."""
    links = "".join(f'<link name="l{j}"/>' for j in range(12))
    joints = "".join(
        f'<joint name="j{j}" type="revolute"><parent link="{f"l{j - 1}" if j else "base"}"/><child link="l{j}"/>'
        f'<origin xyz="0 0 0.12"/><axis xyz="0 {j % 2} {1 - j % 2}"/>'
        '<limit lower="-2" upper="2" velocity="2" effort="80"/></joint>'
        for j in range(12)
    )
    return f'<robot name="snake"><link name="base"/>{links}{joints}</robot>'
