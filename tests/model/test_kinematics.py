"""Poses and Jacobians by three other routes: products of matrices, Pinocchio and MuJoCo; and what goes in and out."""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np
import numpy.typing as npt
import pinocchio as pin
import pytest

from bumpstop import _native
from bumpstop.errors import InputError
from bumpstop.model import Joint, Robot, robots
from model.random_chains import Floats, positions, random_robots, rows, turn, unit

# Numbers of a link's pose (N, 4, 4) and Jacobian (N, 6, dof) at a point of it.
Kinematics = tuple[Floats, Floats]

TARGETS = _native.available_targets()
IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


# --- The other routes -------------------------------------------------------------------------------------------------


def by_matrices(robot: Robot, q: Floats, link: int, point: Floats) -> Kinematics:
    """Products of homogeneous matrices, and their derivatives by a complex step, which has no cancellation."""
    step = 1e-30

    def transform(angles: npt.NDArray[np.complex128]) -> npt.NDArray[np.complex128]:
        x = np.eye(4, dtype=np.complex128)
        for joint, value in zip(robot.joints[: link + 1], angles, strict=False):
            placement, motion = np.eye(4, dtype=np.complex128), np.eye(4, dtype=np.complex128)
            placement[:3, :3], placement[:3, 3] = joint.rotation, joint.origin
            if joint.kind == "prismatic":
                motion[:3, 3] = np.array(joint.axis) * value
            else:
                motion[:3, :3] = turn(joint.axis, value)
            x = x @ placement @ motion
        x[:3, 3] += x[:3, :3] @ point
        return x

    poses = np.array([transform(row.astype(np.complex128)).real for row in q])
    jacobians = np.zeros((len(q), 6, robot.dof))
    for pose, jacobian, row in zip(poses, jacobians, q, strict=True):
        for j in range(robot.dof):
            ahead = row.astype(np.complex128)
            ahead[j] += 1j * step
            slope = transform(ahead).imag / step
            spin = slope[:3, :3] @ pose[:3, :3].T  # the skew matrix of the angular velocity
            jacobian[:, j] = *slope[:3, 3], spin[2, 1], spin[0, 2], spin[1, 0]
    return poses, jacobians


def by_pinocchio(robot: Robot, q: Floats, link: int, point: Floats) -> Kinematics:
    model = pin.Model()
    parent = 0
    for joint in robot.joints:
        kind = pin.JointModelPrismaticUnaligned if joint.kind == "prismatic" else pin.JointModelRevoluteUnaligned
        placement = pin.SE3(np.array(joint.rotation), np.array(joint.origin))
        parent = model.addJoint(parent, kind(np.array(joint.axis)), placement, joint.name)
    place = pin.SE3(np.eye(3), point)
    frame = model.addFrame(pin.Frame("point", link + 1, place, pin.FrameType.OP_FRAME))
    data = model.createData()
    poses, jacobians = [], []
    for row in q:
        jacobian = pin.computeFrameJacobian(model, data, row, frame, pin.LOCAL_WORLD_ALIGNED)
        jacobians.append(jacobian.reshape(6, robot.dof).copy())
        pin.framesForwardKinematics(model, data, row)
        poses.append(data.oMf[frame].homogeneous.copy())
    return np.array(poses), np.array(jacobians)


