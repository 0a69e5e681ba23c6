"""KRL's inline forms: lines that the smartPAD writes around a move, whose call of BAS sets speed, blend, tool, base."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

from bumpstop.program.languages.calls import KRL_PURE, calls_in
from bumpstop.program.languages.expression import Expression, assigned, number_of, read_expression, resolved, split_at
from bumpstop.program.languages.krl.data import frame_of_record
from bumpstop.program.languages.statements import Frame, Frames, Node, Setting, SpeedSlot, Wait
from bumpstop.program.languages.syntax import Statement, SyntaxTree, Token

_RECORDS = ("pdat_act", "ldat_act", "fdat_act")
_LINES = ("$bwdstart", "$h_pos", "bas", "set_cd_params", *_RECORDS)
_SPEEDS = ("tool", "axes", "acceleration tool", "acceleration axes", "blend")
# What commands of BAS set: first what they leave unknown or may, then what is known, by what it is taken from.
_SETS: Mapping[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "#initmov": (_SPEEDS, ("no frames",)),
    "#ptp_params": ((), ("axes", "pdat_act", "fdat_act")),
    "#cp_params": (("axes",), ("tool", "ldat_act", "fdat_act")),
    "#vel_ptp": ((), ("axes",)),
    "#vel_cp": ((), ("tool",)),
    "#acc_ptp": (("acceleration axes",), ()),
    "#acc_cp": (("acceleration tool",), ()),
    "#ptp_dat": (("axes",), ("pdat_act",)),
    "#cp_dat": (("axes", "tool"), ("ldat_act",)),
    "#frames": ((), ("fdat_act",)),
    "#tool": ((), ("tool_data",)),
    "#base": ((), ("base_data",)),
}
_SPEED = {"axes": (100.0, "%", 0.01), "tool": (2.0, "m/s", 1.0)}  # the most that a form takes, unit, factor to SI
# What a form of a spline move sets for it alone: what its speed is of, its record, what has to be set and what may be;
# {V} its speed, {F} the record of tool and base, {D} its own.
_FRAMES = " $tool=stool2({F}) $base=sbase({F}.base_no) $ipo_mode=sipo_mode({F}.ipo_frame)"
_MAY = " $load=sload({F}.tool_no) $collmon_tol_pro[1]=use_cm_pro_values(0)"
_SPLINES: Mapping[str, tuple[str, str, str, str]] = {
    "sptp": (
        "axes",
        "pdat_act",
        "$vel_axis[1]=svel_joint({V}) $apo=sapo_ptp({D})" + _FRAMES,
        "$acc_axis[1]=sacc_joint({D}) $gear_jerk[1]=sgear_jerk({D})" + _MAY,
    ),
    "slin": (
        "tool",
        "ldat_act",
        "$vel=svel_cp({V},,{D}) $apo=sapo({D}) $ori_type=sori_typ({D})" + _FRAMES,
        "$acc=sacc_cp({D}) $jerk=sjerk({D})" + _MAY,
    ),
}
_GIVEN = {"F": re.compile(r"\$tool=stool2\((\w+)\)"), "D": re.compile(r"\$apo=sapo(?:_ptp)?\((\w+)\)")}
_FOLD = re.compile(r";\s*FOLD\s+S?(PTP|LIN|CIRC)\b", re.IGNORECASE)
_SHOWN = re.compile(r"(?:\bVel\s*=\s*|,\s*5\s*:\s*|\bKuka\.Velocity(?:Ptp|Path)\s*=\s*)([0-9]+(?:\.[0-9]+)?)", re.I)
# The interrupt of every program that the smartPAD makes: what runs when the arm has been stopped.
_STOPPED = "interrupt decl 3 when $stopmess == true do ir_stopm ( )"
_DECLARED = re.compile(r"interrupt decl (?:3 |(?![0-9])).*")
_COLLISION = re.compile(r"set_cd_params \( [0-9]+ \)")  # of the controller's own collision detection
_GIVE = "give the program's .dat and the controller's $config.dat in its folder"


class InlineForms:
    """Follows a program line by line: what an inline form gives to BAS counts up to the form's move."""

    def __init__(self, tree: SyntaxTree, constants: Mapping[str, Expression], own: Collection[str]) -> None:
        """Of a program with these constants and its own functions, whose names BAS and others have lost."""
        self.notes: list[str] = []
        self._constants, self._own = constants, own
        self._given: dict[str, Expression | None] = {}
        self._comments: list[Token] = []
        self._in_spline = False  # whose moves are parts of one path
        declared = {match[0] for s in tree.statements if (match := _DECLARED.search(_text(s)))}
        stopped = {_STOPPED, f"global {_STOPPED}", "interrupt on 3", "interrupt off 3"}
        self._stopped = stopped if declared == {_STOPPED} and "ir_stopm" not in own else set()

    def follow(self, statement: Statement) -> None:
        """The next line."""
        words = statement.words
        first = words[0].text.lower() if words else ""
        self._in_spline = first in ("spline", "ptp_spline") or (self._in_spline and first != "endspline")
        if not words:
            for token in statement.tokens:
                if token.kind == "comment":
                    if _FOLD.match(token.text):
                        self._comments = []  # of another form
                    self._comments.append(token)
        elif first not in (*_LINES, *_SPLINES):
            self._given, self._comments = {}, []
        elif first in _RECORDS:
            self._given[first] = read_expression(words[2:]) if [word.text for word in words[1:2]] == ["="] else None

    def sets(self, statement: Statement) -> list[Node] | None:
        """What a line of a form sets; None where that is not known, and of other lines."""
        text, words = _text(statement), statement.words
        if text in self._stopped:
            return [Wait(statement.line)]
        if _switches(words) or (_COLLISION.fullmatch(text) and "set_cd_params" not in self._own):
            return []
        call = read_expression(words) if words[0].text.lower() == "bas" and "bas" not in self._own else None
        if call is None or call.kind != "call" or not 1 <= len(call.items) <= 2:
            return None
        unknown, known = _SETS.get(call.items[0].name.lower(), ((), ("",)))
        nodes: list[Node] = [Setting(statement.line, key, None) for key in unknown]
        for source in known:
            found = self._from(source, call.items[1] if len(call.items) == 2 else None, statement.line)
            if found is None:
                return None
            nodes += found
        return nodes

    def spline(self, statement: Statement) -> list[Node] | None:
        """What a form's spline move has for itself alone; None where that is not known, and of other lines."""
        words, texts = statement.words, [word.text.lower() for word in statement.words]
        if texts[0] not in _SPLINES:
            return None
        measure, kind, needed, may = _SPLINES[texts[0]]
        value, found = None, list[str]()
        at = texts.index("with") + 1 if "with" in texts else len(texts)
        for part in split_at(words[at : len(words) - (texts[-1] == "c_spl")], ","):
            text = _joined(part)
            if text.startswith(("$vel_axis[1]=svel_joint(", "$vel=svel_cp(")):
                first, *others = split_at(part[[word.text for word in part].index("(") + 1 : -1], ",")
                value = read_expression(first)
                text = f"{text.partition('(')[0]}({','.join(['{V}', *map(_joined, others)])})"
            found.append(re.sub(r"use_cm_pro_values\([0-9]+\)$", "use_cm_pro_values(0)", text))
        names = {key: match[1] for key, name in _GIVEN.items() if (match := name.search(" ".join(found)))}
        given = {"V": "{V}", "F": "", "D": "", **names}
        needs, all_of = set(needed.format(**given).split()), set(f"{needed} {may}".format(**given).split())
        called = re.findall(r"(\w+)\(", f"{needed} {may}")
        nodes: list[Node] | None = []
        unlike = len(set(found)) < len(found) or not needs <= set(found) <= all_of or calls_in(words[:at], KRL_PURE)
        if unlike or self._in_spline or not set(called).isdisjoint(self._own):
            nodes = None
        else:
            records = {kind: given["D"], "fdat_act": given["F"]}
            self._given = {key: Expression("name", 0, 0, name.upper()) for key, name in records.items()}
            for source in (measure, kind, "fdat_act"):
                one = self._from(source, value, statement.line)
                nodes = None if nodes is None or one is None else [*nodes, *map(_for_one, one)]
            if measure == "axes" and nodes:
                self._note("SPTP sets the speed of axis 1, which is taken for that of all axes, as its form shows it")
        self._given, self._comments = {}, []
        return nodes

    def after(self, statement: Statement) -> list[Node]:
        """What such a move may leave to others: how one axis' speed holds for all is not known."""
        joint = statement.words[0].text.lower() == "sptp"
        return [Setting(statement.line, "axes", None)] if joint else []

    def _from(self, source: str, value: Expression | None, line: int) -> list[Node] | None:
        if source == "no frames":
            return [Wait(line), Frames(line, "tool", None), Frames(line, "base", None)]
        if source in _SPEED:
            slot = self._slot(source, value)
            return None if slot is None else [Setting(line, source, slot)]
        if source.endswith("_data"):
            return [self._frame("tool" if source == "tool_data" else "base", value, line)]
        record = self._record(source)
        if record is None:
            if source in self._given:
                given = self._given[source]
                named = given.name if given is not None and given.kind == "name" else f"what {source.upper()} is given"
                self._note(f"line {line}: {named} is not known; {_GIVE}")
            return None
        if source == "fdat_act":
            tool, base = (self._frame(which, record.get(f"{which}_NO".upper()), line) for which in ("tool", "base"))
            return [tool, base, *_unless(_named(record, "IPO_FRAME") == "#base", line)]
        distance = number_of(record.get("APO_DIST"), self._constants)
        in_mm = source == "ldat_act" or _named(record, "APO_MODE") == "#cdis"
        known = in_mm and distance is not None and distance >= 0
        blend = Setting(line, "blend", SpeedSlot(0, 0, distance, unit="mm", factor=1e-3) if known else None)
        if source == "pdat_act":
            return [blend, Setting(line, "acceleration axes", None)]
        ordinary = _named(record, "ORI_TYP") in ("", "#var") and _named(record, "CIRC_TYP") in ("", "#base")
        return [blend, Setting(line, "acceleration tool", None), *_unless(ordinary, line)]

    def _slot(self, measure: str, value: Expression | None) -> SpeedSlot | None:
        number = number_of(value, self._constants)
        if value is None or number is None or number <= 0:
            return None
        places = ((token.start, match.span(1)) for token in self._comments for match in _SHOWN.finditer(token.text))
        shown, self._comments = tuple((start + begin, start + end) for start, (begin, end) in places), []
        most, unit, factor = _SPEED[measure]
        if whole := unit == "%":
            number = float(math.ceil(number))  # the controller takes a whole one
        return SpeedSlot(
            value.start, value.end, number, most=most, unit=unit, factor=factor, setting=True, whole=whole, shown=shown
        )

    def _record(self, name: str) -> dict[str, Expression] | None:
        found = resolved(self._given.get(name), self._constants)
        if found is None or found.kind != "record" or len(set(found.keys)) < len(found.keys):
            return None
        return dict(zip(found.keys, found.items, strict=True))

    def _frame(self, which: Frame, number: Expression | None, line: int) -> Frames:
        """``TOOL_DATA`` or ``BASE_DATA`` of a number; of 0 the flange, or the arm's base."""
        value = number_of(number, self._constants)
        if value == 0:
            return Frames(line, which, (0.0,) * 6)
        name = f"{which}_data[{'?' if value is None else f'{value:g}'}]"
        pose = frame_of_record(self._constants.get(name), self._constants)
        if which == "tool":
            self._note(
                "forms set what the arm carries, which is not followed: the load of the scenario's robot is judged"
            )
        if pose is None:
            self._note(f"{name.upper()} is not known; {_GIVE}")
        return Frames(line, which, pose)

    def _note(self, text: str) -> None:
        self.notes += [text] if text not in self.notes else []


