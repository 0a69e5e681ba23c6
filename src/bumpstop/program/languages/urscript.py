"""URScript: movej, movel, movep and movec with constants, in functions, loops and branches."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from bumpstop.program.languages.blocks import Assignments, Blocks, bent_by, does_something
from bumpstop.program.languages.calls import URSCRIPT_PURE, has_parameters
from bumpstop.program.languages.expression import (
    Expression,
    assigned,
    number_of,
    numbers_of,
    read_expression,
    resolved,
)
from bumpstop.program.languages.statements import MIN_TIME_S, Frames, Jump, Move, ReadProgram, SpeedSlot, Target, Wait
from bumpstop.program.languages.syntax import Statement, SyntaxTree, Token, parse_lines

_TOKENS = re.compile(
    r"(?P<comment>\#[^\n\r]*)|(?P<newline>\r?\n)|(?P<space>[ \t\r\f\v]+)"
    r"|(?P<number>(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)"
    r"|(?P<name>[A-Za-z_][A-Za-z0-9_]*)|(?P<string>\"[^\"\n\r]*\"|'[^'\n\r]*')|(?P<operator>[-+*/%=<>!]=?|[()\[\]{},:.;@&|^~])"
)
# Statements that neither move the arm nor say how it moves.
_HARMLESS_WORDS = (
    "sleep sync textmsg popup halt set_digital_out set_standard_digital_out set_tool_digital_out set_analog_out "
    "set_configurable_digital_out set_standard_analog_out set_payload set_payload_mass set_payload_cog set_gravity "
    "set_target_payload stopj stopl rtde_set_watchdog request_boolean_from_primary_client set_tool_voltage "
    "modbus_set_output_signal modbus_set_output_register write_output_integer_register write_output_boolean_register "
    "write_output_float_register set_flag enter_critical exit_critical set_safety_mode_transition_hardness "
    "set_standard_analog_input_domain set_tool_analog_input_domain set_analog_outputdomain set_analog_output_domain "
    "set_tool_output_mode set_tool_digital_output_mode set_tool_communication set_input_actions_to_default"
)
_HARMLESS = frozenset(_HARMLESS_WORDS.split())
_WAITS = frozenset(("sleep", "popup", "stopj", "stopl"))
_ASKS = re.compile("request_(boolean|float|integer)_from_primary_client")  # and waits for the answer
_LOADS = frozenset(("set_payload", "set_payload_mass", "set_target_payload"))
# What takes moves that are behind it off the paths that are written, in this thread and others.
_BENDING = frozenset(["force_mode", "track_conveyor_linear", "track_conveyor_circular", "path_offset_enable"])
_JUMPS: Mapping[str, Jump] = {"break": "loop", "continue": "round", "return": "function", "halt": "program"}
_BLOCKS = frozenset(("if", "elif", "else", "while", "def", "sec", "thread"))
_SIGNS = ("=", "+=", "-=", "*=", "/=", "%=")
# Arguments of the moves in their places; movep and movec have no time.
_PLACES = {
    "movej": ("q", "a", "v", "t", "r"),
    "movel": ("pose", "a", "v", "t", "r"),
    "movep": ("pose", "a", "v", "r"),
    "movec": ("pose_via", "pose_to", "a", "v", "r", "mode"),
}
# The maker's defaults: acceleration and speed, rad or m.
_DEFAULTS = {"movej": (1.4, 1.05), "movel": (1.2, 0.25), "movep": (1.2, 0.25), "movec": (1.2, 0.25)}
_MAX_SPEED = {"movej": 6.28, "movel": 3.0, "movep": 3.0, "movec": 3.0}


def parse_urscript(source: bytes) -> SyntaxTree:
    """The syntax tree of any bytes; a line is a statement."""
    return parse_lines(source, _TOKENS)


def read_urscript(source: bytes) -> ReadProgram:
    """What is understood of a program."""
    tree = parse_urscript(source)
    assignments, names = Assignments(), []
    for statement in tree.statements:
        words = statement.words
        if len(words) > 1 and words[0].text in ("def", "sec"):
            names.append(words[1].text.lower())
        if len(words) > 1 and words[0].text in ("def", "thread", "sec"):
            for parameter in words[3:]:
                assignments.add(parameter.text, None)
        _assign(assignments, words)
    constants = assignments.constants()
    blocks = Blocks(names, URSCRIPT_PURE, _JUMPS, ("tool",), "thread run kill join", bent_by(tree, _BENDING))
    for statement in tree.statements:
        if statement.words:
            waits = any(_ASKS.fullmatch(word.text) for word in statement.words)
            if waits:
                blocks.add(Wait(statement.line))
            _add(blocks, statement, constants)
            if waits:
                blocks.add(Wait(statement.line))  # in the block that begins here, too
    functions = blocks.finish()
    main = "" if does_something(functions.get("", ())) else blocks.only_first(functions)
    return ReadProgram(
        "URScript",
        source,
        functions,
        tuple(blocks.not_understood),
        tuple(blocks.notes),
        constants,
        main=main,
        frames=("tool",),
        skips_overlaps=True,
    )


def _target_of(words: Sequence[Token]) -> tuple[str, Sequence[Token], Sequence[Token]] | None:
    """The name that is assigned to, where it is not a part of it the sign, and the value."""
    if words and words[0].text in ("global", "local"):
        words = words[1:]
    found = assigned(words, *_SIGNS)
    return None if found is None else (found[0], words[1 : found[1] + 1], words[found[1] + 1 :])


def _assign(assignments: Assignments, words: Sequence[Token]) -> None:
    if (target := _target_of(words)) is not None:
        name, sign, value = target
        if [word.text for word in sign] == ["="]:
            assignments.add(name, read_expression(value))
        else:
            assignments.change(name)
    texts = [word.text for word in words]
    if ";" in texts or (words and texts[0] in _BLOCKS and texts[-1] != ":"):
        # Several statements on a line are not read; what they assign is not known.
        for word in words:
            if word.kind == "name":
                assignments.change(word.text)


def _add(blocks: Blocks, statement: Statement, constants: Mapping[str, Expression]) -> None:
    words = statement.words
    first, last = words[0].text, words[-1].text
    if first in ("def", "sec") and last == ":" and len(words) > 2:
        blocks.begin_function(statement, words[1].text, first=first == "def" and not has_parameters(words))
    elif first == "thread" and last == ":" and len(words) > 2:
        # What runs beside the rest is called by nobody.
        blocks.opaque(statement, moves=False, resets=False, reframes=())
        blocks.begin_function(statement, f"thread {words[1].text}", first=False)
    elif first == "while" and last == ":":
        always = "".join(word.text for word in words[1:-1]) in ("True", "(True)")
        blocks.begin_loop(statement, words[1:], certain=always, endless=always)
    elif first == "if" and last == ":":
        blocks.begin_branch(statement, words[1:-1])
    elif first in ("elif", "else") and last == ":":
        blocks.otherwise(statement, words[1:])
    elif first == "$":
        pass  # PolyScope names the nodes of its tree so
    elif first == "end" and len(words) == 1:
        blocks.end(statement)
    elif (target := _target_of(words)) is not None:
        blocks.evaluate(statement, target[2])
    elif first in _JUMPS and (first == "return" or len(words) == 1):
        blocks.evaluate(statement, words[1:])
        blocks.jump(statement, first)
    elif (call := read_expression(words)) is not None and call.kind == "call":
        _add_call(blocks, statement, call, constants)
    elif call is None or call.kind != "string":
        blocks.opaque(statement)


def _add_call(blocks: Blocks, statement: Statement, call: Expression, constants: Mapping[str, Expression]) -> None:
    if call.name.lower() in blocks.own:
        blocks.evaluate(statement, statement.words)
        return
    if call.name in _PLACES or call.name == "set_tcp" or call.name in _HARMLESS:
        blocks.evaluate(statement, statement.words[1:])
    if call.name in _LOADS:
        blocks.note_load(statement.line)
    if call.name in _WAITS:
        blocks.add(Wait(statement.line))
    elif call.name in _PLACES:
        move = _move(statement, call, constants)
        blocks.add(move)
        if move.speed[0].time:
            blocks.note_time(move.line)
    elif call.name == "set_tcp":
        tool = numbers_of(call.argument("pose", 0), constants)
        known = tool is not None and len(tool) == 6
        blocks.add(Frames(statement.line, "tool", tuple(tool) if known and tool else None))
        if not known:
            blocks.opaque(statement, moves=False)
    elif call.name not in _HARMLESS:
        blocks.evaluate(statement, statement.words)


def _move(statement: Statement, call: Expression, constants: Mapping[str, Expression]) -> Move:
    places = _PLACES[call.name]
    arguments = {name: call.argument(name, i) for i, name in enumerate(places)}
    acceleration, speed = _DEFAULTS[call.name]
    why = ""
    plain = list(call.keys).count("")
    named = [*places[:plain], *call.keys[plain:]]
    # Each once, and those without a name first.
    if plain > len(places) or len(set(named)) < len(call.keys) or not set(named) <= set(places):
        why = "an argument is not understood"
    values: dict[str, float] = {"a": acceleration, "v": speed, "t": 0.0, "r": 0.0}
    for name, meaning in (("a", "acceleration"), ("v", "speed"), ("t", "time"), ("r", "blend radius")):
        if arguments.get(name) is not None:
            value = number_of(arguments[name], constants)
            if value is None or value < 0 or (name in "av" and value == 0):
                why = why or f"its {meaning} is not known before the program runs"
            else:
                values[name] = value
    if 0 < values["t"] < MIN_TIME_S or (values["t"] > 0 and values["r"] > 0):
        why = why or f"its time t is given with a blend, or is below {MIN_TIME_S:g} s"
    unit, most = ("rad/s", "mm/s")[call.name != "movej"], _MAX_SPEED[call.name]
    given = arguments["v"]
    close = statement.words[-1].start
    if values["t"] > 0 and (time := arguments["t"]) is not None:
        slot = SpeedSlot(time.start, time.end, values["t"], most=MIN_TIME_S, unit="s", time=True)
    elif given is not None:
        slot = SpeedSlot(given.start, given.end, values["v"], most=most, unit="rad/s" if unit == "rad/s" else "m/s")
    else:
        slot = SpeedSlot(close, close, values["v"], ", v={}", most, "rad/s" if unit == "rad/s" else "m/s")
    return Move(
        line=statement.line,
        word=call.name,
        linear=call.name != "movej",
        target=_arc_end(arguments, constants) if call.name == "movec" else _target(arguments[places[0]], constants),
        measure="joint" if call.name == "movej" else "tool",
        speed=(slot,),
        acceleration=values["a"],
        blend=values["r"],
        why=why,
        via=_target(arguments["pose_via"], constants) if call.name == "movec" else None,
    )


def _arc_end(arguments: Mapping[str, Expression | None], constants: Mapping[str, Expression]) -> Target:
    mode = arguments["mode"]
    if mode is not None and number_of(mode, constants) != 0:
        return Target(why="its mode turns the tool with the arc, which is not followed")
    return _target(arguments["pose_to"], constants)


def _target(argument: Expression | None, constants: Mapping[str, Expression]) -> Target:
    found, near = resolved(argument, constants), None
    # By a name it would be what was found where the name is assigned, with the tool and from where the arm stood there.
    direct = found is argument and found is not None and found.kind == "call" and found.name == "get_inverse_kin"
    if direct and found is not None and len(found.items) in (1, 2):
        near = numbers_of(found.argument("qnear", 1), constants)
        whole = near is not None or len(found.items) == 1
        found = resolved(found.argument("x", 0), constants) if whole else None
    numbers = numbers_of(found, constants)
    if found is None or numbers is None or (near is not None and found.kind != "pose"):
        return Target(why="its target is not known before the program runs")
    if found.kind == "pose":
        if len(numbers) != 6:
            return Target(why="its pose has not six numbers")
        return Target(pose=tuple(numbers), near=None if near is None else tuple(near))
    return Target(joints=tuple(numbers))
