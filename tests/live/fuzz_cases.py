"""Random and mutated messages for both sources, and what must come of them."""

from __future__ import annotations

import random
import struct
from collections import Counter
from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np

from bumpstop.live import JointSample, SourceEvent, SourceEventKind
from bumpstop.live.dds.source import DdsSource
from bumpstop.live.rtde.connection import RtdeConnection
from bumpstop.live.rtde.fields import ProtocolError, Recipe
from bumpstop.live.rtde.messages import (
    MAX_TEXT_PACKAGE,
    Accepted,
    ControllerVersion,
    Data,
    PackageReader,
    RecipeReply,
    SetupInputs,
    SetupOutputs,
    Text,
    decode_reply,
    decode_request,
    encode,
)
from bumpstop.live.rtde.source import RtdeSource, output_fields

FIELDS = output_fields(6, "current")
RECIPE = Recipe(1, tuple(FIELDS), tuple(FIELDS.values()))
JOINTS = ("a", "b", "c")


@dataclass
class FuzzCount:
    """What came of the messages."""

    messages: int = 0
    samples: int = 0
    bad: int = 0
    rejected: int = 0
    kinds: Counter[str] = field(default_factory=Counter)


def fuzz_decoders(rng: np.random.Generator, count: int) -> FuzzCount:
    """Both decoders and the cutter of packages: a message is taken exactly or refused with ProtocolError."""
    found, draw = FuzzCount(), stream(rng)
    seeds = [
        encode(message)
        for message in (
            Accepted("V", True),
            ControllerVersion(5, 23, 0, 1),
            RecipeReply("O", 1, tuple(FIELDS.values())),
            SetupOutputs(500.0, tuple(FIELDS)),
            SetupInputs(("input_int_register_24",)),
            Text("hello", "controller", 2),
            Data(1, RECIPE.pack((1.0, (0.0,) * 6, (0.0,) * 6, (0.0,) * 6))),
        )
    ]
    for _ in range(count):
        found.messages += 1
        if draw.random() < 0.3:
            kind = draw.choice(b"VvMUOISP\0\xff")
            body = draw.randbytes(draw.randrange(40))
        else:
            reader = PackageReader()
            reader.feed(mutated(draw, draw.choice(seeds)))
            try:
                package = reader.take()
            except ProtocolError:
                found.rejected += 1
                continue
            if package is None:
                continue
            kind, body = package
        for decode in (decode_request, decode_reply):
            try:
                message = decode(kind, body)
            except ProtocolError:
                found.rejected += 1
                continue
            found.kinds[type(message).__name__] += 1
            again = encode(message)
            assert decode(again[2], again[3:]) == message or np.isnan(getattr(message, "frequency_hz", 0))
    return found


def stream(rng: np.random.Generator) -> random.Random:
    """Random numbers one at a time, which numpy is slow at."""
    return random.Random(int(rng.integers(2**62)))


def mutated(draw: random.Random, package: bytes) -> bytes:
    """A package with a few bytes changed, cut off or added."""
    out = bytearray(package)
    for _ in range(draw.randrange(4)):
        what = draw.randrange(4)
        at = draw.randrange(len(out)) if out else 0
        if what == 0 and out:
            out[at] ^= 1 << draw.randrange(8)
        elif what == 1 and out:
            out[at] = draw.randrange(256)
        elif what == 2:
            del out[at:]
        else:
            out[at:at] = draw.randbytes(draw.randrange(1, 5))
    return bytes(out)


class MemoryConnection(RtdeConnection):
    """A connection whose bytes are given, in pieces of any size."""

    def __init__(self, pieces: list[bytes]) -> None:
        self.where, self.controller, self.texts = "memory", None, []
        self._packages, self._pieces, self.received_s = PackageReader(), pieces, 0.0
        self.expect(RECIPE)

    def close(self) -> None:
        pass

    def _receive(self, timeout_s: float) -> bytes:
        return self._pieces.pop(0) if self._pieces else b""


class MemorySource(RtdeSource):
    """A source whose connections are in memory, and made anew without waiting."""

    def __init__(self, connections: list[list[bytes]]) -> None:
        super().__init__("memory")
        self.connections = connections
        self._outputs = RECIPE

    def _connected(self, timeout_s: float) -> RtdeConnection:
        return MemoryConnection(self.connections.pop(0))

    def _try_again(self, timeout_s: float) -> None:
        self._next_trial = 0.0
        super()._try_again(timeout_s)


