"""Joint states over DDS on the loopback: any order, any QoS, every fault by its name; and what a monitor publishes."""

from __future__ import annotations

import os
import re
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bumpstop.errors import InputError
from bumpstop.live import DataLoss, JointSample, SourceEvent, SourceEventKind

pytest.importorskip("cyclonedds", reason="cyclonedds is not installed: pip install 'bumpstop[live]'")

from cyclonedds.core import DDSException, Policy, Qos
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from rosbags.typesys import Stores, get_typestore

from bumpstop.live.dds import DdsOutput, DdsSource, types
from bumpstop.live.dds.participant import domain_of, make_topic, participant, topic_name

# Runs of the tests side by side must not hear each other.
DOMAIN = 100 + os.getpid() % 100
JOINTS = ("a", "b", "c")
RELIABLE = Qos(Policy.Reliability.Reliable(0), Policy.Durability.TransientLocal, Policy.History.KeepAll)
BEST_EFFORT = Qos(Policy.Reliability.BestEffort, Policy.Durability.Volatile, Policy.History.KeepLast(1))


class Publisher:
    """A writer of its own participant, as another process has one."""

    def __init__(self, topic: str, kind: Any = types.JointState, qos: Qos = RELIABLE) -> None:
        self.participant = participant(DOMAIN, loopback=True)
        self.writer: Any = DataWriter(self.participant, make_topic(self.participant, f"rt/{topic}", kind), qos=qos)

    def close(self) -> None:
        self.writer = self.participant = None

    def states(self, names: Sequence[str], rows: Sequence[float], **given: Any) -> None:
        for row in rows:
            fields = {
                "position": [row + k for k in range(len(names))],
                "velocity": [],
                "effort": [10 * row + k for k in range(len(names))],
            } | given
            self.writer.write(types.JointState(types.header(row), list(names), **fields))


def source(topic: str, **given: Any) -> DdsSource:
    return DdsSource(topic, JOINTS, domain=DOMAIN, loopback=True, **{"wait_s": 1.0} | given)


@contextmanager
def opened(one: DdsSource, *publishers: Publisher, names: Sequence[str] = JOINTS) -> Iterator[DdsSource]:
    """Open a source while the writers write, as a source of this kind keeps nothing of what was before it."""
    done = threading.Event()

    def write() -> None:
        while not done.wait(0.02):
            for publisher in publishers:
                publisher.states(names, [0.0])

    thread = threading.Thread(target=write)
    thread.start()
    try:
        one.open()
    finally:
        done.set()
        thread.join()
    time.sleep(0.1)
    while one.read(0.0) is not None:
        pass
    yield one
    one.close()


def read(one: DdsSource, count: int) -> list[JointSample | SourceEvent]:
    found = [one.read(1.0) for _ in range(count)]
    assert all(found)
    return found  # type: ignore[return-value]


def test_names_of_topics() -> None:
    assert {topic_name(name) for name in ("/a/b_1", "a/b_1", "rt/a/b_1")} == {"rt/a/b_1"}
    for name in ("", "/", "a//b", "a b", "1a", "ä"):
        with pytest.raises(InputError, match="is no name of a topic"):
            topic_name(name)


def test_domains(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "7")
    assert (domain_of(None), domain_of(3)) == (7, 3)
    monkeypatch.setenv("ROS_DOMAIN_ID", "x")
    with pytest.raises(InputError, match="ROS_DOMAIN_ID: is 'x'; wanted a whole number from 0 to 232"):
        domain_of(None)


def test_without_cyclonedds(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "cyclonedds.domain", None)
    with pytest.raises(InputError, match=r"cyclonedds is not installed; pip install 'bumpstop\[live\]'"):
        source("nobody").open()


