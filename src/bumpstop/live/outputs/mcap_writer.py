"""One MCAP file that a killed process leaves readable, and the mending of one that it left."""

from __future__ import annotations

import contextlib
import fcntl
import os
import struct
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from bumpstop.errors import InputError
from bumpstop.live.outputs.ros_messages import TOPICS

if TYPE_CHECKING:
    from collections.abc import Iterator

    from bumpstop.live.outputs.ros_messages import RosMessages

PART = ".part"
_CHUNK_BYTES = 1 << 20


def import_mcap() -> Any:
    """The module ``mcap.writer``.

    Raises:
        InputError: it is not installed.
    """
    try:
        import mcap.writer
    except ImportError:
        raise InputError("--mcap", "needs mcap, which is not installed", "pip install 'bumpstop[live]'") from None
    return mcap.writer


class McapFile:
    """A file under ``NAME.mcap.part``, which is called ``NAME.mcap`` when it is complete.

    What is written is in the file, in chunks that can be read without its end, when :meth:`end_chunk` has returned. The
    unfinished file is locked, so that nobody mends it while it is written.

    Args:
        path: of the complete file.
        messages: whose definitions it holds.

    Attributes:
        messages: number of those added.

    Raises:
        OSError: the file cannot be written.
    """

    def __init__(self, path: Path, messages: RosMessages) -> None:
        module = import_mcap()
        self.path, self._part = path, path.with_name(path.name + PART)
        self._file: IO[bytes] = self._part.open("wb")
        fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        self._writer = module.Writer(self._file, chunk_size=_CHUNK_BYTES)
        self._writer.start(profile="ros2", library="bumpstop")
        self.channels: dict[str, int] = {}
        self.messages = 0
        known: dict[str, int] = {}
        for topic, kind in TOPICS.items():
            if kind not in known:
                known[kind] = self._writer.register_schema(kind, "ros2msg", messages.definition(kind).encode())
            self.channels[topic] = self._writer.register_channel(
                topic, "cdr", known[kind], {"offered_qos_profiles": ""}
            )
        self._file.flush()

    def add(self, topic: str, time_ns: int, data: bytes) -> None:
        """A message of one of the channels; ``time_ns``: since 1970."""
        self._writer.add_message(self.channels[topic], log_time=time_ns, publish_time=time_ns, data=data)
        self.messages += 1

    def end_chunk(self) -> None:
        """Put what was added into the file."""
        # The package ends a chunk by its size alone; the last second must be in the file whatever the rate.
        self._writer._Writer__finalize_chunk()
        self._file.flush()

    def complete(self) -> None:
        """End the file and give it its name; one without a message is removed."""
        if not self.messages:
            self.abandon()
            return
        self.end_chunk()
        self._writer.finish()
        self._file.flush()
        os.fsync(self._file.fileno())
        self._file.close()
        self._part.rename(self.path)

    def abandon(self) -> None:
        """Leave the file as it is, to be mended later; one without a message is removed."""
        # What is still buffered finds no room either.
        with contextlib.suppress(OSError):
            self._file.close()
        if self._part.exists() and next(_messages(self._part), None) is None:
            self._part.unlink()


def mend(part: Path) -> int:
    """Make a complete file of one that a killed process left; how many messages it has.

    A file without a whole message is removed.

    Raises:
        InputError: another monitor is writing it.
        OSError: it cannot be read or written.
    """
    module = import_mcap()
    path, whole = part.with_name(part.name.removesuffix(PART)), part.with_name(part.name + ".mended")
    with part.open("rb") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise InputError("--mcap", f"{str(part)!r} is being written", "give another name") from None
        count = 0
        with whole.open("wb") as file:
            writer = module.Writer(file, chunk_size=_CHUNK_BYTES)
            writer.start(profile="ros2", library="bumpstop")
            known: dict[int, int] = {}
            for schema, channel, message in _messages(part):
                if channel.id not in known:
                    number = writer.register_schema(schema.name, schema.encoding, schema.data)
                    known[channel.id] = writer.register_channel(
                        channel.topic, channel.message_encoding, number, channel.metadata
                    )
                writer.add_message(known[channel.id], message.log_time, message.data, message.publish_time)
                count += 1
            writer.finish()
            file.flush()
            os.fsync(file.fileno())
        if count:
            whole.rename(path)
        else:
            whole.unlink()
        part.unlink()
    return count


def _messages(path: Path) -> Iterator[tuple[Any, Any, Any]]:
    """Schemas, channels and messages up to where the file breaks off."""
    import zstandard
    from mcap.exceptions import McapError
    from mcap.records import Channel, Message, Schema
    from mcap.stream_reader import StreamReader

    known: dict[int, Any] = {}
    channels: dict[int, Any] = {}
    with path.open("rb") as file:
        try:
            for record in StreamReader(file, validate_crcs=True).records:
                if isinstance(record, Schema):
                    known[record.id] = record
                elif isinstance(record, Channel):
                    channels[record.id] = record
                elif isinstance(record, Message):
                    channel = channels[record.channel_id]
                    yield known[channel.schema_id], channel, record
        except (McapError, struct.error, ValueError, zstandard.ZstdError):
            return  # its last record is not whole
