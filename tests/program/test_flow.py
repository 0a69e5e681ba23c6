"""Where moves begin and what is set there: calls, jumps, loops, frames, and names that change."""

from __future__ import annotations

import numpy as np
import pytest

from bumpstop.program.interpreter import Interpreter, Visit
from bumpstop.program.languages.krl import read_krl
from bumpstop.program.languages.rapid import read_rapid
from bumpstop.program.languages.statements import ReadProgram
from bumpstop.program.languages.urscript import read_urscript
from program.corpora import cell, segments

BEGIN, BLEND = "where it begins is not known", "the move that it is blended into is not known"
TARGET, FRAME = "its target is not known before the program runs", "the tool or frame of its target is not known"
KRL_SPEEDS = "$VEL.CP=0.2\n$VEL_AXIS=20\n"
LIN = "LIN {X -600,Y -350,Z 550,A 0,B 0,C 180}\n"
PLACE = "[[-600,-350,550],[0,1,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]"
MOVE_L = f"MoveL {PLACE},v20,fine,tool0;\n"


def j(angle: float, blend: float = 0.0) -> str:
    return f"movej([{angle},-1.57,1.57,-1.57,-1.57,0], v=0.2, r={blend})\n"


def ptp(angle: float) -> str:
    return f"PTP {{A1 {angle},A2 -85,A3 88,A4 -93,A5 -90,A6 0}}\n"


def absj(angle: float) -> str:
    return f"MoveAbsJ [[{angle},-85,88,-93,-90,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v100,fine,tool0;\n"


def urscript(text: str) -> ReadProgram:
    return read_urscript(text.encode())


def krl(text: str) -> ReadProgram:
    return read_krl(text.encode())


def rapid(text: str) -> ReadProgram:
    return read_rapid(f"MODULE m\n{text}ENDMODULE\n".encode())


def visits(read: ReadProgram) -> list[Visit]:
    chains = Interpreter(read, cell().robot, cell().start, "program").chains()
    return [visit for chain in chains for visit in chain]


def whys(read: ReadProgram) -> list[str]:
    return [visit.why for visit in visits(read)]


def begins(read: ReadProgram) -> list[float | None]:
    """First joint where each move begins, in its language's unit; None where that is not known."""
    degrees = read.language != "URScript"
    found = [None if visit.leg is None else float(visit.leg.q[0, 0]) for visit in visits(read)]
    return [None if q is None else round(np.degrees(q) if degrees else q, 6) for q in found]


def test_a_move_with_another_tool_or_frame_is_another_motion() -> None:
    line = "movel(p[-0.60,-0.38,0.55,-2.03,2.40,0], v=0.25)\n"
    text = f"def go():\n{line}end\n{j(0.5)}go()\n{j(0.5)}set_tcp(p[0,0,0.2,0,0,0])\ngo()\n"
    legs = [visit.leg for visit in visits(urscript(text)) if visit.move.word == "movel"]
    assert len(legs) == 2
    assert all(leg is not None for leg in legs)
    assert np.abs(legs[0].q[-1] - legs[1].q[-1]).max() > 0.1  # type: ignore[union-attr]
    frames = [f"$BASE={{X 0,Y {y},Z 0,A 0,B 0,C 0}}\nGO()\n{ptp(17)}" for y in (0, 300)]
    text = f"DEF a()\n{KRL_SPEEDS}{ptp(17)}{''.join(frames)}END\nDEF GO()\n{LIN}END\n"
    assert [visit.move.word for visit in visits(krl(text))].count("LIN") == 2


