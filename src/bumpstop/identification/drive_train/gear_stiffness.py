"""Stiffness of the gears from static pushes: known forces, and how far the arm gave way."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.arrays import FloatArray, as_float_array
from bumpstop.csv_table import read_csv_table
from bumpstop.errors import InputError
from bumpstop.identification.drive_train.joint_values import JointValues, judged
from bumpstop.model.pose_limits import check_pose
from bumpstop.text_files import read_text

if TYPE_CHECKING:
    import os

    from bumpstop.model import Robot

# Of a joint's share of all that is measured: below it nothing is said of its gear.
_MIN_SHARE = 1e-6
_WANTED = "wanted a table of pushes (CSV)"
_FORCE = ("force_x_N", "force_y_N", "force_z_N")
_DISPLACEMENT = ("displacement_x_mm", "displacement_y_mm", "displacement_z_mm")


@dataclass(frozen=True, eq=False)
class Pushes:
    """Static pushes against an arm whose servo holds its motors where they are.

    Attributes:
        q: (N, dof) joint positions of each push [rad or m].
        force: (N, 3) on the arm at the point, base frame [N]; only what it is more than before the push.
        displacement: (N, 3) of the point by the push, base frame [m]; nan in directions that were not measured. None:
            not measured.
        twist: (N, dof) of each joint by the push, link less motor [rad or m]; nan: not measured. None: of no joint.
        link: name of the link that was pushed; None: the tip.
        point: in that link's frame [m].
    """

    q: FloatArray
    force: FloatArray
    displacement: FloatArray | None = None
    twist: FloatArray | None = None
    link: str | None = None
    point: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @classmethod
    def load(
        cls,
        path: str | os.PathLike[str],
        robot: Robot,
        *,
        link: str | None = None,
        point: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> Pushes:
        """Read pushes from a table, CSV, with a row for each.

        Columns: ``q_1`` .. [rad or m], ``force_x_N``, ``force_y_N``, ``force_z_N``, and ``displacement_x_mm``,
        ``displacement_y_mm``, ``displacement_z_mm`` or ``twist_1`` .. [rad or m]; an empty place was not measured.

        Args:
            path: of the file.
            robot: that was pushed.
            link: name of the link that was pushed; default: the tip.
            point: in that link's frame [m].

        Raises:
            InputError: the file cannot be read, or lacks columns.
        """
        q_names, twist_names = ([f"{what}_{j + 1}" for j in range(robot.dof)] for what in ("q", "twist"))
        known = [*q_names, *_FORCE, *_DISPLACEMENT, *twist_names]
        table = read_csv_table(read_text(path, _WANTED), Path(path), _WANTED, "push", known=known)
        for k, name in enumerate(table.names):
            if name not in known:
                raise InputError(str(path), f"{name[:60]!r} is no column of pushes", f"valid: {', '.join(known)}")
            if name in table.names[:k]:
                raise InputError(str(path), f"has two columns {name!r}", "wanted each once")
        for names in (q_names, _FORCE, _DISPLACEMENT, twist_names):
            missing = [name for name in names if name not in table.names]
            if missing and (names in (q_names, _FORCE) or len(missing) < len(names)):
                raise InputError(str(path), f"has no column {missing[0]!r}", f"wanted {', '.join(names)}")
        rows: list[dict[str, float]] = []
        for number, cells in table.rows:
            where = f"{path} row {number}"
            if isinstance(cells, InputError):
                raise cells
            rows.append({name: _number(cell, where, name) for name, cell in zip(table.names, cells, strict=True)})
            for name in (*q_names, *_FORCE):
                if math.isnan(rows[-1][name]):
                    raise InputError(where, f"has no {name}", "wanted pose and force of every push")

        def columns(names: Sequence[str]) -> FloatArray | None:
            return np.array([[row[name] for name in names] for row in rows]) if names[0] in table.names else None

        if not rows:
            raise InputError(str(path), "has no rows", "wanted one for each push")
        q, force, moved, twist = (columns(names) for names in (q_names, _FORCE, _DISPLACEMENT, twist_names))
        assert q is not None
        assert force is not None
        return cls(q, force, None if moved is None else moved * 1e-3, twist, link, point)


def _number(cell: str, where: str, name: str) -> float:
    """What a cell says; nan: it is empty."""
    try:
        value = float(cell.replace("\N{MINUS SIGN}", "-")) if cell.strip() else math.nan
    except ValueError:
        value = math.inf
    if math.isinf(value):
        raise InputError(where, f"{name} is {cell.strip()[:40]!r}", "wanted a finite number, with a point")
    return value


def identify_gear_stiffness(pushes: Pushes, robot: Robot) -> JointValues:
    """Fit the compliance of every gear to how far pushes moved the point or twisted the joints.

    A push F loads the joints with J' F, so the joints give by c_j (J' F)_j and the point moves by J diag(c) J' F. Both
    are linear in the compliances c = 1 / Kg, which are found by least squares without going below zero, rows of
    displacements and of twists each weighted by their own residuals (Dumas and others, Joint stiffness identification
    of industrial serial robots, 2011).

    Args:
        pushes: in several poses and directions, or some gears cannot be told apart.
        robot: that was pushed.

    Returns:
        Stiffness of each gear [Nm/rad or N/m].

    Raises:
        InputError: neither displacement nor twist, a pose beyond the joints' limits, as in degrees, or arrays that do
            not fit the robot.
    """
    q = as_float_array(pushes.q, "pushes.q", (None, robot.dof))
    force = as_float_array(pushes.force, "pushes.force", (len(q), 3))
    jacobian = robot.jacobian(q, pushes.link, pushes.point)[:, :3]
    for row in np.flatnonzero(robot.beyond_limits(q).any(axis=1)):
        check_pose(robot, q[row], f"pushes.q[{row + 1}]", in_degrees=False)
    load = np.einsum("nij,ni->nj", jacobian, force)
    blocks: list[tuple[FloatArray, FloatArray]] = []
    if pushes.displacement is not None:
        moved = as_float_array(pushes.displacement, "pushes.displacement", (len(q), 3), finite=False)
        blocks.append(((jacobian * load[:, None, :]).reshape(-1, robot.dof), moved.ravel()))
    if pushes.twist is not None:
        twist = as_float_array(pushes.twist, "pushes.twist", (len(q), robot.dof), finite=False)
        blocks.append(((np.eye(robot.dof) * load[:, None, :]).reshape(-1, robot.dof), twist.ravel()))
    measured = [(columns[np.isfinite(y)], y[np.isfinite(y)]) for columns, y in blocks]
    measured = [(columns, y) for columns, y in measured if y.size]
    if not measured:
        raise InputError("pushes", "measured nothing", "wanted displacements of the point, or twists of the joints")
    return _compliances(measured, robot.dof)


def _compliances(blocks: list[tuple[FloatArray, FloatArray]], dof: int) -> JointValues:
    from scipy.optimize import nnls

    weights = [1.0 / (float(np.sqrt(np.mean(y**2))) or 1.0) for _, y in blocks]
    reasons = [""] * dof
    for _ in range(3):
        columns = np.concatenate([w * x for w, (x, _) in zip(weights, blocks, strict=True)])
        y = np.concatenate([w * own for w, (_, own) in zip(weights, blocks, strict=True)])
        length = np.linalg.norm(columns, axis=0)
        scaled = columns / np.where(length > 0, length, 1.0)
        values, _ = nnls(scaled, y)
        residuals = np.split(y - scaled @ values, np.cumsum([own.size for _, own in blocks])[:-1])
        weights = [w / max(float(np.sqrt(np.mean(own**2))), 1e-12) for w, own in zip(weights, residuals, strict=True)]
    rows = y.size
    squares, directions = np.linalg.eigh(scaled.T @ scaled)
    inverse = directions / np.maximum(squares, 1e-14 * (float(squares[-1]) or 1.0)) @ directions.T
    variance = float(((y - scaled @ values) ** 2).sum()) / max(rows - dof, 1)
    spread = np.sqrt(np.maximum(np.diag(inverse) * variance, 0.0))
    compliance = np.where(length > 0, values / np.where(length > 0, length, 1.0), 0.0)
    error = np.where(length > 0, spread / np.where(length > 0, length, 1.0), np.inf)
    for j in range(dof):
        if length[j] <= _MIN_SHARE * length.max():
            reasons[j] = "no push loads it"
        elif rows <= dof:
            reasons[j] = f"{rows} measured values are too few for {dof} gears"
        elif not compliance[j] > 0:
            against = scaled[:, j] @ y < 0
            reasons[j] = "it gives against the force: is that the force on the arm?" if against else "it does not give"
    stiffness = 1.0 / np.where(compliance > 0, compliance, np.nan)
    return judged(stiffness, stiffness**2 * error, reasons)