@pytest.mark.parametrize(("number", "qos"), list(enumerate((RELIABLE, BEST_EFFORT))))
def test_joints_in_any_order_from_any_writer(number: int, qos: Qos) -> None:
    """A gripper's joint between ours is left out; the effort is what it was said to be."""
    topic, names = f"order_{number}", ["c", "finger", "a", "b"]
    publisher = Publisher(topic, qos=qos)
    with opened(source(topic, effort="current"), publisher, names=names) as one:
        publisher.states(names, [1.0])
        time.sleep(0.02)
        publisher.states(names, [2.5])
        found = read(one, 2)
        assert [item.stamp_s for item in found if isinstance(item, JointSample)] == [1.0, 2.5]
        publisher.states(["b", "a", "c"], [3.0], velocity=[0.1, 0.2, 0.3])
        found += read(one, 1)
    samples = [item for item in found if isinstance(item, JointSample)]
    np.testing.assert_array_equal([s.position_rad for s in samples[-2:]], [[4.5, 5.5, 2.5], [4.0, 3.0, 5.0]])
    np.testing.assert_array_equal([s.current_A for s in samples[-2:]], [[27, 28, 25], [31, 30, 32]])
    np.testing.assert_array_equal(samples[-1].velocity_rad_s, [0.2, 0.1, 0.3])
    assert samples[-2].torque_Nm is None is samples[-2].velocity_rad_s
    assert samples[-1].stamp_s == 3.0


def test_no_source_and_another_type() -> None:
    with pytest.raises(InputError, match=rf"dds://rt/nobody: nobody writes it in domain {DOMAIN} within 0.2 s"):
        source("nobody", wait_s=0.2).open()
    other = Publisher("other", types.String)
    with pytest.raises(InputError, match=r"the topic carries std_msgs::msg::dds_::String_; wanted sensor_msgs"):
        source("other", wait_s=0.5).open()
    other.close()


def test_joints_of_another_robot() -> None:
    publisher = Publisher("foreign")
    words = r"no usable joint state within .*: .* lacks 'c', has 'a', 'b', 'x'; wanted a"
    with pytest.raises(InputError, match=words), opened(source("foreign"), publisher, names=["a", "b", "x"]):
        pass


def test_two_writers() -> None:
    first, second = Publisher("two"), Publisher("two")
    with (
        pytest.raises(InputError, match="two writers publish these joints; end one of them"),
        opened(source("two"), first, second),
    ):
        pass
    second.close()
    # Once one is read, another is left out, and said so.
    with opened(source("two", stop_after_s=10.0), first) as one:
        late = Publisher("two")
        time.sleep(0.1)
        late.states(JOINTS, [7.0])
        (event,) = read(one, 1)
        assert isinstance(event, SourceEvent)
        assert event.kind is SourceEventKind.FOREIGN
        assert "a second writer has the same joints" in event.text
        first.states(JOINTS, [2.0])
        (sample,) = read(one, 1)
        assert isinstance(sample, JointSample)
        # Only the first writer's end is the end of the samples.
        first.close()
        (event,) = read(one, 1)
        assert isinstance(event, SourceEvent)
        assert event.kind is SourceEventKind.STOPPED
        late.states(JOINTS, [8.0])
        event, sample = read(one, 2)
        assert isinstance(event, SourceEvent)
        assert event.kind is SourceEventKind.RESTARTED
        assert isinstance(sample, JointSample)
        assert sample.stamp_s == 8.0
    late.close()


def test_a_writer_that_was_killed_gives_way() -> None:
    """A driver that was killed is matched for seconds more: the next is read once the old one was silent."""
    old = Publisher("killed")
    with opened(source("killed", stop_after_s=0.3), old) as one:
        new = Publisher("killed")
        time.sleep(0.4)
        # What waited here does not count as a silence, in whatever order it comes.
        new.states(JOINTS, [1.0])
        old.states(JOINTS, [2.0])
        time.sleep(0.1)
        event, sample = read(one, 2)
        assert isinstance(event, SourceEvent)
        assert event.kind is SourceEventKind.FOREIGN
        assert isinstance(sample, JointSample)
        assert sample.stamp_s == 2.0
        time.sleep(0.4)
        new.states(JOINTS, [3.0])
        event, sample = read(one, 2)
        assert isinstance(event, SourceEvent)
        assert event.kind is SourceEventKind.RESTARTED
        assert re.search(r"its writer was silent for 0\.\d+ s; another with the same joints is read", event.text)
        assert isinstance(sample, JointSample)
        assert sample.stamp_s == 3.0
        # From now on the old one is the second.
        old.states(JOINTS, [4.0])
        new.states(JOINTS, [5.0])
        while not isinstance(item := one.read(1.0), JointSample):
            assert item is None or "second writer" in item.text
        assert item.stamp_s == 5.0
    old.close()
    new.close()