def test_moves_with_external_axes_are_not_judged() -> None:
    """A rail carries the arm along, and its tool goes faster than its joints say."""
    carried = "external axis {} may move, too, and is not followed"
    told = []
    for degrees, rail in ((17, 0), (27, 0), (27, 900), (17, 900)):
        target = ptp(degrees).replace("}", f",E1 {rail}}}")
        told.append((target, absj(degrees).replace("[9E9,", f"[{rail},"), ["", "", carried, ""][len(told)]))
    ways = [each[2] for each in told]
    assert whys(krl(f"DEF a()\n{KRL_SPEEDS}{''.join(each[0] for each in told)}END\n")) == [w.format("E1") for w in ways]
    moves = "".join(each[1] for each in told)
    assert whys(rapid(f"PROC main()\n{moves}ENDPROC\n")) == [w.format("eax_a") for w in ways]
    line = MOVE_L.replace("[9E9,", "[{},")
    text = f"PROC main()\n{absj(17)}{line.format(5)}{line.format('x()').replace('-350', '-300')}ENDPROC\n"
    assert whys(rapid(text)) == ["", "", carried.format("eax_a")]
    krl_line, far = LIN.replace("}", ",E1 {}}}").replace("{X", "{{X"), LIN.replace("-350", "-300")
    text = f"{ptp(17)}{krl_line.format(5)}{far}{krl_line.format(5)}{far.replace('}', ',E1 6}')}"
    assert whys(krl(f"DEF a()\n{KRL_SPEEDS}{text}END\n")) == ["", "", "", "", carried.format("E1")], "unnamed it stays"


def test_a_place_that_is_found_again_is_the_same() -> None:
    """It is another one by what the search for joint positions leaves."""
    there, back = (f"movel(p[-0.6,{y},0.55,-2.03,2.40,0], v=0.25)\n" for y in (-0.38, -0.30))
    found = visits(urscript(f"{j(0.5)}while True:\n{there}{back}end\n"))
    assert [visit.move.line for visit in found] == [1, 3, 4, 3]


@pytest.mark.parametrize(
    ("read", "why"),
    [
        (rapid(f"VAR robtarget p:={PLACE};\nPROC main()\np.trans.z:=350;\nMoveL p,v20,fine,tool0;\nENDPROC\n"), TARGET),
        (
            rapid(f"VAR speeddata s:=[40,500,9,9];\nPROC main()\ns.v_tcp:=400;\n{MOVE_L.replace('v20', 's')}ENDPROC\n"),
            "its speed is not known before the program runs",
        ),
        *(
            (
                rapid(f"VAR num h:=50;\nPROC main()\n{change}\nMoveL Offs({PLACE},0,0,h),v20,fine,tool0;\nENDPROC\n"),
                TARGET,
            )
            for change in ("Add h,150;", "Incr h;", "Clear h;", "TPReadNum h,1;", "x:=StrToVal(s,h);")
        ),
        (
            rapid(f"VAR num h;\nPROC main()\nMoveL Offs({PLACE},0,0,h),v20,fine,tool0;\nh:=50;\nENDPROC\n"),
            TARGET,
        ),
        (
            rapid(f"CONST robtarget p:={PLACE};\nPROC main()\nVAR robtarget p;\nMoveL p,v20,fine,tool0;\nENDPROC\n"),
            TARGET,
        ),
        (
            rapid(
                "PROC a()\nMoveAbsJ [[17,-85,88,-93,-90,0],[9E9]],v20,fine,tool0;\nENDPROC\nPROC b(num v20)\nENDPROC\n"
            ),
            "its speed is not known before the program runs",
        ),
        (krl(f"DECL E6POS XP\nXP={{X -600,Y -350,Z 550,A 0,B 0,C 180}}\nXP.Z=350\n{KRL_SPEEDS}LIN XP\n"), TARGET),
        (krl(f"XA={{A1 17,A2 -85,A3 88,A4 -93,A5 -90,A6 0}}\nXA.A1=100\n{KRL_SPEEDS}PTP XA\n"), TARGET),
        (krl(f"XA[1]={{A1 17,A2 -85,A3 88,A4 -93,A5 -90,A6 0}}\nXA[I]=Y\n{KRL_SPEEDS}PTP XA[1]\n"), TARGET),
        (krl(f"XA={{A1 17,A2 -85,A3 88,A4 -93,A5 -90,A6 0}}\nSET(XA)\n{KRL_SPEEDS}PTP XA\n"), TARGET),
        (urscript(f"z = 1\nz += -0.3\n{j(0.2)}movej([z,-1.57,1.57,-1.57,-1.57,0])"), TARGET),
        (urscript("s = [0,0,0,0,0,0]\ns.q[0] = 1\nmovej(s)"), TARGET),
    ],
)
def test_a_name_that_changes_in_part_has_no_known_value(read: ReadProgram, why: str) -> None:
    assert whys(read)[-1] == why


