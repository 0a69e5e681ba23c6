"""JSON schemas of the channels of a monitor's MCAP files, in the words of Foxglove and PlotJuggler."""

from __future__ import annotations

from typing import Any


def schemas(joints: tuple[str, ...]) -> dict[str, tuple[str, dict[str, Any]]]:
    """Name and JSON schema by topic; quantities by joint are objects whose keys are the joints' names.

    Args:
        joints: names.
    """
    number_or_none = {"type": ["number", "null"]}
    by_joint = _object(dict.fromkeys(joints, number_or_none))
    stamp = {"stamp_s": {"type": "number", "description": "time by the source's clock [s]"}}
    words = {"type": "string"}
    return {
        "/bumpstop/residual": (
            "bumpstop.Residual",
            _object(stamp | {"residual_Nm": by_joint}, "estimated minus predicted motor torque; null: no data"),
        ),
        "/bumpstop/threshold": (
            "bumpstop.Threshold",
            _object(stamp | {"threshold_Nm": by_joint}, "of the residual; null: not monitored"),
        ),
        "/bumpstop/state": (
            "bumpstop.State",
            _object(
                stamp
                | {
                    "state": {"type": "string", "enum": ["no_data", "arming", "monitoring", "alarm"]},
                    "state_number": {"type": "integer", "description": "place of the state in that list"},
                    "fault": words,
                    "stop": {"type": "boolean"},
                },
            ),
        ),
        "/bumpstop/alarm": (
            "bumpstop.Alarm",
            _object(
                stamp
                | {
                    "number": {"type": "integer"},
                    "latency_s": {"type": "number"},
                    "joints": {"type": "array", "items": words},
                    "residual_Nm": {"type": "array", "items": {"type": "number"}},
                    "threshold_Nm": {"type": "array", "items": number_or_none},
                    "force_N": number_or_none,
                    "force_interval_N": {"type": ["array", "null"], "items": {"type": "number"}},
                    "best_force_N": {"type": "array", "items": {"type": "number"}},
                    "link": {"type": ["string", "null"]},
                    "possible_links": {"type": "array", "items": words},
                },
            ),
        ),
        "/bumpstop/source": (
            "bumpstop.SourceEvent",
            _object({"event": words, "text": words, "count": {"type": "integer"}}),
        ),
    }


def _object(properties: dict[str, Any], description: str = "") -> dict[str, Any]:
    found: dict[str, Any] = {
        "type": "object",
        "properties": properties,
        "required": list(properties),
        "additionalProperties": False,
    }
    return found | ({"description": description} if description else {})
