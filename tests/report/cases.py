"""The scenario the report's tests share, distributions of it with something changed, and a strict reader of pages."""

import copy
import dataclasses
from html.parser import HTMLParser

import bumpstop as bs

_HAND = {
    "robot": "sia5d",
    "pose_deg": [0.0, 30.0, 0.0, -20.0, 0.0, -40.0, 0.0],
    "motion": {"velocity_mm_s": [0.0, 0.0, -50.0], "held_joints": [7]},
    "contact": {"body": "hand_finger", "area_cm2": 2.0, "offset_law": "half_normal", "offset_sd_s": 0.1},
    "detector": {
        "thresholds_Nm": [20.0, 10.0, 20.0, 20.0, 20.0, 20.0, 20.0],
        "noise_sd_Nm": [3.636, 1.818, 3.636, 3.636, 3.636, 3.636, 3.636],
    },
    "reaction": {"joint_acceleration_rad_s2": 4.5},
}


def evaluate(changes=None, samples=None):
    """The distribution of the hand scenario with some dotted keys changed; None removes a key."""
    data = copy.deepcopy(_HAND)
    for key, value in (changes or {}).items():
        *tables, last = key.split(".")
        here = data
        for name in tables:
            here = here.setdefault(name, {})
        if value is None:
            del here[last]
        else:
            here[last] = value
    return bs.evaluate(bs.Scenario.from_dict(data), samples=samples)


def with_limits(result, limits):
    return bs.integrate(dataclasses.replace(result.problem, limits=limits), result.curve)


class Outline(HTMLParser):
    """Reads a page strictly: every element closed in order, every id once; keeps headings, text and addresses."""

    _VOID = ("meta",)

    def __init__(self, page):
        super().__init__(convert_charrefs=True)
        self.open, self.ids, self.addresses = [], [], []
        self.headings, self.words, self.labels = [], [], []
        self.feed(page)
        self.close()
        assert self.open == []
        assert len(set(self.ids)) == len(self.ids)
        self.text = " ".join("".join(self.words).split())

    def handle_starttag(self, tag, attributes):
        names = [name for name, _ in attributes]
        assert len(set(names)) == len(names), (tag, names)
        if tag not in self._VOID:
            self.open.append(tag)
        for name, value in attributes:
            if name == "id":
                self.ids.append(value)
            if name in ("href", "src", "xlink:href", "action", "data"):
                self.addresses.append(value)
            if name == "aria-label":
                self.labels.append(value)
        if tag in ("h1", "h2", "h3"):
            self.headings.append([tag, ""])
        self.words.append(" ")

    def handle_startendtag(self, tag, attributes):
        self.handle_starttag(tag, attributes)
        if tag not in self._VOID:
            self.handle_endtag(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag
        self.words.append(" ")

    def handle_data(self, data):
        if "style" in self.open:
            return
        if self.open and self.open[-1] in ("h1", "h2", "h3"):
            self.headings[-1][1] += data
        self.words.append(data)