def _switches(words: list[Token]) -> bool:
    """Whether a line switches an output while the arm moves, for which the program does not wait."""
    texts = [word.text.lower() for word in words]
    if texts[0] != "trigger" or texts.count("do") != 1:
        return False
    done = words[texts.index("do") + 1 :]
    sets = texts[-len(done)] == "$out" and assigned(done, "=") is not None
    return calls_in(words, KRL_PURE) == ([] if sets else ["pulse"])


def _text(statement: Statement) -> str:
    return " ".join(word.text.lower() for word in statement.words)


def _for_one(node: Node) -> Node:
    """The speed of one move alone, which is written as the smartPAD does."""
    if not isinstance(node, Setting) or node.key not in _SPEED or node.slot is None:
        return node
    return replace(node, slot=replace(node.slot, setting=False, template="{}.0" if node.slot.whole else "{}"))


def _joined(words: Sequence[Token]) -> str:
    return "".join(word.text.lower() for word in words)


def _named(record: Mapping[str, Expression], key: str) -> str:
    """The value of an enumeration in small letters; empty where there is none."""
    return (record[key].name.lower() or "?") if key in record else ""


def _unless(ordinary: bool, line: int) -> list[Node]:
    """Where poses are meant in another way, none is known."""
    return [] if ordinary else [Frames(line, "shift", None)]