def fuzz_rtde_source(rng: np.random.Generator, count: int) -> FuzzCount:
    """A source between good and mutated packages.

    Stamps of good samples count up. Up to the first package whose length is wrong nothing may be missing; every other
    package is a sample or stands in the count of an event; after a connection is lost, the next one is read.
    """
    found, draw, stamp = FuzzCount(), stream(rng), 0
    while found.messages < count:
        batch = draw.randrange(20, 200)
        sent: list[bytes] = []
        expected: list[float] = []
        framed, fitted = True, draw.random() < 0.7
        for _ in range(batch):
            stamp += 1
            package = good_package(stamp)
            if draw.random() < 0.15:
                package = mutated(draw, package)
                if fitted:
                    package = struct.pack(">H", max(3, len(package))) + package[2:].ljust(1, b"U")
                framed = framed and len(package) >= 3 and struct.unpack(">H", package[:2])[0] == len(package)
            elif framed:
                expected.append(float(stamp))
            sent.append(package)
        stamp += 1
        last = float(stamp)
        source = MemorySource([pieces(draw, b"".join(sent)), [good_package(stamp)]])
        source.open()
        items = drain(source)
        samples = [item.stamp_s for item in items if isinstance(item, JointSample)]
        events = [item for item in items if isinstance(item, SourceEvent)]
        lost = [event for event in events if "connecting again" in event.text]
        told = sum(event.count for event in events if event not in lost and event.kind is not SourceEventKind.RESTARTED)
        known = set(samples)
        # Before the first loss every good sample is there, in the order in which it was sent.
        if framed and not lost:
            rest = iter(samples)
            assert all(stamp in rest for stamp in expected), "a good sample is missing, or out of order"
            # A text of the controller that asks nobody's attention is no gap in the samples.
            assert batch - 3 <= len(samples) + told <= batch, (batch, len(samples), told)
        if lost:
            assert last in known, "the connection that was made anew was not read"
            assert sum(event.kind is SourceEventKind.RESTARTED for event in events) == len(lost)
        elif len(samples) < batch:
            assert isinstance(source._connection, MemoryConnection)
            # What a package may still wait for is two or three samples.
            missing = (batch - len(samples)) * len(good_package(0))
            assert events or missing <= MAX_TEXT_PACKAGE, "samples are missing and nobody said so"
        found.messages += batch
        found.samples += len(samples)
        found.bad += told
        found.kinds.update(str(event.kind) for event in events)
    return found


def good_package(stamp: int) -> bytes:
    """A data package whose sample has this time."""
    six = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
    return encode(Data(1, RECIPE.pack((float(stamp), six, six, six))))


def pieces(draw: random.Random, data: bytes) -> list[bytes]:
    """The bytes, cut anywhere."""
    cuts = sorted(draw.randrange(len(data) + 1) for _ in range(draw.randrange(1, 30)))
    return [piece for piece in (data[a:b] for a, b in zip([0, *cuts], [*cuts, len(data)], strict=True)) if piece]


def drain(source: RtdeSource | DdsSource) -> list[JointSample | SourceEvent]:
    """Everything a source still has to say."""
    found: list[JointSample | SourceEvent] = []
    silent = 0
    while silent < 40:
        item = source.read(0.0)
        silent = silent + 1 if item is None else 0
        if item is not None:
            found.append(item)
    return [*found, *source._limiter.due(0.0, final=True)]


def fuzz_dds_source(rng: np.random.Generator, count: int) -> FuzzCount:
    """Random joint states: each is a sample or stands in the count of an event, as an independent look at it says."""
    found, draw = FuzzCount(), stream(rng)
    source = DdsSource("/joint_states", JOINTS, effort="current")
    source._reader = SimpleNamespace(get_matched_publications=lambda: [1, 2])
    names = ("a", "b", "c", "finger", "")
    expected = 0
    for number in range(count):
        state, writer = random_state(draw, names), draw.randrange(1, 3) if number else 1
        if not number:
            state = SimpleNamespace(
                header=state.header, name=["c", "a", "b"], position=[0.0] * 3, velocity=[], effort=[0.0] * 3
            )
            state.header.stamp.nanosec = 0
        lengths = {len(state.name), len(state.position), len(state.effort), len(state.velocity) or len(state.name)}
        usable = set(JOINTS) <= set(state.name) and len(set(state.name)) == len(state.name) and len(lengths) == 1
        expected += usable and state.header.stamp.nanosec < 10**9 and writer == 1
        source.take_state(state, writer, 0.001 * number)
        while source._queue:
            item = source._queue.popleft()
            if isinstance(item, JointSample):
                found.samples += 1
                where = [state.name.index(name) for name in JOINTS]
                expected_q = [state.position[row] for row in where]
                assert np.array_equal(item.position_rad, expected_q, equal_nan=True)
            else:
                found.bad += item.count
                found.kinds[str(item.kind)] += item.count
        found.messages += 1
    found.bad += sum(event.count for event in source._limiter.due(0.0, final=True))
    assert found.samples == expected
    assert found.samples + found.bad == found.messages
    return found


def random_state(draw: random.Random, names: tuple[str, ...]) -> SimpleNamespace:
    """A joint state that is good in about a third of all cases."""
    chosen = draw.sample(JOINTS, 3) if draw.random() < 0.7 else [draw.choice(names) for _ in range(draw.randrange(7))]
    if draw.random() < 0.3:
        chosen.insert(draw.randrange(len(chosen) + 1), draw.choice(names))
    n = len(chosen)

    def values(may_be_empty: bool) -> list[float]:
        size = n if draw.random() < 0.9 else draw.randrange(9)
        size = 0 if may_be_empty and draw.random() < 0.5 else size
        return draw.choices((0.0, 1.5, -3.0, np.nan, np.inf, 1e308), k=size)

    nanosec = draw.randrange(2**32 if draw.random() < 0.1 else 10**9)
    stamp = SimpleNamespace(sec=draw.randrange(-(2**31), 2**31), nanosec=nanosec)
    return SimpleNamespace(
        header=SimpleNamespace(stamp=stamp, frame_id=""),
        name=chosen,
        position=values(False),
        velocity=values(True),
        effort=values(False),
    )