def by_mujoco(robot: Robot, q: Floats, link: int, point: Floats) -> Kinematics:
    spec = mujoco.MjSpec()
    body = spec.worldbody
    for i, joint in enumerate(robot.joints):
        quaternion = np.empty(4)
        mujoco.mju_mat2Quat(quaternion, np.ravel(joint.rotation))
        body = body.add_body(pos=joint.origin, quat=quaternion, mass=1e-3, inertia=[1e-6] * 3, explicitinertial=True)
        kind = mujoco.mjtJoint.mjJNT_SLIDE if joint.kind == "prismatic" else mujoco.mjtJoint.mjJNT_HINGE
        body.add_joint(type=kind, axis=joint.axis)
        if i == link:
            body.add_site(name="point", pos=point)
    model = spec.compile()
    data = mujoco.MjData(model)
    site = model.site("point").id
    poses, jacobians = np.zeros((len(q), 4, 4)), np.zeros((len(q), 6, robot.dof))
    for pose, jacobian, row in zip(poses, jacobians, q, strict=True):
        data.qpos[:] = row
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        pose[:3, :3], pose[:3, 3], pose[3, 3] = data.site_xmat[site].reshape(3, 3), data.site_xpos[site], 1.0
        mujoco.mj_jacSite(model, data, jacobian[:3], jacobian[3:], site)
    return poses, jacobians


ROUTES = {"matrices": by_matrices, "pinocchio": by_pinocchio, "mujoco": by_mujoco}
Route = Callable[[Robot, Floats, int, Floats], Kinematics]


def reach(robot: Robot, q: Floats, point: Floats) -> float:
    """No point of the chain is farther from the base than this [m]; lengths are compared on this scale."""
    lengths = [float(np.linalg.norm(joint.origin)) for joint in robot.joints]
    slides = [float(np.abs(q[:, j]).max()) for j, joint in enumerate(robot.joints) if joint.kind == "prismatic"]
    return 1.0 + sum(lengths) + sum(slides) + float(np.linalg.norm(point))


def assert_close(one: Kinematics, other: Kinematics, scale: float, relative: float) -> None:
    for a, b in zip(one, other, strict=True):
        assert a.shape == b.shape
        assert np.abs(a - b).max() <= relative * scale


@pytest.mark.parametrize("route", ROUTES.values(), ids=ROUTES)
@pytest.mark.parametrize("name", robots())
def test_builtin_robots(name: str, route: Route) -> None:
    robot = Robot.load(name)
    rng = np.random.default_rng(2)
    q = positions(robot, 200 if route is by_matrices else 1000, rng)
    tip = np.array(robot.tip_origin)
    known = route(robot, q, robot.dof - 1, tip)
    assert_close((robot.pose(q), robot.jacobian(q)), known, reach(robot, q, tip), 1e-10)
    for link in range(robot.dof):
        point = rng.uniform(-0.3, 0.3, 3)
        known = route(robot, q[:20], link, point)
        link_name = robot.joints[link].link
        found = robot.pose(q[:20], link_name, point), robot.jacobian(q[:20], link_name, point)
        assert_close(found, known, reach(robot, q, point), 1e-10)


@pytest.mark.parametrize("route", ROUTES.values(), ids=ROUTES)
def test_random_chains(route: Route) -> None:
    rng = np.random.default_rng(3)
    for robot in random_robots():
        q = positions(robot, 5, rng)
        for link in {robot.dof - 1, int(rng.integers(robot.dof))}:
            point = rng.uniform(-1, 1, 3)
            link_name = robot.joints[link].link
            found = robot.pose(q, link_name, point), robot.jacobian(q, link_name, point)
            assert_close(found, route(robot, q, link, point), reach(robot, q, point), 1e-10)


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("sine", [0.0, *10.0 ** np.arange(-17.0, -2.0)])
def test_nearly_parallel_axes(sine: float, turned: bool) -> None:
    # Where two axes cross at a tiny angle, the turn about x between them has an ill-determined direction.
    rng = np.random.default_rng(11)
    for _ in range(10):
        axis = np.array(unit(rng.normal(size=3)))
        rotation = turn(unit(rng.normal(size=3)), rng.uniform(-np.pi, np.pi)).real
        aside = np.array(unit(np.cross(axis, rng.normal(size=3))))
        other = unit(((-axis if turned else axis) + sine * aside) @ rotation)
        first = Joint(name="a", link="a", axis=unit(axis), rotation=rows(turn(aside, 1.0).real))
        second = Joint(name="b", link="b", axis=other, rotation=rows(rotation), origin=(0.1, 0.2, 0.3))
        robot = Robot(name="crossed", joints=(first, second), tip_origin=(0.3, -0.2, 0.1))
        q = rng.uniform(-np.pi, np.pi, (2, 2))
        known = by_matrices(robot, q, 1, np.array(robot.tip_origin))
        assert_close((robot.pose(q), robot.jacobian(q)), known, 2.0, 1e-11)


