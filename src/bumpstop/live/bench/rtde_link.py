"""The plant behind a controller's side of the Real-Time Data Exchange."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, cast

from bumpstop.errors import InputError
from bumpstop.live.answer import ANSWERS
from bumpstop.live.bench.link import LinkAnswer
from bumpstop.live.rtde.axes import CONTROLLER_JOINTS, DEFAULT_AXES, FIRST_REGISTER, check_turning, joint_order
from bumpstop.live.rtde.server import RtdeServer
from bumpstop.live.rtde.source import ANSWER_FIELDS, output_fields

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bumpstop.live.rtde.fields import Value
    from bumpstop.plant import Plant, Sample


class RtdeLink:
    """Serves a plant's samples as a controller of Universal Robots does.

    Joints beside the controller's six travel in registers, as :class:`~bumpstop.live.rtde.RtdeSource` reads them. The
    currents of a plant without a joint model are torques; it serves them as both.

    Args:
        plant: of at least six joints.
        port: where to listen on the loopback; 0: any that is free.
        axes: (6,) joints, from 1, that the controller's are; they turn.

    Raises:
        InputError: fewer joints, axes that cannot be, or the port cannot be had.

    Attributes:
        server: behind it.
    """

    def __init__(self, plant: Plant, port: int, axes: Sequence[int] = DEFAULT_AXES) -> None:
        joints = plant.robot.dof
        if joints < CONTROLLER_JOINTS:
            raise InputError("--rtde", f"carries six joints, {plant.robot.name} has {joints}", "use --dds")
        self._order = joint_order(joints, axes)
        parts = plant.robot.joints
        check_turning(axes, [joint.name for joint in parts], [joint.kind == "prismatic" for joint in parts])
        fields = output_fields(joints, "current")
        self._torque = plant.joint_model is None
        if self._torque:
            fields |= output_fields(joints, "torque")
        self.server = RtdeServer(fields, plant.sensors.rate_hz, port=port)
        self._seen_s = 0.0

    @property
    def address(self) -> str:
        """``rtde://127.0.0.1:PORT``."""
        return f"rtde://127.0.0.1:{self.server.port}"

    def wait_for_client(self, timeout_s: float) -> bool:
        """Whether a client has started the exchange within the time [s]."""
        return self.server.wait_for_client(timeout_s)

    def publish(self, sample: Sample, stamp_s: float) -> None:
        """Send a sample of the plant, with its time by the bench's clock [s]."""
        q, qd, current = (column[self._order].tolist() for column in (sample.q, sample.qd, sample.current))
        six = slice(CONTROLLER_JOINTS)
        values: dict[str, Value] = {
            "timestamp": stamp_s,
            "actual_q": tuple(q[six]),
            "actual_qd": tuple(qd[six]),
            "actual_current": tuple(current[six]),
        }
        if self._torque:
            values["actual_current_as_torque"] = tuple(current[six])
        for k in range(CONTROLLER_JOINTS, len(q)):
            register = FIRST_REGISTER + 2 * (k - CONTROLLER_JOINTS)
            values[f"output_double_register_{register}"] = q[k]
            values[f"output_double_register_{register + 1}"] = current[k]
        self.server.publish(values)

    def answer(self) -> LinkAnswer | None:
        """The answer that came since the last call; None: none."""
        values, written_s = self.server.inputs()
        if written_s <= self._seen_s:
            return None
        self._seen_s = written_s
        kind, number = (cast(int, values[name]) for name in ANSWER_FIELDS)
        if not 0 < kind < len(ANSWERS):
            return None
        return LinkAnswer(cast(Literal["stop", "reverse"], ANSWERS[kind]), written_s, number)

    def close(self) -> None:
        """End all connections; may be called twice."""
        self.server.close()
