"""Joining a DDS domain as ROS 2 does, and its names of topics."""

from __future__ import annotations

import os
import threading
from typing import Any

from bumpstop.errors import InputError

LOOPBACK = """<CycloneDDS><Domain>
<General><Interfaces><NetworkInterface name="lo" multicast="false"/></Interfaces>
<AllowMulticast>false</AllowMulticast></General>
<Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>60</MaxAutoParticipantIndex>
<Peers><Peer address="127.0.0.1"/></Peers></Discovery>
</Domain></CycloneDDS>"""
MAX_DOMAIN = 232

_lock = threading.Lock()
# Domains of this process: one may be set up once only, and lives as long as the process.
_domains: dict[int, Any] = {}


def import_cyclonedds() -> Any:
    """The module, or an error that says how to get it."""
    try:
        import cyclonedds.domain
    except ImportError:
        raise InputError("dds", "cyclonedds is not installed", "pip install 'bumpstop[live]'") from None
    return cyclonedds


def domain_of(value: int | None) -> int:
    """The domain given, else that of ``ROS_DOMAIN_ID``, else 0.

    Raises:
        InputError: it is no domain.
    """
    field, given = "domain", value
    if value is None:
        field, text = "ROS_DOMAIN_ID", os.environ.get("ROS_DOMAIN_ID", "") or "0"
        given = int(text) if text.isascii() and text.isdigit() else -1
    if given is None or not 0 <= given <= MAX_DOMAIN:
        problem = f"is {os.environ.get('ROS_DOMAIN_ID')!r}" if value is None else f"is {value}"
        raise InputError(field, problem, f"wanted a whole number from 0 to {MAX_DOMAIN}")
    return given


def on_loopback_only() -> bool:
    """Whether the environment keeps ROS 2 on this machine: ``ROS_LOCALHOST_ONLY=1`` or its successor."""
    found = os.environ.get
    return found("ROS_LOCALHOST_ONLY") == "1" or found("ROS_AUTOMATIC_DISCOVERY_RANGE") in ("LOCALHOST", "OFF")


def participant(domain: int, *, loopback: bool) -> Any:
    """A participant of a domain; the first of a process decides for all of them whether they stay on the loopback.

    Args:
        domain: its number.
        loopback: use the loopback alone, without multicast. Otherwise Cyclone's own configuration counts.

    Raises:
        InputError: cyclonedds is not installed, or cannot use the network.
    """
    module = import_cyclonedds()
    from cyclonedds.core import DDSException

    try:
        with _lock:
            if loopback and domain not in _domains:
                _domains[domain] = module.domain.Domain(domain, LOOPBACK)
        return module.domain.DomainParticipant(domain)
    except DDSException as error:
        raise InputError("dds", f"cannot join domain {domain}: {error.msg or error}", "is the network up?") from None


def make_topic(joined: Any, name: str, kind: Any) -> Any:
    """A topic of a participant, made by one thread at a time.

    cyclonedds prepares a class of messages at its first topic, and a second thread that comes meanwhile is refused.

    Args:
        joined: the participant.
        name: DDS name.
        kind: class of its messages.
    """
    from cyclonedds.topic import Topic

    with _lock:
        return Topic(joined, name, kind)


def topic_name(name: str) -> str:
    """DDS name of a ROS 2 topic: ``/joint_states``, ``joint_states`` and ``rt/joint_states`` are one.

    Raises:
        InputError: it is no name of a topic.
    """
    bare = name.removeprefix("rt/") if name.startswith("rt/") else name.removeprefix("/")
    parts = bare.split("/")
    if not all(part.isascii() and part.replace("_", "a").isalnum() and not part[0].isdigit() for part in parts):
        raise InputError("topic", f"{name!r} is no name of a topic", "wanted such as /joint_states")
    return f"rt/{bare}"