def test_what_the_language_has_is_changed_by_nothing() -> None:
    text = f"PROC main()\nSearchL di,p,v20,tool0;\nnext:\n{MOVE_L}PDispOff;\n{absj(17)}{MOVE_L}ENDPROC\n"
    assert whys(rapid(text)) == [FRAME, BEGIN, ""]


def test_parameters_hide_constants() -> None:
    go = "MoveL p10,v20,fine,tool0;\n"
    text = f"CONST robtarget p10:={PLACE};\nPROC main()\nPDispOff;\nENDPROC\nPROC Go(robtarget p10)\n{go}ENDPROC\n"
    assert whys(rapid(text)) == [TARGET]
    text = f"DEF a()\nHOME={{A1 17,A2 -85,A3 88,A4 -93,A5 -90,A6 0}}\nEND\nDEF GO(HOME:IN)\n{KRL_SPEEDS}PTP HOME\nEND\n"
    assert whys(krl(text)) == [TARGET]


def test_a_call_in_an_assignment_or_a_condition_is_a_call() -> None:
    text = "def pick():\n{}return True\nend\ndef main():\n{}{}\n{}end\n"
    for call in ("ok = pick()", "local ok = pick()", "if pick():\nend"):
        assert begins(urscript(text.format(j(1), j(0.5), call, j(2)))) == [0.0, 0.5, 1.0]
    read = krl(
        f"DEF main()\n{KRL_SPEEDS}OK=PICK( )\n{ptp(50)}END\nDEFFCT BOOL PICK( )\n{ptp(-60)}RETURN TRUE\nENDFCT\n"
    )
    assert begins(read) == [0.0, -60.0]
    proc = f"PROC main()\n{absj(17)}ok:=Pick();\n{absj(30)}ENDPROC\n"
    assert begins(rapid(proc + f"FUNC bool Pick()\n{absj(-40)}RETURN TRUE;\nENDFUNC\n")) == [0.0, 17.0, -40.0]


@pytest.mark.parametrize(
    ("read", "named"),
    [
        (urscript(j(0.5) + "w = movej_to_home()\n" + j(1)), "w = movej_to_home()"),
        (urscript(j(0.5) + "i = foo(1) + 2\n" + j(1)), "i = foo(1) + 2"),
        (urscript(j(0.5) + "while go():\nsync()\nend\n" + j(1)), "while go():"),
        (urscript(j(0.5) + "if x:\nsync()\nelif go():\nend\n" + j(1)), "elif go():"),
        (urscript(j(0.5) + "set_digital_out(0, go())\n" + j(1)), "set_digital_out(0, go())"),
        (krl(KRL_SPEEDS + "ERG=OUTSIDE( )\n" + KRL_SPEEDS + ptp(1)), "ERG=OUTSIDE( )"),
        (krl(KRL_SPEEDS + "OUTSIDE( )\n" + KRL_SPEEDS + ptp(1)), "OUTSIDE( )"),
        (krl(KRL_SPEEDS + "REPEAT\nUNTIL GO( )\n" + KRL_SPEEDS + ptp(1)), "UNTIL GO( )"),
        (rapid(f"PROC a()\n{absj(2)}GripperOpen;\n{absj(1)}ENDPROC\n"), "GripperOpen;"),
        (rapid(f"PROC a()\n{absj(2)}ok:=Outside();\n{absj(1)}ENDPROC\n"), "ok:=Outside();"),
        (rapid(f'PROC a()\n{absj(2)}%"b"%;\n{absj(1)}ENDPROC\n'), '%"b"%;'),
    ],
)
def test_a_call_of_something_outside_is_named(read: ReadProgram, named: str) -> None:
    assert named in [text for _, text in read.not_understood]
    assert whys(read)[-1] == BEGIN


