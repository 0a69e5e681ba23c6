"""Rehearse a planned motion without an arm: ``python rehearse.py excitation.csv run.parquet [SEED]``.

A UR10e of the published inertia, with friction and noise of our own choosing, follows the trajectory. What it would
have recorded of itself, positions and joint torques at an uneven 250 Hz with one sample in a hundred lost, is written.
"""

import sys

import numpy as np
from scipy.interpolate import CubicHermiteSpline

import bumpstop as bs
from bumpstop.model import inverse_dynamics
from bumpstop.recording import Recording

plan, out, seed = sys.argv[1], sys.argv[2], int((sys.argv[3:] or ["0"])[0])
robot = bs.Robot.load("ur10e")
rng = np.random.default_rng(seed)

rows = np.loadtxt(plan, delimiter=",", skiprows=1)
n = robot.dof
motion = CubicHermiteSpline(rows[:, 0], rows[:, 1 : n + 1], rows[:, n + 1 : 2 * n + 1])

t = np.arange(0.0, rows[-1, 0], 0.004)
t = (t + rng.uniform(0, 0.0004, t.size))[rng.random(t.size) > 0.01]
q, qd, qdd = (motion(t, order) for order in range(3))
weight = np.array([1.0, 1.0, 0.6, 0.2, 0.2, 0.2])  # of friction and noise, joint by joint
friction = weight * (6.0 * np.tanh(qd / 0.01) + 4.0 * qd)
tau = inverse_dynamics(robot, q, qd, qdd) + friction + weight * rng.normal(size=q.shape)
names = tuple(joint.name for joint in robot.joints)
Recording(t=t, q=q + 1e-5 * rng.normal(size=q.shape), tau=tau, joint_names=names, robot="ur10e").save(out)
print(f"{out}: {t.size} rows")
