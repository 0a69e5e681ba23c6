"""Which source a SOURCE argument names: a recording, ``plant:FILE``, ``rtde://HOST`` or ``dds://TOPIC``."""

from __future__ import annotations

import importlib
import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qsl, urlsplit

from bumpstop.errors import InputError, near_matches
from bumpstop.live.source import stop_time

if TYPE_CHECKING:
    from bumpstop.live.loaded_detector import LoadedDetector
    from bumpstop.live.source import Source

WANTED = "wanted a recording's file, plant:EXPERIMENT.toml, rtde://HOST[:PORT] or dds://TOPIC"


@dataclass(frozen=True, kw_only=True)
class SourceOptions:
    """What a recording needs to be read, and how fast it is played.

    Attributes:
        speed: of recordings and the plant; infinite: as fast as it goes; None: in real time.
        columns: column file of a recording.
        topic: of a bag.
        answers: whether the source must be able to answer alarms.
        stop_after_s: without a sample for longer a writer of DDS gives way to another [s]; None: :func:`stop_time` of
            the detector.
    """

    speed: float | None = None
    columns: Path | None = None
    topic: str | None = None
    answers: bool = False
    stop_after_s: float | None = None


def source_of(text: str, detector: LoadedDetector, options: SourceOptions | None = None) -> Source:
    """The source that a user names, not yet open.

    Args:
        text: the SOURCE argument.
        detector: that its samples are for.
        options: of recordings and the plant.

    Raises:
        InputError: there is none of that kind, its file cannot be used, or options have no meaning with it.
    """
    given = options or SourceOptions()
    scheme, _, rest = text.partition(":")
    if scheme in ("rtde", "dds") and rest.startswith("//"):
        _refuse(given, scheme, ("speed", "columns", "topic"))
        made = _rtde if scheme == "rtde" else _dds
        return made(text, detector, given)
    if scheme == "plant":
        _refuse(given, "the plant", ("columns", "topic"))
        return _plant(text, rest, detector, given)
    if "://" in text:
        raise InputError("SOURCE", f"{text!r}: {scheme!r} is no kind of source", near_matches(scheme, ("rtde", "dds")))
    if given.answers:
        raise InputError("--answer", "has no meaning with a recording", "leave it out")
    return _recording(text, detector, given)


def _refuse(given: SourceOptions, kind: str, names: tuple[str, ...]) -> None:
    for name in names:
        if getattr(given, name) is not None:
            raise InputError(f"--{name}", f"has no meaning with {kind}", "leave it out")


def _recording(text: str, detector: LoadedDetector, given: SourceOptions) -> Source:
    from bumpstop.detection.rate import recorded_period
    from bumpstop.live.sources.recording import RecordingSource
    from bumpstop.recording import Recording
    from bumpstop.recording.reading import names_in_columns, robot_notes

    if not Path(text).exists():
        raise InputError("SOURCE", f"{text!r} does not exist", WANTED)
    # As on a network, bad rows are told, however many.
    log = Recording.load(text, columns=given.columns, topic=given.topic, joint_names=detector.joints, max_bad=1.0)
    if log.dof != detector.dof:
        raise InputError(
            "SOURCE", f"{text!r} has {log.dof} joints", f"the detector's {detector.robot} has {detector.dof}"
        )
    named, bag = names_in_columns(Path(text), given.columns)
    # A column file says which joint is which; of a bag it has put them into the detector's order, as for `detect`.
    if log.joint_names and log.joint_names != detector.joints and not (bag and named):
        if set(log.joint_names) == set(detector.joints):
            order = [log.joint_names.index(name) for name in detector.joints]
            log = _reordered(log, order, detector.joints)
        elif not named:
            foreign = next(name for name in log.joint_names if name not in detector.joints)
            raise InputError("SOURCE", f"{text!r} has a joint {foreign!r}", near_matches(foreign, detector.joints))
    if (log.current if detector.takes_current else log.tau) is None:
        raise InputError("SOURCE", f"{text!r} has no {detector.signal}", f"the detector takes {detector.signal}s")
    if detector.measured_rates and log.qd is None:
        raise InputError("SOURCE", f"{text!r} has no joint speeds", "the detector takes measured ones")
    recorded = recorded_period(log.t)
    if recorded is not None:
        _check_rate(text, recorded, detector)
    # Arms of one maker share the names of their joints.
    notes = robot_notes(log.robot, detector.robot)
    return RecordingSource(log, 1.0 if given.speed is None else given.speed, text, notes)


def _check_rate(text: str, period_s: float, detector: LoadedDetector) -> None:
    """Refuse a source whose rate is known and is another than the detector's, as ``bumpstop detect`` does."""
    from bumpstop.detection.rate import same_period

    if not same_period(period_s, detector.period_s):
        problem = f"{text!r} gives a sample every {period_s:.6g} s"
        raise InputError("SOURCE", problem, f"the detector is made for one every {detector.period_s:.6g} s")