def test_what_only_computes_or_does_not_move_is_no_call() -> None:
    text = (
        j(0.5)
        + "q = get_inverse_kin(pose_trans(p[0,0,0,0,0,0], get_actual_tcp_pose()))\nif (norm(q) > 1):\nsync()\nend\n"
    )
    read = urscript(text + j(1))
    assert (read.not_understood, whys(read)) == ((), ["", ""])
    read = rapid(
        f"PROC main()\n{absj(2)}x:=Abs(CPos().x);\nSetDO d,1;\nWaitTime 1;\nPDispOff;\n{absj(1)}EXIT;\nENDPROC\n"
    )
    assert (read.not_understood, whys(read)) == ((), ["", ""])
    read = krl(f"{KRL_SPEEDS}{ptp(2)}WAIT FOR ($IN[1])\nX=ABS(Y)\n{ptp(1)}")
    assert (read.not_understood, whys(read)) == ((), ["", ""])


def test_jumps_leave_loops_where_they_stand() -> None:
    loop = f"while True:\n{j(0.5)}if x:\nbreak\nend\n{j(1)}end\n{j(2)}"
    assert begins(urscript(loop)) == [0.0, 0.5, 1.0, 0.5]
    text = f"{KRL_SPEEDS}LOOP\n{ptp(10)}IF X THEN\nEXIT\nENDIF\n{ptp(50)}ENDLOOP\n{ptp(90)}"
    assert begins(krl(text)) == [0.0, 10.0, 50.0, 10.0]
    # The next round begins where the jump stands, or where the loop ends.
    text = f"while True:\n{j(0.5)}if x:\ncontinue\nend\n{j(1)}end\n"
    assert begins(urscript(text)) == [0.0, 0.5, None]


def test_jumps_leave_functions_where_they_stand() -> None:
    text = f"def pick():\nif x:\n{j(0.5)}return False\nend\n{j(1)}end\ndef main():\npick()\n{j(2)}end\n"
    assert begins(urscript(text)) == [0.0, 0.0, None]
    text = (
        f"DEF a()\n{KRL_SPEEDS}B()\n{ptp(50)}END\nDEF B()\n{ptp(10)}IF X THEN\n{ptp(-20)}RETURN\nENDIF\n{ptp(30)}END\n"
    )
    assert begins(krl(text)) == [0.0, 10.0, 10.0, None]
    body = f"{absj(-40)}IF d=1 THEN\n{absj(-90)}RETURN;\nENDIF\n{absj(-10)}"
    text = f"PROC main()\nPick;\n{absj(30)}ENDPROC\nPROC Pick()\n{body}ENDPROC\n"
    assert begins(rapid(text)) == [0.0, -40.0, -40.0, None]
    assert begins(rapid(text.replace(absj(-90) + "RETURN", "EXIT"))) == [0.0, -40.0, -10.0]
    assert begins(rapid(text.replace(f"IF d=1 THEN\n{absj(-90)}RETURN;\nENDIF", "IF d=1 RETURN;"))) == [
        0.0,
        -40.0,
        None,
    ]


def test_an_error_handler_begins_anywhere_and_ends_its_function() -> None:
    text = f"PROC main()\nPick;\n{absj(30)}ENDPROC\nPROC Pick()\n{absj(10)}ERROR\n{absj(0)}RETRY;\nENDPROC\n"
    read = rapid(text)
    assert begins(read) == [0.0, None, None]
    assert [text for _, text in read.not_understood] == ["ERROR", "RETRY;"]