@pytest.mark.parametrize(
    ("names", "given", "words"),
    [
        (JOINTS, {"position": [1.0]}, "has 1 values of position for 3 names"),
        (JOINTS, {"effort": []}, "has 0 values of effort for 3 names"),
        (JOINTS, {"velocity": [1.0]}, "has 1 values of velocity for 3 names"),
        ((*JOINTS, "a"), {}, "names 'a' twice"),
    ],
)
def test_damaged_states(names: Sequence[str], given: dict[str, Any], words: str) -> None:
    one = source("damaged")
    state = types.JointState(types.header(1.0), list(names), [0.0] * len(names), [], [0.0] * len(names))
    for field, value in given.items():
        setattr(state, field, value)
    one.take_state(state, 1, 0.0)
    event = one.read(0.0) if one._queue else None
    assert isinstance(event, SourceEvent)
    assert event.kind is SourceEventKind.DAMAGED
    assert words in event.text


def test_a_state_without_joints_is_none_of_the_arm() -> None:
    """A node that publishes empty states before the arm's driver begins is not taken for its driver."""
    one = source("empty")
    empty = types.JointState(types.header(1.0), [], [], [], [])
    one.take_state(empty, 1, 0.0)
    (event,) = one._queue
    assert isinstance(event, SourceEvent)
    assert event.kind is SourceEventKind.FOREIGN
    assert "a joint state lacks 'a', 'b', 'c', names no joint" in event.text
    one.take_state(types.JointState(types.header(2.0), list(JOINTS), [0.0] * 3, [], [0.0] * 3), 2, 0.0)
    sample = one._queue[-1]
    assert isinstance(sample, JointSample)
    assert sample.position_rad.size == 3


def test_bytes_that_are_no_state_take_no_sample_away() -> None:
    class Damaged(types.JointState, typename="sensor_msgs::msg::dds_::JointState_"):
        payload = b""

        def serialize(self, *given: Any, **more: Any) -> bytes:
            return self.payload

    publisher = Publisher("bytes")
    good = types.JointState(types.header(1.0), list(JOINTS), [0.0] * 3, [], [0.0] * 3).serialize()
    rng = np.random.default_rng(4)
    with opened(source("bytes"), publisher) as one:
        for row in range(1, 101):
            bad = bytearray(good)
            # Names that are no text come through; those of 'a', 'b' and 'c' are at 28, 36 and 44.
            bad[int(rng.integers(4, len(bad))) if row % 5 else int(rng.choice([28, 36, 44]))] = 255
            message = Damaged(types.header(1.0), [], [], [], [])
            message.payload = bytes(bad)
            # Most of what contradicts itself Cyclone takes from nobody, neither here nor from the network.
            with suppress(DDSException):
                publisher.writer.write(message)
            publisher.states(JOINTS, [1e6 + row])
        stamps, told = [], 0
        while (item := one.read(0.2)) is not None:
            if isinstance(item, JointSample):
                stamps.append(item.stamp_s)
            else:
                told += item.count
        told += sum(event.count for event in one._limiter.due(0.0, final=True))
    assert told >= 20
    assert [stamp for stamp in stamps if 1e6 < stamp < 1e6 + 1000] == [1e6 + row for row in range(1, 101)]


