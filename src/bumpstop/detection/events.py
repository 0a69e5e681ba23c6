"""Alarms that a detector raises: when, which joints, what force, where."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from bumpstop import _native
from bumpstop.arrays import FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Event:
    """From the first tick at which some joint is over its threshold to the last, but for pauses.

    What comes after a pause of the settings' ``event_pause_s``, while the alarm still stands, is an event of its own: a
    false alarm hides no contact behind it. Forces are those of the arm on the body: they raise the residual by J_v' F.

    Attributes:
        t: of the first tick [s].
        end: of the last tick over a threshold [s].
        joints: numbers (from 0) of the joints over their threshold in the first tick.
        fast_joints: of those over that of the band-pass channel.
        residual: (n,) in the first tick [Nm or N].
        threshold: (n,) in the first tick [Nm or N].
        largest_residual: (n,) by joint, the one of the largest magnitude in any tick over a threshold [Nm or N].
        largest_t: when the largest one in units of its threshold was [s].
        largest_joint: whose that was (from 0); None: the band-pass channel alone watches.
        q: (n,) in the first tick [rad or m].
        hidden: (n,) torque that friction may have hidden, as the joint stood still [Nm or N]; zero: it moved.
        force_along: along the direction asked for, by least squares [N].
        force_along_sd: its standard deviation; infinite: the direction loads no joint that counts [N].
        force: (3,) shortest force at the point asked for that fits best, base frame; NaN: no joint counts there [N].
        force_sd: (3,) standard deviations of its components, by the noise of the residual; it is known along directions
            that load a joint, and zero along others; NaN with the force [N].
        leftover: what that force leaves over, in standard deviations of the noise, of the worst joint.
        link: name of the likeliest link; None: no joint is monitored.
        possible_links: all whose contact could explain the residual within three standard deviations.
        payload_change_kg: mass that explains the residuals of the last seconds, or None where none does.
    """

    t: float
    end: float
    joints: tuple[int, ...]
    fast_joints: tuple[int, ...]
    residual: FloatArray
    threshold: FloatArray
    largest_residual: FloatArray
    largest_t: float
    largest_joint: int | None
    q: FloatArray
    hidden: FloatArray
    force_along: float
    force_along_sd: float
    force: FloatArray
    force_sd: FloatArray
    leftover: float
    link: str | None
    possible_links: tuple[str, ...]
    payload_change_kg: float | None = None

    @classmethod
    def of(
        cls, links: Sequence[str], contact: _native.ContactEstimate, span: _native.EventSpan, **fields: Any
    ) -> Event:
        """An event from what its residual says of a contact, and how long it lasts.

        Args:
            links: (n,) names, of the joint that moves each.
            contact: of its residual.
            span: of the event.
            fields: the other attributes.
        """
        return cls(
            end=span.end,
            largest_residual=np.array(span.largest[: len(links)]),
            largest_t=span.largest_time if span.largest_joint >= 0 else span.begin,
            largest_joint=span.largest_joint if span.largest_joint >= 0 else None,
            force_along=contact.force_along,
            force_along_sd=contact.force_along_sd,
            force=np.array(contact.force),
            force_sd=np.array(contact.force_sd),
            leftover=contact.leftover,
            link=links[contact.link] if contact.link >= 0 else None,
            possible_links=tuple(links[i] for i in bits(contact.possible)),
            **fields,
        )

    @classmethod
    def of_loop(cls, links: Sequence[str], found: _native.DetectorEvent) -> Event:
        """The same of a control loop's event; ``links`` as for :meth:`of`."""
        n = len(links)
        return cls.of(
            links,
            found.contact,
            found.span,
            t=found.t,
            joints=bits(found.over),
            fast_joints=bits(found.over_fast),
            residual=np.array(found.residual[:n]),
            threshold=np.array(found.threshold[:n]),
            q=np.array(found.q[:n]),
            hidden=np.array(found.hidden[:n]),
            payload_change_kg=found.payload_change if found.payload_changed else None,
        )

    @property
    def force_interval(self) -> tuple[float, float]:
        """Two standard deviations to either side of ``force_along`` [N]."""
        return self.force_along - 2 * self.force_along_sd, self.force_along + 2 * self.force_along_sd

    @property
    def standing(self) -> tuple[int, ...]:
        """Numbers (from 0) of the joints whose friction may have hidden a part of the contact."""
        return tuple(int(j) for j in np.flatnonzero(self.hidden > 0))

    def cells(self, units: Sequence[str]) -> tuple[str, ...]:
        """Cells of a table: times, joints, residuals, the largest, force with two standard deviations, links."""
        joints = sorted({*self.joints, *self.fast_joints})
        at, sd = self.largest_joint, self.force_along_sd
        return (
            f"{self.t:.4f}",
            f"{self.end:.4f}",
            ", ".join(str(j + 1) for j in joints),
            ", ".join(f"{self.residual[j]:.3g} {units[j]}" for j in joints),
            "-" if at is None else f"{self.largest_residual[at]:.3g} {units[at]} (joint {at + 1})",
            f"{self.force_along:.3g} +- {2 * sd:.2g}" if math.isfinite(sd) else "not detectable",
            self.link or "-",
            ", ".join(self.possible_links) or "none",
        )

    def to_json(self) -> dict[str, Any]:
        """For programs; joints are numbered from 1."""
        told, best = math.isfinite(self.force_along_sd), np.isfinite(self.force).all()
        return {
            "t": self.t,
            "begin_s": self.t,
            "end_s": self.end,
            "joints": [j + 1 for j in self.joints],
            "fast_joints": [j + 1 for j in self.fast_joints],
            "residual_Nm": self.residual.tolist(),
            "threshold_Nm": [None if np.isinf(x) else float(x) for x in self.threshold],
            "largest_residual_Nm": self.largest_residual.tolist(),
            "largest_s": self.largest_t,
            "largest_joint": None if self.largest_joint is None else self.largest_joint + 1,
            "force_N": self.force_along if told else None,
            "force_interval_N": list(self.force_interval) if told else None,
            "standing_joints": [j + 1 for j in self.standing],
            "hidden_Nm": self.hidden.tolist(),
            "best_force_N": self.force.tolist() if best else None,
            "best_force_sd_N": self.force_sd.tolist() if best else None,
            "link": self.link,
            "possible_links": list(self.possible_links),
            "payload_change_kg": self.payload_change_kg,
        }


def bits(mask: int) -> tuple[int, ...]:
    """Numbers of the bits that are set."""
    return tuple(j for j in range(_native.max_joints) if mask >> j & 1)