def test_a_for_loop_may_run_never() -> None:
    for bound, begin in (("N", None), ("0", None), ("3", 20.0)):
        read = krl(f"{KRL_SPEEDS}{ptp(1)}FOR I=1 TO {bound}\n{ptp(20)}ENDFOR\n{ptp(30)}")
        assert begins(read)[-1] == begin


def test_a_tool_that_changes_from_round_to_round() -> None:
    line = "movel(p[-0.6,-0.38,0.55,-2.03,2.40,0], v=0.25)\n"
    found = visits(urscript(f"{j(0.5)}while True:\n{line}set_tcp(p[0,0,0.1,0,0,0])\nend\n"))
    # With the first tool, with the second from there, and with the second from itself.
    assert [(visit.move.line, visit.still) for visit in found] == [(1, False), (3, False), (3, False), (3, True)]


def test_only_what_the_program_begins_with_begins_at_the_pose() -> None:
    assert begins(urscript(f"def main():\n{j(0.5)}pick(0.1)\nend\ndef pick(h):\n{j(1)}end\n")) == [0.0, None]
    assert begins(rapid(f"PROC main()\n{absj(1)}ENDPROC\nTRAP t\n{absj(2)}ENDTRAP\nPROC p()\n{absj(3)}ENDPROC\n")) == [
        0.0,
        None,
        None,
    ]
    assert begins(krl(f"DEF a()\n{KRL_SPEEDS}{ptp(1)}END\nDEF b()\n{KRL_SPEEDS}{ptp(2)}END\n")) == [0.0, None]
    # Of two that may be the first neither is known to be it.
    assert begins(rapid(f"PROC p()\n{absj(1)}ENDPROC\nPROC q()\n{absj(2)}ENDPROC\n")) == [None, None]
    # What calls itself alone is judged, too; and what something not understood calls begins anywhere, too.
    assert begins(rapid(f"PROC main()\n{absj(1)}ENDPROC\nPROC q()\n{absj(2)}q;\nENDPROC\n"))[:2] == [0.0, None]
    text = f'PROC main()\nq;\n%"q"%;\nENDPROC\nPROC q()\n{absj(2)}ENDPROC\n'
    assert begins(rapid(text)) == [0.0, None]


def test_a_wait_between_blended_moves_leaves_the_corner_open() -> None:
    waits = "the program waits before the move that it is blended into"
    for wait, said in (("sleep(1)\n", waits), ("set_digital_out(0, True)\n", ""), ("", "")):
        assert whys(urscript(f"{j(0.5, 0.1)}{wait}{j(0.2)}")) == [said, ""]
    text = f"DEF a()\n{KRL_SPEEDS}{ptp(17)[:-1]} C_PTP\nWAIT SEC 1\n{ptp(27)}END\n"
    assert whys(krl(text)) == [waits, ""]
    text = f"PROC main()\n{absj(17).replace('fine', 'z50')}WaitDI di1,1;\n{absj(27)}ENDPROC\n"
    assert whys(rapid(text)) == [waits, ""]
    assert whys(urscript(f"{j(0.5, 0.1)}sleep(1)\n")) == [""], "nothing follows: it goes to its target"
    assert whys(urscript(f"{j(0.5)}sleep(1)\n{j(0.2)}")) == ["", ""]


def test_attributes_of_a_module_are_no_call() -> None:
    text = f"MODULE m (SYSMODULE, NOSTEPIN)\nPROC main()\n{absj(17)}{MOVE_L}ENDPROC\nENDMODULE\n"
    read = read_rapid(text.encode())
    assert (read.not_understood, whys(read)) == ((), ["", ""])


