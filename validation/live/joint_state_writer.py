"""A process of its own that publishes joint states when they are due."""

from __future__ import annotations

import json
import sys
import time

import numpy as np

from bumpstop.live.dds.participant import participant
from bumpstop.live.dds.publishers import writer
from bumpstop.live.dds.types import Header, JointState, Time


def main(rows_file: str, domain: int, topic: str, count: int) -> None:
    """Publish so many rows of a file, over and over, each stamped with the time when it is due; say how late they were.

    Args:
        rows_file: of numpy, with ``names``, ``period_s`` and rows of ``position`` and ``effort``.
        domain: of DDS.
        topic: its DDS name.
        count: of messages.
    """
    log = np.load(rows_file)
    names, period = [str(name) for name in log["names"]], float(log["period_s"])
    position, effort = log["position"].tolist(), log["effort"].tolist()
    states = writer(participant(domain, loopback=True), topic, JointState)
    end = time.monotonic() + 60.0
    while not states.get_matched_subscriptions() and time.monotonic() < end:
        time.sleep(0.01)
    time.sleep(0.5)
    begin = time.monotonic()
    late = np.empty(count)
    for k in range(count):
        due = begin + k * period
        wait = due - time.monotonic()
        if wait > 0:
            time.sleep(wait)
        sec, nanosec = divmod(round(due * 1e9), 1_000_000_000)
        row = k % len(position)
        states.write(JointState(Header(Time(sec, nanosec), ""), names, position[row], [], effort[row]))
        late[k] = time.monotonic() - due
    print(json.dumps({"count": count, "late_ms": {str(p): 1e3 * float(np.quantile(late, p)) for p in (0.5, 0.99, 1)}}))
    # Nobody who is slow must lose the last ones.
    time.sleep(1.0)


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), sys.argv[3], int(sys.argv[4]))