def _reordered(log: Any, order: list[int], names: tuple[str, ...]) -> Any:
    from dataclasses import replace

    columns = ("q", "qd", "current", "tau", "q_ref")
    moved = {name: None if getattr(log, name) is None else getattr(log, name)[:, order] for name in columns}
    return replace(log, **moved, joint_names=names)


def _plant(text: str, rest: str, detector: LoadedDetector, given: SourceOptions) -> Source:
    from bumpstop.live.sources.plant import PlantSource
    from bumpstop.plant import Experiment

    if not rest:
        raise InputError(
            "SOURCE", f"{text!r} names no experiment", "for example plant:examples/plant/01_press_foam.toml"
        )
    source = PlantSource(Experiment.load(rest), 1.0 if given.speed is None else given.speed, text)
    _check_rate(text, source.period_s, detector)
    if not detector.takes_current and not source.gives_torques:
        raise InputError("SOURCE", f"{text!r} has currents of a joint model", "the detector takes torques")
    if source.joints != detector.joints:
        problem = f"{text!r} moves the joints {', '.join(source.joints)}"
        raise InputError("SOURCE", problem, f"the detector's {detector.robot} has {', '.join(detector.joints)}")
    return source


def _query(text: str, known: tuple[str, ...]) -> tuple[Any, dict[str, str]]:
    try:
        parts = urlsplit(text)
        _ = parts.port
        query = dict(parse_qsl(parts.query, keep_blank_values=True, strict_parsing=bool(parts.query)))
    except ValueError as error:
        raise InputError("SOURCE", f"{text!r}: {error}", WANTED) from None
    for key in query:
        if key not in known:
            raise InputError("SOURCE", f"{text!r}: {key!r} is no option", near_matches(key, known))
    if not parts.netloc:
        raise InputError("SOURCE", f"{text!r} names nothing", WANTED)
    return parts, query


def _rtde(text: str, detector: LoadedDetector, given: SourceOptions) -> Source:
    from bumpstop.live.rtde.axes import CONTROLLER_JOINTS, DEFAULT_AXES, check_turning, read_axes
    from bumpstop.live.rtde.source import MAX_FREQUENCY_HZ, RtdeSource

    parts, query = _query(text, ("signal", "frequency", "axes"))
    if not parts.hostname:
        raise InputError("SOURCE", f"{text!r} names no host", WANTED)
    axes = read_axes(query["axes"]) if "axes" in query else DEFAULT_AXES
    more: dict[str, Any] = {"answers": given.answers, "axes": axes} | (
        {} if parts.port is None else {"port": parts.port}
    )
    more["frequency_hz"] = _number(query, "frequency", min(MAX_FREQUENCY_HZ, 1 / detector.period_s))
    _check_signal(query, "signal", detector)
    source = RtdeSource(parts.hostname, joints=detector.dof, signal=detector.signal, **more)
    if detector.measured_rates and detector.dof > CONTROLLER_JOINTS:
        problem = f"{text!r} has no speeds of the joints in registers"
        raise InputError("SOURCE", problem, "the detector takes measured ones")
    _check_rate(text, 1 / more["frequency_hz"], detector)
    check_turning(axes, detector.joints, [unit == "N" for unit in detector.units])
    return source


def _dds(text: str, detector: LoadedDetector, given: SourceOptions) -> Source:
    parts, query = _query(text, ("domain", "effort"))
    made = _imported("bumpstop.live.dds.source", "DdsSource")
    stop_after = stop_time(detector.period_s) if given.stop_after_s is None else given.stop_after_s
    more: dict[str, Any] = {"answers": given.answers, "stop_after_s": stop_after}
    if "domain" in query:
        if not (query["domain"].isascii() and query["domain"].isdigit()):
            raise InputError("SOURCE", f"domain is {query['domain']!r}", "wanted a whole number")
        more["domain"] = int(query["domain"])
    topic = parts.netloc + parts.path
    _check_signal(query, "effort", detector)
    source: Source = made(topic, detector.joints, effort=detector.signal, **more)
    return source


def _check_signal(query: dict[str, str], key: str, detector: LoadedDetector) -> None:
    """Refuse a signal of which the detector could not take a single sample."""
    given = query.get(key, detector.signal)
    if given != detector.signal:
        raise InputError("SOURCE", f"{key} is {given!r}", f"the detector takes {detector.signal}s: {detector.signal!r}")


def _number(query: dict[str, str], key: str, otherwise: float) -> float:
    try:
        value = float(query.get(key, otherwise))
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError("SOURCE", f"{key} is {query[key]!r}", "wanted a number")
    return value


def _imported(module: str, name: str) -> Any:
    try:
        return getattr(importlib.import_module(module), name)
    except ModuleNotFoundError as error:
        raise InputError("SOURCE", f"needs {error.name}", "pip install 'bumpstop[live]'") from None
