"""Real-Time Data Exchange: bytes as the protocol has them, samples to the last digit, and every fault by its name."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import SimpleNamespace

import numpy as np
import pytest

from bumpstop.errors import InputError
from bumpstop.live import JointSample, SourceEvent, SourceEventKind
from bumpstop.live.rtde import RtdeServer, RtdeSource
from bumpstop.live.rtde.connection import LostConnectionError, RtdeConnection
from bumpstop.live.rtde.fields import ProtocolError, Recipe, Value
from bumpstop.live.rtde.messages import (
    Data,
    RecipeReply,
    RequestVersion,
    SetupOutputs,
    Text,
    decode_reply,
    decode_request,
    encode,
)
from bumpstop.live.rtde.source import output_fields


def served(q: np.ndarray, current: np.ndarray, stamp: float) -> dict[str, Value]:
    """A sample as a server takes it."""
    values: dict[str, Value] = {"timestamp": stamp, "actual_qd": (0.0,) * 6}
    values |= {"actual_q": tuple(q[:6].tolist()), "actual_current": tuple(current[:6].tolist())}
    for j in range(6, len(q)):
        values[f"output_double_register_{24 + 2 * (j - 6)}"] = float(q[j])
        values[f"output_double_register_{25 + 2 * (j - 6)}"] = float(current[j])
    return values


@contextmanager
def server(joints: int = 6, port: int = 0) -> Iterator[RtdeServer]:
    one = RtdeServer(output_fields(joints, "current"), 500.0, port=port)
    try:
        yield one
    finally:
        one.close()


def test_bytes_of_the_protocol() -> None:
    """As the published guide has them: sizes include the header, numbers are big-endian."""
    assert encode(RequestVersion(2)).hex() == "0005560002"
    assert encode(SetupOutputs(125.0, ("timestamp", "actual_q"))) == (
        b"\x00\x1d" + b"O" + b"\x40\x5f\x40\x00\x00\x00\x00\x00" + b"timestamp,actual_q"
    )
    assert encode(RecipeReply("O", 1, ("DOUBLE", "VECTOR6D"))) == b"\x00\x13O\x01DOUBLE,VECTOR6D"
    assert encode(Text("ab", "c", 2)) == b"\x00\x09M\x02ab\x01c\x02"
    recipe = Recipe(7, ("a", "b", "c"), ("BOOL", "VECTOR6INT32", "UINT64"))
    assert recipe.pack((True, (1, -1, 0, 0, 0, 2), 2**63)).hex() == (
        "01" + "00000001ffffffff000000000000000000000000" + "00000002" + "8000000000000000"
    )
    assert recipe.unpack(recipe.pack((True, (1, -1, 0, 0, 0, 2), 3))) == {"a": True, "b": (1, -1, 0, 0, 0, 2), "c": 3}


@pytest.mark.parametrize(
    ("decode", "kind", "body", "words"),
    [
        (decode_reply, "V", b"", "'V' has 0 bytes, wanted 1"),
        (decode_reply, "v", b"\0" * 15, "'v' has 15 bytes, wanted 16"),
        (decode_reply, "M", b"\x05ab", "'M' ends inside a text"),
        (decode_reply, "M", b"\x01a\x01b\x02x", "'M' has 6 bytes, wanted 5"),
        (decode_reply, "U", b"", "'U' is empty"),
        (decode_reply, "O", b"\x01DOUBLE,\xff", "names that are not ASCII"),
        (decode_reply, "Z", b"", "unknown type 90"),
        (decode_request, "O", b"\0" * 7, "'O' has 7 bytes, wanted at least 8"),
        (decode_request, "O", b"\x7f\xf8" + b"\0" * 6, "a frequency of nan Hz"),
        (decode_request, "I", b"a,,b", "a name that is none"),
        (decode_request, "S", b"\0", "'S' has 1 bytes, wanted 0"),
    ],
)
def test_damaged_messages(decode: object, kind: str, body: bytes, words: str) -> None:
    with pytest.raises(ProtocolError, match=words):
        decode(ord(kind), body)  # type: ignore[operator]


@pytest.mark.parametrize("joints", [6, 8])
def test_samples_to_the_last_digit(joints: int) -> None:
    """Joints beyond six travel in registers; stamps and numbers arrive as they were sent, none is lost."""
    rng = np.random.default_rng(joints)
    q, current = rng.normal(size=(300, joints)), rng.normal(size=(300, joints))
    with server(joints) as bench, RtdeSource("127.0.0.1", bench.port, joints=joints) as source:
        assert source.controller == "5.23.0.0"
        for row in range(300):
            bench.publish(served(q[row], current[row], 0.002 * row))
        samples = [source.read(1.0) for _ in range(300)]
    assert all(isinstance(sample, JointSample) for sample in samples)
    np.testing.assert_array_equal([sample.position_rad for sample in samples], q)
    np.testing.assert_array_equal([sample.current_A for sample in samples], current)
    np.testing.assert_array_equal([sample.stamp_s for sample in samples], 0.002 * np.arange(300))
    assert {sample.torque_Nm for sample in samples} == {None}


def test_half_the_rate() -> None:
    zero = np.zeros(6)
    with server() as bench, RtdeSource("127.0.0.1", bench.port, frequency_hz=250) as source:
        for row in range(10):
            bench.publish(served(zero, zero, float(row)))
        stamps = [source.read(1.0).stamp_s for _ in range(5)]  # type: ignore[union-attr]
    assert stamps == [0, 2, 4, 6, 8]


def test_a_controller_that_comes_back(monkeypatch: pytest.MonkeyPatch) -> None:
    """The end of a connection and its new beginning are told, and an answer that stands is written again, at once."""
    zero, send = np.zeros(6), RtdeConnection.send_inputs
    written: list[tuple[int, int]] = []

    def noted(self: RtdeConnection, recipe: Recipe, values: tuple[int, int]) -> None:
        written.append(values)
        send(self, recipe, values)

    monkeypatch.setattr(RtdeConnection, "send_inputs", noted)
    with server() as first:
        port = first.port
        source = RtdeSource("127.0.0.1", port, answers=True)
        source.open()
        source.answer("reverse", 3)
        wait_until(lambda: first.inputs()[0]["input_int_register_24"] == 2)
        assert first.inputs()[0]["input_int_register_25"] == 3
    gone = source.read(1.0)
    assert isinstance(gone, SourceEvent)
    assert gone.kind is SourceEventKind.STOPPED
    assert "closed the connection" in gone.text
    assert source.read(0.15) is None
    with server(port=port) as second:
        again = next(item for item in (source.read(1.0) for _ in range(5)) if item is not None)
        assert isinstance(again, SourceEvent)
        assert again.kind is SourceEventKind.RESTARTED
        wait_until(lambda: second.inputs()[0]["input_int_register_24"] == 2)
        second.publish(served(zero, zero, 5.0))
        assert source.read(1.0).stamp_s == 5.0  # type: ignore[union-attr]
        source.close()
        source.close()
    # No zero between: a program on the controller would go on.
    assert written == [(0, 0), (2, 3), (2, 3)]


def wait_until(true: object, seconds: float = 2.0) -> None:
    end = time.monotonic() + seconds
    while not true():  # type: ignore[operator]
        assert time.monotonic() < end
        time.sleep(0.002)


@contextmanager
def listening(reply: bytes) -> Iterator[int]:
    """A server that says one thing to whoever comes, and then nothing."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        held = []

        def serve() -> None:
            found, _ = listener.accept()
            held.append(found)
            found.sendall(reply)

        thread = threading.Thread(target=serve)
        thread.start()
        yield listener.getsockname()[1]
        thread.join()
        for one in held:
            one.close()