def test_messages_are_those_of_ros() -> None:
    """Bytes of every type are read by another reader of CDR, by the published definitions of the messages."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    head = types.header(12.5, "base")
    vector = types.Vector3(1.0, 2.0, 3.0)
    found = {
        "sensor_msgs/msg/JointState": types.JointState(head, ["a", "bc"], [1.0, 2.0], [], [3.0, np.nan]),
        "std_msgs/msg/Bool": types.Bool(True),
        "std_msgs/msg/String": types.String("alarm"),
        "geometry_msgs/msg/WrenchStamped": types.WrenchStamped(head, types.Wrench(vector, vector)),
    }
    for name, message in found.items():
        again = store.deserialize_cdr(message.serialize(), name)
        assert same(again, message), name


def same(theirs: Any, ours: Any) -> bool:
    if hasattr(ours, "__dataclass_fields__"):
        return all(same(getattr(theirs, name), getattr(ours, name)) for name in ours.__dataclass_fields__)
    if isinstance(ours, list) and ours and isinstance(ours[0], float):
        return bool(np.array_equal(theirs, ours, equal_nan=True))
    return list(theirs) == ours if isinstance(ours, list) else bool(theirs == ours)


def test_topics_of_two_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    """A class of messages is prepared by one thread at a time: cyclonedds refuses one that comes meanwhile."""
    inside, met = threading.Semaphore(1), []
    prepare = types.Bool.__idl__.fill_type_data

    def slowly() -> None:
        alone = inside.acquire(blocking=False)
        met.append(alone)
        time.sleep(0.05)
        prepare()
        if alone:
            inside.release()

    monkeypatch.setattr(types.Bool.__idl__, "fill_type_data", slowly)
    joined = participant(DOMAIN, loopback=True)
    makers = [threading.Thread(target=make_topic, args=(joined, f"rt/together_{k}", types.Bool)) for k in range(3)]
    for maker in makers:
        maker.start()
    for maker in makers:
        maker.join()
    assert met == [True] * 3


def test_output() -> None:
    joined = participant(DOMAIN, loopback=True)
    kinds = {"residual": types.JointState, "state": types.String, "alarm": types.Bool, "wrench": types.WrenchStamped}
    keep = Qos(Policy.Reliability.Reliable(0), Policy.History.KeepAll)
    readers: dict[str, Any] = {
        name: DataReader(joined, make_topic(joined, f"rt/cell/{name}", kind), qos=keep) for name, kind in kinds.items()
    }
    output = DdsOutput(JOINTS, frame="base_link", prefix="/cell", domain=DOMAIN, loopback=True)
    time.sleep(0.3)
    sample = JointSample(stamp_s=4.25, received_s=0.0, position_rad=np.zeros(3))
    tick: Any = SimpleNamespace(sample=sample, state="alarm", alarm=True, residual=np.array([1.0, -2.0, np.nan]))
    event = SimpleNamespace(force=np.array([0.0, 0.0, -30.5]))
    output.alarm(SimpleNamespace(stamp_s=4.25, event=event, number=1))  # type: ignore[arg-type]
    output.tick(tick)
    output.data_loss(DataLoss(fault="stopped", alarm=True, received_s=0.0))
    output.data_loss(DataLoss(fault="ended", received_s=0.0))
    time.sleep(0.2)
    taken = {name: reader.take(10) for name, reader in readers.items()}
    (residual,), (wrench,) = taken["residual"], taken["wrench"]
    assert residual.name == list(JOINTS)
    np.testing.assert_array_equal(residual.effort, [1.0, -2.0, np.nan])
    assert (residual.header.stamp.sec, residual.header.stamp.nanosec) == (4, 250_000_000)
    assert (wrench.wrench.force.z, wrench.header.frame_id) == (-30.5, "base_link")
    assert [message.data for message in taken["alarm"]] == [True, True, True, False]
    assert [message.data for message in taken["state"]] == ["alarm", "no_data", "no_data"]
    assert output.problems() == []
    output.close()
    output.tick(tick)
    assert "1 messages of state could not be published" in output.problems()
