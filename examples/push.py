"""Push an arm in its recording: ``python push.py check.parquet pushed.parquet labels.csv [NEWTONS]``.

Twice the tip of the arm is pushed downward, for 0.3 s each, with a force that grows for 50 ms: what the joints feel of
it is added to the recorded torques, J' f. When it happened is written as labels for ``bumpstop score``.
"""

import sys
from dataclasses import replace

import numpy as np

import bumpstop as bs

source, out, labels, force = sys.argv[1], sys.argv[2], sys.argv[3], float((sys.argv[4:] or ["100"])[0])
log = bs.Recording.load(source)
robot = bs.Robot.load(log.robot)
tau = log.tau.copy()
with open(labels, "w", encoding="utf-8") as file:  # noqa: PTH123
    file.write("start_s,end_s\n")
    for share in (0.4, 0.8):
        begin = log.t[0] + share * (log.t[-1] - log.t[0])
        rows = np.flatnonzero((log.t >= begin) & (log.t < begin + 0.3))
        push = force * np.minimum((log.t[rows] - begin) / 0.05, 1.0)
        down = robot.jacobian(log.q[rows])[:, 2]
        # The environment pushes the arm down with f: tau_ext = J' f, and the motors give that much less.
        tau[rows] -= down * -push[:, None]
        file.write(f"{begin:.3f},{begin + 0.3:.3f}\n")
replace(log, tau=tau).save(out)
print(f"{out}: two pushes of {force:g} N")