def test_random_chains_are_as_varied_as_meant() -> None:
    chains = random_robots()
    assert {robot.dof for robot in chains} == set(range(1, 13))
    joints = [joint for robot in chains for joint in robot.joints]
    assert 0.2 < sum(joint.kind == "prismatic" for joint in joints) / len(joints) < 0.4
    assert sum(joint.origin == (0.0, 0.0, 0.0) for joint in joints) > 100
    cosines = [
        float(np.array(one.axis) @ np.array(other.rotation) @ np.array(other.axis))
        for robot in chains
        for one, other in zip(robot.joints[:-1], robot.joints[1:], strict=True)
    ]
    for special in (1.0, -1.0, 0.0):
        assert sum(abs(cosine - special) < 1e-9 for cosine in cosines) > 100


@pytest.mark.parametrize("q", [[0.0] * 16, [0.1] * 16])
def test_longest_chain(q: list[float]) -> None:
    joints = tuple(Joint(name=f"j{i}", link=f"l{i}", origin=(0.1, 0.0, 0.0)) for i in range(16))
    robot = Robot(name="long", joints=joints, tip_origin=(0.1, 0.0, 0.0))
    # All axes are parallel: a planar arm, whose links point at the sums of the angles.
    heading = np.concatenate([[0.0], np.cumsum(q)])
    assert robot.pose(q)[:3, 3] == pytest.approx([0.1 * np.cos(heading).sum(), 0.1 * np.sin(heading).sum(), 0.0])
    assert robot.jacobian(q)[5] == pytest.approx(np.ones(16))


# --- Robots as they are known -----------------------------------------------------------------------------------------


def test_sia5d_at_zero() -> None:
    pose = Robot.load("sia5d").pose(np.zeros(7))
    np.testing.assert_allclose(pose[:3, 3], [0.500, 0.0, 0.640], rtol=0, atol=1e-15)
    np.testing.assert_allclose(pose[:3, :3], np.eye(3), rtol=0, atol=1e-15)


def test_sia5d_with_its_tool_straight_down() -> None:
    # The reference pose of Schroeder (2013): the tool's axis is x of the last link.
    pose = Robot.load("sia5d").pose(np.deg2rad([0.0, 30.0, 0.0, -20.0, 0.0, -40.0, 0.0]))
    np.testing.assert_allclose(pose[:3, 3], [0.428, 0.0, 0.188], rtol=0, atol=5e-4)
    np.testing.assert_allclose(pose[:3, 0], [0.0, 0.0, -1.0], rtol=0, atol=1e-15)


def test_ur10e_at_zero() -> None:
    # a2 + a3, -(d4 + d6), d1 - d5 of the maker's parameters.
    pose = Robot.load("ur10e").pose(np.zeros(6))
    np.testing.assert_allclose(pose[:3, 3], [-1.18425, -0.2907, 0.06085], rtol=0, atol=1e-15)


def test_ur10e_by_denavit_and_hartenberg() -> None:
    d = [0.1807, 0.0, 0.0, 0.17415, 0.11985, 0.11655]
    a = [0.0, -0.6127, -0.57155, 0.0, 0.0, 0.0]
    alpha = [np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2, 0.0]
    for q in positions(Robot.load("ur10e"), 20, np.random.default_rng(4)):
        x = np.eye(4)
        for theta, d_i, a_i, alpha_i in zip(q, d, a, alpha, strict=True):
            c, s, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha_i), np.sin(alpha_i)
            x = x @ [[c, -s * ca, s * sa, a_i * c], [s, c * ca, -c * sa, a_i * s], [0, sa, ca, d_i], [0, 0, 0, 1]]
        np.testing.assert_allclose(Robot.load("ur10e").pose(q), x, rtol=0, atol=1e-14)


