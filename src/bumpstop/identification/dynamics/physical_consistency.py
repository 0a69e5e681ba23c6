"""Inertias that bodies can have: masses and moments of every link, fitted so that none is impossible.

Base parameters are what a torque shows; nothing keeps them from being those of no bodies at all. Here every link is a
pseudo-inertia J = U U', U upper triangular with a positive diagonal. A density of mass that is nowhere negative has
such a J, and every such J has a density (P. M. Wensing, S. Kim and J.-J. E. Slotine, "Linear matrix inequalities for
physically consistent inertial parameter identification", 2018). The parameters are those of C. Rucker and P. M.
Wensing, "Smooth parameterization of rigid-body inertia", 2022.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError
from bumpstop.identification.dynamics.dynamics_fit import ENOUGH_TO_FIT
from bumpstop.identification.dynamics.dynamics_system import FIT_PER_CUTOFF
from bumpstop.identification.dynamics.regressor_columns import column_unit, regressor_columns
from bumpstop.identification.fit import Quantity
from bumpstop.identification.payload.tip_parameters import parameters_of, pseudo_inertia
from bumpstop.identification.segments.torque_samples import as_list
from bumpstop.model import LinkInertia, Robot, write_urdf
from bumpstop.model.inertia import matrix3, vector3

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bumpstop.identification.comparison import Comparison, JointScore
    from bumpstop.identification.dynamics.dynamics_fit import DynamicsFit
    from bumpstop.identification.dynamics.dynamics_model import DynamicsModel
    from bumpstop.identification.payload.payload import Payload
    from bumpstop.recording import Recording

# How far a link may be thought to lie from where the search starts, as one standard deviation: factors of e in mass and
# extent, 0.3 m in place and shear. It decides what the torque does not show, and nothing else.
_SPREAD = np.array([1.0, 1.0, 1.0, 1.0, 0.3, 0.3, 0.3, 0.3, 0.3, 0.3])
# Half the logarithm of a mass that the robot came with. Turning one joint alone, a heavier link and a rotor look alike:
# the figure that is known decides, or rotors would be paid for in kilograms.
_KNOWN_MASS = 0.15
_ROTOR_SPREAD = 3.0  # of a rotor, factors of e
# Where nothing is known of a link: mass [kg], radius of gyration [m]; and of a rotor [kg m2].
_MASS, _RADIUS, _ROTOR = 3.0, 0.1, 0.1
# An independent row of residuals counts as so many that are correlated.
_ROWS_PER_INDEPENDENT = 50.0


@dataclass(frozen=True, eq=False)
class ConsistentFit:
    """Links and rotors that bodies can have.

    Attributes:
        model: of the torques: these inertias, with the friction and the offsets that suit them.
        body_errors: (11 n,) standard errors of the ten parameters of every link and of the rotors, of what the torque
            and the inertia that the robot came with say together (the covariance about the least squares' end).
        rmse: (n,) of the torques on the rows of the fit [Nm or N].
        rmse_free: (n,) the same of the base parameters, which nothing constrains.
    """

    model: DynamicsModel
    body_errors: FloatArray
    rmse: FloatArray
    rmse_free: FloatArray

    @property
    def robot(self) -> Robot:
        """The chain with these inertias."""
        return self.model.robot

    @property
    def parameters(self) -> dict[str, Quantity]:
        """Mass, first and second moments of the links (``m_1`` .. ``Iyz_n``) and rotor inertias (``rotor_1`` ..)."""
        names = self.model.column_names
        return {
            names[column]: Quantity(float(self.model.values[column]), column_unit(names[column], self.robot))
            for column in _body_columns(self.robot.dof)
        }

    @property
    def standard_errors(self) -> dict[str, float | None]:
        """Of :attr:`parameters`."""
        return dict(zip(self.parameters, self.body_errors.tolist(), strict=True))

    def predict(self, recording: Recording | Sequence[Recording]) -> Comparison:
        """:meth:`DynamicsModel.compare`."""
        return self.model.compare(recording)

    def score(self, recording: Recording | Sequence[Recording]) -> tuple[JointScore, ...]:
        """How well recorded torques are predicted, joint by joint."""
        return self.predict(recording).scores()

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the inertias as a URDF (:func:`bumpstop.model.write_urdf`)."""
        write_urdf(self.robot, os.fspath(path))


def _body_columns(dof: int) -> np.ndarray:
    """Columns of links, then of rotors."""
    return np.concatenate([np.arange(10 * dof), 10 * dof + 4 * np.arange(dof) + 2])


def consistent_inertias(
    recordings: Recording | Sequence[Recording], fit: DynamicsFit, *, payloads: Sequence[Payload | None] = ()
) -> ConsistentFit:
    """Fit possible inertias to the recordings that base parameters were fitted to.

    Least squares over the parameters of all links and the logarithms of rotor inertias; friction and offsets are linear
    and follow. What the torque does not show stays near the inertia of the model's robot, or near 3 kg and 0.1 m where
    that has none.

    Args:
        recordings: with joint torque; one or more.
        fit: of :func:`identify_dynamics`; its filter, weights and shapes of friction are taken over.
        payloads: what each recording carried that is not to be part of the arm; default: nothing.

    Raises:
        InputError: the recording has no torque, or the search does not end.
    """
    from scipy.linalg import qr
    from scipy.optimize import least_squares

    given = fit.model
    n = given.robot.dof
    rows, cutoff = (
        given.rows(recordings, payloads, limit=ENOUGH_TO_FIT, ends=False),
        FIT_PER_CUTOFF * given.cutoff_hz,
    )
    reach = rows.reach.trimmed(cutoff)
    columns = regressor_columns(
        given.robot,
        reach.motion,
        given.signs(reach.motion),
        given.couplings,
        given.top_speed,
        loads=given.loads(reach.motion, reach.carried),
    )
    columns = reach.filtered(columns, cutoff)
    wanted = rows.torque_below(cutoff) - reach.filtered(reach.carried, cutoff)
    columns[~rows.used], wanted[~rows.used] = 0.0, 0.0
    free = wanted - columns[:, :, list(given.columns)] @ given.values
    weight = 1 / np.maximum(free.std(axis=0), 1e-12)
    flat = (columns * weight[None, :, None]).reshape(-1, columns.shape[2])
    target = (wanted * weight).ravel()
    rotors = 10 * n + 4 * np.arange(n) + 2
    bodies = _body_columns(n)
    others = np.setdiff1d(np.arange(flat.shape[1]), bodies)
    length = np.linalg.norm(flat[:, others], axis=0)
    others = others[length > 1e-9 * length.max(initial=0.0)]
    # Friction takes its own share of every residual: what is left after it is a small triangle.
    (triangle,) = qr(np.column_stack([flat[:, others], flat[:, bodies], target]), mode="r")
    rest = triangle[others.size : others.size + bodies.size + 1, others.size :] / np.sqrt(_ROWS_PER_INDEPENDENT)
    start = np.concatenate([*(_start(joint.inertia) for joint in given.robot.joints), np.log(_rotors(given.robot))])
    spread = np.concatenate([np.tile(_SPREAD, n), np.full(n, _ROTOR_SPREAD)])
    for j, joint in enumerate(given.robot.joints):
        if joint.inertia is not None and joint.inertia.mass > 0:
            spread[10 * j] = _KNOWN_MASS

    def parameters(theta: FloatArray) -> FloatArray:
        links = [parameters_of(_matrix(part)) for part in theta[: 10 * n].reshape(n, 10)]
        return np.concatenate([*links, np.exp(theta[10 * n :])])

    def misfit(theta: FloatArray) -> FloatArray:
        return np.concatenate([rest[:, :-1] @ parameters(theta) - rest[:, -1], (theta - start) / spread])

    def turn(theta: FloatArray) -> FloatArray:
        derivative = np.zeros((bodies.size, theta.size))
        for j, part in enumerate(theta[: 10 * n].reshape(n, 10)):
            derivative[10 * j : 10 * j + 10, 10 * j : 10 * j + 10] = _derivative(part)
        derivative[10 * n :, 10 * n :] = np.diag(np.exp(theta[10 * n :]))
        return derivative

    def slope(theta: FloatArray) -> FloatArray:
        return np.vstack([rest[:, :-1] @ turn(theta), np.diag(1 / spread)])

    found = least_squares(misfit, start, slope, method="lm", x_scale=spread, max_nfev=2000, ftol=1e-7, xtol=1e-7)
    if not found.success:
        raise InputError("recording", "leads to no possible inertias", "wanted a motion that moves every joint")
    values = np.zeros(flat.shape[1])
    values[bodies] = parameters(found.x)
    values[others] = np.linalg.lstsq(flat[:, others], target - flat[:, bodies] @ values[bodies], rcond=None)[0]
    joints = tuple(
        replace(joint, inertia=_link(values[10 * j : 10 * j + 10]), rotor_inertia=float(values[rotors[j]]))
        for j, joint in enumerate(given.robot.joints)
    )
    robot = replace(
        given.robot,
        joints=joints,
        inertia_status="assumed",
        inertia_source=f"identified from {' '.join(log.source for log in as_list(recordings)) or 'a recording'}",
    )
    rmse = np.sqrt(((wanted - columns @ values) ** 2).mean(axis=0))
    curvature = np.asarray(np.linalg.qr(slope(found.x), mode="r"))
    body_errors = np.linalg.norm(np.linalg.solve(curvature.T, turn(found.x).T), axis=0)
    model = replace(
        given, robot=robot, columns=tuple(range(values.size)), values=values, predicting=None, predicted_by_all=()
    )
    return ConsistentFit(model, body_errors, rmse, np.sqrt((free**2).mean(axis=0)))


def _matrix(theta: FloatArray) -> FloatArray:
    """Pseudo-inertia (4, 4) of alpha, d1, d2, d3, s12, s13, s23, t1, t2, t3."""
    U = _factor(theta)
    return U @ U.T


def _factor(theta: FloatArray) -> FloatArray:
    alpha, d1, d2, d3, s12, s13, s23, t1, t2, t3 = theta
    U = np.zeros((4, 4))
    U[0, :] = np.exp(d1), s12, s13, t1
    U[1, 1:] = np.exp(d2), s23, t2
    U[2, 2:] = np.exp(d3), t3
    U[3, 3] = 1.0
    return np.asarray(np.exp(alpha) * U)


_PLACES = ((0, 1), (0, 2), (1, 2), (0, 3), (1, 3), (2, 3))  # of s12, s13, s23, t1, t2, t3


def _derivative(theta: FloatArray) -> FloatArray:
    """Derivative (10, 10) of the inertial parameters by theta."""
    U, size = _factor(theta), np.exp(theta[0])
    result = np.empty((10, 10))
    for k in range(10):
        step = np.zeros((4, 4))
        if k == 0:
            step = U
        elif k < 4:
            step[k - 1, k - 1] = U[k - 1, k - 1]
        else:
            step[_PLACES[k - 4]] = size
        result[:, k] = parameters_of(step @ U.T + U @ step.T)
    return result


def _start(inertia: LinkInertia | None) -> FloatArray:
    """Parameters theta (10,) of a link, or of a small ball about its origin."""
    if inertia is None or not inertia.mass > 0:
        matrix = _MASS * np.diag([_RADIUS**2 / 2] * 3 + [1.0])
    else:
        m, c = inertia.mass, np.asarray(inertia.center)
        about = np.asarray(inertia.tensor) + m * (c @ c * np.eye(3) - np.outer(c, c))
        matrix = pseudo_inertia(np.array([m, *(m * c), *about.diagonal(), *about[[0, 0, 1], [1, 2, 2]]]))
        # A point or a rod has a singular one: give it a millimetre.
        matrix[:3, :3] += m * 1e-6 * np.eye(3)
    backwards = np.linalg.cholesky(matrix[::-1, ::-1])[::-1, ::-1]
    size = backwards[3, 3]
    U = backwards / size
    return np.array([np.log(size), *np.log(np.diag(U)[:3]), *(U[place] for place in _PLACES)])


def _rotors(robot: Robot) -> FloatArray:
    return np.array([joint.rotor_inertia if joint.rotor_inertia > 0 else _ROTOR for joint in robot.joints])


def _link(parameters: FloatArray) -> LinkInertia:
    """The link of parameters (10,) about its origin."""
    mass, center = float(parameters[0]), parameters[1:4] / parameters[0]
    xx, yy, zz, xy, xz, yz = parameters[4:]
    about = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    tensor = about - mass * (center @ center * np.eye(3) - np.outer(center, center))
    return LinkInertia(mass=mass, center=vector3(center), tensor=matrix3(tensor))