def test_what_is_no_controller() -> None:
    with socket.create_server(("127.0.0.1", 0)) as one:
        free = one.getsockname()[1]
    with pytest.raises(InputError, match="Connection refused; wanted a controller of Universal Robots"):
        RtdeSource("127.0.0.1", free).open()
    with (
        listening(b"\x00\x01x") as port,
        pytest.raises(InputError, match="does not speak RTDE: a package says it has 1"),
    ):
        RtdeSource("127.0.0.1", port).open()
    with (
        listening(b"\x00\x04S\x01") as port,
        pytest.raises(InputError, match="does not speak RTDE: Accepted in answer"),
    ):
        RtdeSource("127.0.0.1", port).open()
    with listening(b"\x00\x04V\x00") as port, pytest.raises(InputError, match="does not accept version 2"):
        RtdeSource("127.0.0.1", port).open()


def test_fields_that_cannot_be_had() -> None:
    with server() as bench:
        with pytest.raises(InputError, match=r"5.23.0.0 at .* has no field actual_current_as_torque"):
            RtdeSource("127.0.0.1", bench.port, signal="torque").open()
        with RtdeSource("127.0.0.1", bench.port, answers=True):
            taken = RtdeSource("127.0.0.1", bench.port, answers=True)
            with pytest.raises(InputError, match=r"another client of .* writes input_int_register_24"):
                taken.open()
        with pytest.raises(InputError, match="has six joints, the robot has 5"):
            RtdeSource("127.0.0.1", bench.port, joints=5)
        with pytest.raises(InputError, match=r"cannot listen on .*in use.*; give another port"):
            RtdeServer({}, 500.0, port=bench.port)