def test_rows_of_the_jacobian() -> None:
    # One joint about z, a point 2 m along x: it moves along y, and the link turns about z.
    robot = Robot(name="r", joints=(Joint(name="j", link="l"),), tip_origin=(2.0, 0.0, 0.0))
    assert robot.jacobian([0.0])[:, 0].tolist() == [0.0, 2.0, 0.0, 0.0, 0.0, 1.0]
    slide = Robot(name="s", joints=(Joint(name="j", link="l", kind="prismatic", axis=(1.0, 0.0, 0.0)),))
    np.testing.assert_allclose(slide.jacobian([0.7])[:, 0], [1.0, 0.0, 0.0, 0.0, 0.0, 0.0], rtol=0, atol=1e-16)
    np.testing.assert_allclose(slide.pose([0.7])[:3, 3], [0.7, 0.0, 0.0], rtol=0, atol=1e-16)


def test_joints_beyond_the_link_do_not_move_it() -> None:
    robot = Robot.load("sia5d")
    q = positions(robot, 10, np.random.default_rng(5))
    for link in range(robot.dof):
        name = robot.joints[link].link
        assert (robot.jacobian(q, name, (0.1, 0.2, 0.3))[:, :, link + 1 :] == 0).all()
        moved = q.copy()
        moved[:, link + 1 :] += 1.0
        assert np.array_equal(robot.pose(moved, name), robot.pose(q, name))


# --- Lanes and targets ------------------------------------------------------------------------------------------------


def chain_of(robot: Robot, target: str) -> object:
    return _native.load(target).Chain(
        prismatic=[joint.kind == "prismatic" for joint in robot.joints],
        origin=np.array([joint.origin for joint in robot.joints]),
        rotation=np.array([joint.rotation for joint in robot.joints]),
        axis=np.array([joint.axis for joint in robot.joints]),
    )


@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("function", ["poses", "jacobians"])
def test_batches_equal_single_rows_to_the_last_bit(function: str, target: str) -> None:
    robot = Robot.load("sia5d")
    compute = getattr(chain_of(robot, target), function)
    q = positions(robot, 19, np.random.default_rng(6))
    point = np.array([0.1, -0.2, 0.3])
    alone = np.concatenate([compute(q[i : i + 1], 5, point) for i in range(len(q))])
    for count in range(1, len(q) + 1):
        assert np.array_equal(compute(np.ascontiguousarray(q[:count]), 5, point), alone[:count])
    assert compute(np.empty((0, 7)), 5, point).shape[0] == 0


def test_one_row_or_many() -> None:
    for robot in (*map(Robot.load, robots()), *random_robots()[:20]):
        q = positions(robot, 7, np.random.default_rng(7))
        poses, jacobians = robot.pose(q), robot.jacobian(q)
        assert poses.shape == (7, 4, 4)
        assert jacobians.shape == (7, 6, robot.dof)
        for i in range(7):
            assert np.array_equal(robot.pose(q[i]), poses[i])
            assert np.array_equal(robot.jacobian(q[i]), jacobians[i])
    assert Robot.load("sia5d").pose(np.empty((0, 7))).shape == (0, 4, 4)
    assert Robot.load("sia5d").jacobian(np.empty((0, 7))).shape == (0, 6, 7)


def test_targets_agree() -> None:
    for robot in (*map(Robot.load, robots()), *random_robots()[:60]):
        q = positions(robot, 30, np.random.default_rng(8))
        point = np.array([0.1, -0.2, 0.3])
        chains = [chain_of(robot, target) for target in TARGETS]
        first, *others = ((c.poses(q, robot.dof - 1, point), c.jacobians(q, robot.dof - 1, point)) for c in chains)
        for other in others:
            assert_close(other, first, reach(robot, q, point), 1e-13)


