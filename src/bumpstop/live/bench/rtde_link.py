"""The plant behind a controller's side of the Real-Time Data Exchange."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, cast

from bumpstop.errors import InputError
from bumpstop.live.answer import ANSWERS
from bumpstop.live.bench.link import LinkAnswer
from bumpstop.live.rtde.server import RtdeServer
from bumpstop.live.rtde.source import ANSWER_FIELDS, CONTROLLER_JOINTS, FIRST_REGISTER, output_fields

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray
    from bumpstop.live.rtde.fields import Value
    from bumpstop.plant import Plant, Sample


class RtdeLink:
    """Serves a plant's samples as a controller of Universal Robots does.

    Joints beyond six travel in registers, as :class:`~bumpstop.live.rtde.RtdeSource` reads them. The currents of a
    plant without a joint model are torques; it serves them as both.

    Args:
        plant: of at least six joints.
        port: where to listen on the loopback; 0: any that is free.

    Raises:
        InputError: fewer joints, or the port cannot be had.

    Attributes:
        server: behind it.
    """

    def __init__(self, plant: Plant, port: int) -> None:
        joints = plant.robot.dof
        if joints < CONTROLLER_JOINTS:
            raise InputError("--rtde", f"carries six joints, {plant.robot.name} has {joints}", "use --dds")
        fields = output_fields(joints, "current")
        self._torque = plant.joint_model is None
        if self._torque:
            fields |= output_fields(joints, "torque")
        self.server = RtdeServer(fields, plant.sensors.rate_hz, port=port)
        self._joints, self._seen_s = joints, 0.0

    @property
    def address(self) -> str:
        """``rtde://127.0.0.1:PORT``."""
        return f"rtde://127.0.0.1:{self.server.port}"

    def wait_for_client(self, timeout_s: float) -> bool:
        """Whether a client has started the exchange within the time [s]."""
        return self.server.wait_for_client(timeout_s)

    def publish(self, sample: Sample, stamp_s: float) -> None:
        """Send a sample of the plant, with its time by the bench's clock [s]."""

        def six(values: FloatArray) -> tuple[float, ...]:
            return tuple(values[:CONTROLLER_JOINTS].tolist())

        values: dict[str, Value] = {
            "timestamp": stamp_s,
            "actual_q": six(sample.q),
            "actual_qd": six(sample.qd),
            "actual_current": six(sample.current),
        }
        if self._torque:
            values["actual_current_as_torque"] = six(sample.current)
        for j in range(CONTROLLER_JOINTS, self._joints):
            register = FIRST_REGISTER + 2 * (j - CONTROLLER_JOINTS)
            values[f"output_double_register_{register}"] = float(sample.q[j])
            values[f"output_double_register_{register + 1}"] = float(sample.current[j])
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