def test_foreign_and_damaged_packages_are_told_and_the_next_sample_comes() -> None:
    zero = np.zeros(6)
    with server() as bench, RtdeSource("127.0.0.1", bench.port) as source:
        (client,) = bench._clients
        for message in (Data(9, b""), Data(1, b"\0" * 8)):
            with bench._lock:
                bench._send(client, message)
            bench.publish(served(zero, zero, 1.0))
        found = [source.read(1.0) for _ in range(4)]
    assert [item.kind for item in found[::2]] == [SourceEventKind.FOREIGN, SourceEventKind.DAMAGED]  # type: ignore[union-attr]
    assert all(isinstance(item, JointSample) for item in found[1::2])


def test_packages_that_begin_elsewhere_than_it_seems() -> None:
    """After three bad ones in a row, or a size that none has, the connection is made anew."""
    zero = np.zeros(6)
    with server() as bench, RtdeSource("127.0.0.1", bench.port) as source:
        for spoil, words in (
            (b"\x00\x04Z\x00" * 3, "3 bad packages in a row"),
            (b"\x70\x00U\x01", "says it has 28672"),
        ):
            (client,) = bench._clients
            with bench._lock:
                client.unsent += spoil
                bench._flush(client)
            found = []
            while not found or found[-1].kind is not SourceEventKind.RESTARTED:
                item = source.read(1.0)
                assert isinstance(item, SourceEvent), found
                found.append(item)
            assert any(words in event.text and "connecting again" in event.text for event in found)
            bench.publish(served(zero, zero, 1.0))
            assert isinstance(source.read(1.0), JointSample)


def test_a_connection_that_never_lasts_is_asked_for_ever_more_seldom(monkeypatch: pytest.MonkeyPatch) -> None:
    """It was made anew ten times a second, with two events each: a good negotiation made the pause short again."""
    fields = output_fields(6, "current")
    recipe = Recipe(1, tuple(fields), tuple(fields.values()))
    values = served(np.zeros(6), np.zeros(6), 0.0)
    body = recipe.pack(tuple(values[name] for name in fields))
    now = 0.0
    made: list[float] = []

    def sleep(seconds: float) -> None:
        nonlocal now
        now += seconds

    class Brief:
        """Gives ten packages a second and breaks when its time is over."""

        controller, texts, received_s = None, (), 0.0
        lasting_s, number = 0.0, 1

        def __init__(self, *_: object) -> None:
            made.append(now)

        def negotiate(self, *_: object) -> tuple[Recipe, Recipe]:
            return recipe, Recipe(0, (), ())

        def package(self, _: float) -> tuple[int, bytes]:
            if now - made[-1] > self.lasting_s:
                raise LostConnectionError("gone")
            sleep(0.1)
            self.received_s = now
            package = encode(Data(self.number, body))
            return package[2], package[3:]

        def close(self) -> None:
            pass

        pause = close

    monkeypatch.setattr("bumpstop.live.rtde.source.RtdeConnection", Brief)
    monkeypatch.setattr("bumpstop.live.rtde.source.time", SimpleNamespace(monotonic=lambda: now, sleep=sleep))
    longer = [0.1, 0.2, 0.4, 0.8, 1.6, 2.0, 2.0, 2.0]
    # Package by package, such as nobody asked for, and one that holds for a while.
    for Brief.lasting_s, Brief.number, pauses in ((0.05, 1, longer), (9.0, 9, longer), (2.5, 1, [0.1] * 8)):
        now, made, found = 0.0, [], []
        with RtdeSource("a") as source:
            while len(made) < 9:
                item = source.read(1.0)
                if isinstance(item, SourceEvent):
                    found.append((item, now))
        lost = [when for event, when in found if "connecting again" in event.text]
        np.testing.assert_allclose(np.subtract(made[1:], lost), pauses, atol=1e-9)
        # Each is told at once.
        assert [when for event, when in found if event.kind is SourceEventKind.RESTARTED] == made[1:]


def test_a_client_that_does_not_read_costs_the_others_nothing() -> None:
    zero = np.zeros(6)
    with (
        server() as bench,
        RtdeSource("127.0.0.1", bench.port) as silent,
        RtdeSource("127.0.0.1", bench.port) as source,
    ):
        for row in range(60000):
            bench.publish(served(zero, zero, float(row)))
            if row % 50 == 49:
                assert [source.read(1.0).stamp_s for _ in range(50)][-1] == row  # type: ignore[union-attr]
            if bench.left_out:
                break
        assert bench.left_out
        assert silent.read(1.0).stamp_s == 0  # type: ignore[union-attr]


def test_a_controller_that_lost_its_power_is_missed() -> None:
    """It ends no connection: the monitor waited at the old one for ever, while the controller was back."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        connection = RtdeConnection("127.0.0.1", listener.getsockname()[1], 1.0)
        own = connection._socket
        assert own.getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE)
        times = [own.getsockopt(socket.IPPROTO_TCP, getattr(socket, f"TCP_KEEP{name}")) for name in ("IDLE", "INTVL")]
        assert times == [1, 1]
        assert own.getsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPCNT) == 3
        assert own.getsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT) == 4000
        connection.close()