# --- Input ------------------------------------------------------------------------------------------------------------


def test_any_layout_of_real_numbers() -> None:
    robot = Robot.load("sia5d")
    q = positions(robot, 6, np.random.default_rng(9))
    plain = robot.pose(q)
    wide = np.zeros((12, 14))
    wide[::2, ::2] = q
    read_only = q.copy()
    read_only.flags.writeable = False
    for same in (np.asfortranarray(q), wide[::2, ::2], q[::-1][::-1], q.tolist(), tuple(map(tuple, q)), read_only):
        assert np.array_equal(robot.pose(same), plain)
    assert np.array_equal(robot.pose(q.astype(">f8")), plain)
    single = q.astype(np.float32)
    assert np.array_equal(robot.pose(single), robot.pose(single.astype(np.float64)))
    assert np.array_equal(robot.pose([0, 1, 0, -1, 0, 1, 0]), robot.pose([0.0, 1.0, 0.0, -1.0, 0.0, 1.0, 0.0]))
    assert np.array_equal(robot.jacobian(np.arange(7, dtype=np.uint8)), robot.jacobian(np.arange(7.0)))
    assert np.array_equal(robot.pose(q, point=[0, 1, 0]), robot.pose(q, point=np.array([0.0, 1.0, 0.0])))


def test_input_is_left_alone() -> None:
    robot = Robot.load("sia5d")
    q = positions(robot, 3, np.random.default_rng(10))
    before, point = q.copy(), np.array([0.1, 0.2, 0.3])
    robot.pose(q, point=point)
    robot.jacobian(q, point=point)
    assert np.array_equal(q, before)
    assert point.tolist() == [0.1, 0.2, 0.3]


NO_POSITIONS = {
    "too few": np.zeros(6),
    "too many": np.zeros((2, 8)),
    "a number": 0.0,
    "three axes": np.zeros((1, 1, 7)),
    "nan": [0, 0, 0, np.nan, 0, 0, 0],
    "infinity": [[0] * 7, [0] * 6 + [np.inf]],
    "text": ["0"] * 7,
    "one text": "0 0 0 0 0 0 0",
    "complex": np.zeros(7, complex),
    "truth": np.zeros(7, bool),
    "nothing": None,
    "objects": np.array([None] * 7),
    "dates": np.zeros(7, "datetime64[s]"),
    "masked": np.ma.masked_array(np.zeros(7), [False] * 6 + [True]),
    "ragged rows": [[0.0] * 7, [0.0] * 6],
    "ragged": [0.0, [0.0, 1.0], 0.0, 0.0, 0.0, 0.0, 0.0],
}


@pytest.mark.parametrize("q", NO_POSITIONS.values(), ids=NO_POSITIONS)
def test_what_are_no_joint_positions(q: npt.ArrayLike) -> None:
    robot = Robot.load("sia5d")
    for function in (robot.pose, robot.jacobian):
        with pytest.raises(InputError) as refused:
            function(q)
        assert refused.value.field.startswith("q")


def test_offending_value_is_named() -> None:
    robot = Robot.load("sia5d")
    with pytest.raises(InputError, match=r"^q\[1, 6\]: is inf; wanted a finite number$"):
        robot.pose([[0] * 7, [0] * 6 + [np.inf]])
    with pytest.raises(InputError, match=r"^q: has shape \(2, 8\); wanted \(N, 7\)$"):
        robot.pose(np.zeros((2, 8)))


@pytest.mark.parametrize(
    "point",
    [
        [0.0, 0.0],
        np.zeros((1, 3)),
        [0.0, np.nan, 0.0],
        "abc",
        [1j, 0, 0],
        [True, False, True],
        [[0.0], [0.0, 1.0], 0.0],
    ],
)
def test_what_is_no_point(point: npt.ArrayLike) -> None:
    with pytest.raises(InputError) as refused:
        Robot.load("sia5d").jacobian(np.zeros(7), point=point)
    assert refused.value.field.startswith("point")
