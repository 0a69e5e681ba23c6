"""Robots with inertia and their models in Pinocchio and MuJoCo, for the tests of dynamics and for the benchmark."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt
import pinocchio as pin

from bumpstop.model import Joint, LinkInertia, Robot

Floats = npt.NDArray[np.float64]


def random_inertia(rng: np.random.Generator, size: float = 0.3) -> LinkInertia:
    """Inertia of six point masses: a body can have it, and no entry of it is zero."""
    points, mass = rng.uniform(-size, size, (6, 3)), rng.uniform(0.1, 2.0, 6)
    center = mass @ points / mass.sum()
    arms = points - center
    tensor = sum(m * (r @ r * np.eye(3) - np.outer(r, r)) for m, r in zip(mass, arms, strict=True))
    rows = [tuple(row) for row in np.asarray(tensor).tolist()]
    x, y, z = center.tolist()
    return LinkInertia(mass=float(mass.sum()), center=(x, y, z), tensor=(rows[0], rows[1], rows[2]))


def with_inertia(robot: Robot, rng: np.random.Generator) -> Robot:
    """The same robot with random inertia where it has none, and with rotors."""
    joints = [
        replace(joint, inertia=joint.inertia or random_inertia(rng), rotor_inertia=float(rng.uniform(0.1, 2.0)))
        for joint in robot.joints
    ]
    return replace(robot, joints=tuple(joints))


def general_arm() -> Robot:
    """The arm of benchmarks/dynamics.cpp: seven joints, nothing zero, no two axes parallel."""
    joints = []
    for i in range(7):
        a, b = 0.3 + 0.9 * i, 0.7 + 1.3 * i
        inertia = LinkInertia(
            mass=5 - 0.6 * i,
            center=(0.01 + 0.01 * i, 0.02 - 0.015 * i, 0.1 - 0.01 * i),
            tensor=((0.05, 0.004, -0.003), (0.004, 0.06, 0.005), (-0.003, 0.005, 0.03)),
        )
        axis = (float(np.sin(a) * np.cos(b)), float(np.sin(a) * np.sin(b)), float(np.cos(a)))
        origin = (0.05 + 0.02 * i, 0.03 * (i % 3) - 0.02, 0.2 - 0.01 * i)
        joints.append(Joint(name=f"j{i}", link=f"l{i}", origin=origin, axis=axis, inertia=inertia, rotor_inertia=0.1))
    return Robot(name="general", joints=tuple(joints))


def pinocchio_model(robot: Robot) -> Any:
    """Without rotors, which every use adds by hand."""
    model = pin.Model()
    parent = 0
    for joint in robot.joints:
        kind = pin.JointModelPrismaticUnaligned if joint.kind == "prismatic" else pin.JointModelRevoluteUnaligned
        placement = pin.SE3(np.array(joint.rotation), np.array(joint.origin))
        parent = model.addJoint(parent, kind(np.array(joint.axis)), placement, joint.name)
        link = joint.inertia
        assert link is not None
        body = pin.Inertia(link.mass, np.array(link.center), np.array(link.tensor))
        model.appendBodyToJoint(parent, body, pin.SE3.Identity())
    return model


def mujoco_model(robot: Robot, gravity: Floats) -> Any:
    """With rotors, as MuJoCo's armature."""
    spec = mujoco.MjSpec()
    spec.option.gravity = gravity
    body = spec.worldbody
    for joint in robot.joints:
        link = joint.inertia
        assert link is not None
        quaternion = np.empty(4)
        mujoco.mju_mat2Quat(quaternion, np.ravel(joint.rotation))
        (xx, xy, xz), (_, yy, yz), (_, _, zz) = link.tensor
        body = body.add_body(
            name=joint.link,
            pos=joint.origin,
            quat=quaternion,
            mass=link.mass,
            ipos=link.center,
            fullinertia=[xx, yy, zz, xy, xz, yz],
            explicitinertial=True,
        )
        kind = mujoco.mjtJoint.mjJNT_SLIDE if joint.kind == "prismatic" else mujoco.mjtJoint.mjJNT_HINGE
        body.add_joint(type=kind, axis=joint.axis, armature=joint.rotor_inertia)
    return spec.compile()