def test_frames_that_are_not_understood_are_not_known() -> None:
    base = "$BASE={X 0,Y 0,Z 0,A 0,B 0,C 0}\n"
    read = krl(f"{KRL_SPEEDS}{base}$BASE.Z=-200\n{LIN}")
    assert (whys(read), [line for line, _ in read.not_understood]) == ([FRAME], [4])
    assert whys(krl(f"{KRL_SPEEDS}$IPO_MODE=#TCP\n{KRL_SPEEDS}{LIN}")) == [FRAME]
    shifted = f"PDispSet [[0,0,-200],[1,0,0,0],[0,0,0,0]];\n{absj(17)}{MOVE_L}"
    text = f"PROC main()\n{shifted}PDispOff;\n{absj(18)}{MOVE_L}ENDPROC\n"
    assert whys(rapid(text)) == ["", FRAME, BEGIN, ""]


def test_a_frame_is_the_same_however_it_is_written() -> None:
    """The null frame of KRL, and the object frame of RAPID in a user frame that is the base."""
    zero = "{X 0,Y 0,Z 0,A 0,B 0,C 0}"
    ends = []
    for frame in (zero, "$NULLFRAME", "$nullframe"):
        (_, line) = visits(krl(f"DEF a()\n{KRL_SPEEDS}{ptp(17)}$TOOL={frame}\n$BASE={frame}\n{LIN}END\n"))
        ends.append(line.leg.q[-1])  # type: ignore[union-attr]
    moved, still = "[[20,0,0],[0.9659258,0,0,0.258819]]", "[[0,0,0],[1,0,0,0]]"
    for user, own in ((moved, still), (still, moved), (still, still)):
        text = f'PERS wobjdata w:=[FALSE,TRUE,"",{user},{own}];\nPROC main()\n'
        text += absj(17) + MOVE_L.replace("[-600,-350,550]", "[-690,-60,550]").replace("tool0", "tool0\\WObj:=w")
        (_, line) = visits(rapid(f"{text}ENDPROC\n"))
        ends.append(line.leg.q[-1])  # type: ignore[union-attr]
    assert all(np.array_equal(end, ends[0]) for end in ends[:3])
    assert np.array_equal(ends[3], ends[4])
    assert not np.allclose(ends[4], ends[5], atol=0.1)


def test_tools_that_stand_still_and_objects_that_move() -> None:
    tool, at = "PERS tooldata t:=[{},[[0,0,200],[1,0,0,0]],[1]];\n", "[[0,0,100],[1,0,0,0]],[[0,0,0],[1,0,0,0]]"
    flags = [("TRUE", "FALSE,TRUE"), ("FALSE", "FALSE,TRUE"), ("TRUE", "TRUE,TRUE"), ("TRUE", "FALSE,FALSE")]
    for number, (held, piece) in enumerate(flags):
        text = tool.format(held) + f'PERS wobjdata w:=[{piece},"",{at}];\nPROC main()\n'
        text += MOVE_L.replace("tool0", "t\\WObj:=w") + "ENDPROC\n"
        assert whys(rapid(text)) == ["" if number == 0 else "its tool stands still, or its work object moves"]
    text = f"PROC main()\n{absj(3).replace('tool0', 'tMine')}ENDPROC\n"
    assert whys(rapid(text)) == ["the tool whose speed it gives is not known"]


def test_a_blend_goes_on_where_nothing_moves_between() -> None:
    down = "movel(p[-0.691,-0.174,{},-2.2214,2.2214,0], v=0.3, r=0.004)\n"
    lines = [down.format(z) for z in (0.69, 0.68, 0.67)]
    pause = 'if x:\ntextmsg("a")\nend\n'
    assert [len(s.visits) for s in segments("".join(lines))] == [3]
    assert [len(s.visits) for s in segments(pause.join(lines))] == [3]


def test_a_blend_into_what_is_not_known_is_named() -> None:
    branch = f"if x:\n{j(1, 0.1)}end\n"
    assert whys(urscript(j(0.5, 0.1) + branch + j(1.5))) == [BLEND, BLEND, BEGIN]
    assert whys(urscript(j(0.5, 0.1) + "go()\n" + j(1.5))) == [BLEND, BEGIN]
    assert whys(urscript(j(0.5, 0.1) + f"while x:\n{j(1)}end\n"))[0] == BLEND
    # The last one of a program stops.
    assert whys(urscript(j(0.5, 0.1))) == [""]


def test_the_head_of_a_module_hides_nothing() -> None:
    head = b"%%%\n  VERSION:1\n  LANGUAGE:ENGLISH\n%%%\n"
    text = f"MODULE m\nCONST robtarget p:={PLACE};\nPROC main()\nMoveL p,v20,fine,tool0;\nENDPROC\nENDMODULE\n".encode()
    read = read_rapid(head + text)
    assert (read.not_understood, [(visit.move.line, visit.why) for visit in visits(read)]) == ((), [(8, "")])


def test_a_function_that_calls_itself_ends() -> None:
    calls = "a()\n" * 20
    assert whys(urscript(f"def a():\n{calls}end\na()\n{j(1)}")) == [BEGIN]
    # With what it leaves to its own beginning, too.
    read = krl(f"DEF a()\n$VEL.CP=0.2\nB()\nEND\nDEF B()\n{LIN}$VEL.CP=0.1\nB()\nEND\n")
    assert [visit.slots[0].value for visit in visits(read) if visit.slots] == [0.2, 0.1]


SOME = "the speed of some axes is set outside the program"


def test_whole_numbers_are_made_whole() -> None:
    """By the controller: what is judged is not slower."""
    far, numbers = LIN.replace("350", "300"), "DECL INT V, W[2]\nV=0.6\nW[2]=1.0\n"
    read = krl(f"DEF a()\n{numbers}{ptp(17)}$VEL.CP=V\n{LIN}$VEL.CP=W[2]\n{far}END\n")
    (_, one, other) = visits(read)
    assert (one.why, other.slots[0].value) == ("its speed may be one of several", 1.0)
    for set_axes in ("$VEL_AXIS=20.6\n", "BAS(#VEL_PTP,20.6)\n"):
        assert visits(krl(f"DEF a()\n{set_axes}{ptp(17)}END\n"))[0].slots[0].value == 21


@pytest.mark.parametrize(
    ("settings", "why"),
    [
        ("FOR I=1 TO 6\n$VEL_AXIS[I]=20\nENDFOR\n", ""),
        ("FOR I=1 TO 3\n$VEL_AXIS[I]=20\nENDFOR\n", SOME),
        ("FOR I=1 TO 3\n$VEL_AXIS[I]=20\nENDFOR\nFOR I=4 TO 6\n$VEL_AXIS[I]=10\nENDFOR\n", ""),
        ("I=3\n$VEL_AXIS[I]=20\n", SOME),
        ("FOR I=1 TO N\n$VEL_AXIS[I]=20\nENDFOR\n", "its speed may be one of several"),
        ("FOR I=1 TO 6\n$VEL_AXIS[J]=20\nENDFOR\n", "its speed may be one of several"),
        (
            f"{KRL_SPEEDS}FOR I=1 TO 6\n$VEL_AXIS[I]=5\nIF X THEN\nEXIT\nENDIF\nENDFOR\n",
            "its speed may be one of several",
        ),
        (f"{KRL_SPEEDS}FOR I=1 TO 6\n$VEL_AXIS[I]=5\nX=GO(I)\nENDFOR\n", "its speed may be one of several"),
        (f"{KRL_SPEEDS}FOR I=1 TO 6\n$VEL_AXIS[I]=5\nI=I+1\nENDFOR\n", "its speed may be one of several"),
        (f"{KRL_SPEEDS}FOR I=1 TO 6\nX=1\nENDFOR\n$VEL_AXIS[I]=5\n", "its speed may be one of several"),
        ("FOR I=1 TO 6\n\n; all\n$VEL_AXIS[I]=5\n$ACC_AXIS[I]=5\nENDFOR\n", ""),
    ],
)
def test_only_the_axes_that_are_counted_are_set(settings: str, why: str) -> None:
    assert whys(krl(f"{settings}{ptp(17)}")) == [why]
