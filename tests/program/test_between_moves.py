"""What a program sets and waits for between its moves."""

from __future__ import annotations

import math

import pytest

from bumpstop.program.interpreter import Interpreter
from program.corpora import cell
from program.test_flow import (
    BEGIN,
    FRAME,
    KRL_SPEEDS,
    LIN,
    MOVE_L,
    TARGET,
    absj,
    begins,
    j,
    krl,
    ptp,
    rapid,
    urscript,
    visits,
    whys,
)


@pytest.mark.parametrize(
    ("between", "leaves_open"),
    [
        ("WHILE B\nX=1\nENDWHILE\n", True),
        ("DECL INT X\nFOR I=1 TO 6\nX=I\nENDFOR\n", False),
        ("DECL BOOL A,GRIP\nIF NOT A AND (GRIP==FALSE) THEN\nGRIP=TRUE\nENDIF\n", False),
        ("SIGNAL GRIP $OUT[5]\nGRIP=TRUE\n", True),
        ("DECL REAL X\nX=$VEL_ACT\n", True),
        ("DECL BOOL A\nSIGNAL GRIP $IN[5]\nIF A AND GRIP THEN\nA=TRUE\nENDIF\n", True),
        ("GRIP=TRUE\n", True),
        ("CONTINUE\nGRIP=TRUE\n", False),
        ("$OUT[1]=TRUE\n", True),
        ("CONTINUE\n$OUT[1]=TRUE\n", False),
        ("$OUT_C[1]=TRUE\n", False),
        ("IF $IN[1] THEN\nX=1\nENDIF\n", True),
        ("REPEAT\nX=1\nUNTIL $IN[1]\n", True),
        ("PULSE($OUT[1],TRUE,0.5)\n", True),
        ("P=$POS_ACT\n", True),
        ("$VEL_AXIS=30\n$ACC.CP=1\n", False),
        ("TRIGGER WHEN DISTANCE=0 DELAY=20 DO $OUT[1]=TRUE\n", False),
        ("TRIGGER WHEN PATH=-20 DELAY=0 DO PULSE($OUT[1],TRUE,0.5)\n", False),
        ("PTP $AXIS_ACT\n", True),
    ],
)
def test_what_stops_the_look_ahead_of_krl_leaves_the_corner_open(between: str, leaves_open: bool) -> None:
    text = f"DEF a()\n{KRL_SPEEDS}{ptp(17)[:-1]} C_PTP\n{between}{ptp(27)}END\n"
    waits = "the program waits before the move that it is blended into"
    assert whys(krl(text)) == [waits if leaves_open else "", ""]
    # From round to round, too.
    rounds = f"DEF a()\n{KRL_SPEEDS}LOOP\n{between}{ptp(17)}{ptp(27)[:-1]} C_PTP\nENDLOOP\nEND\n"
    assert (waits in whys(krl(rounds))) == leaves_open


def test_a_loop_that_waits_for_something_leaves_the_corner_open() -> None:
    waits = "the program waits before the move that it is blended into"
    loop = "while get_digital_in(1) == False:\nsync()\nend\n"
    assert whys(urscript(f"{j(0.5, 0.1)}{loop}{j(0.2)}")) == [waits, ""]
    loop = "WHILE DInput(di1)=0 DO\nENDWHILE\n"
    text = f"PROC main()\n{absj(17).replace('fine', 'z50')}{loop}{absj(27)}ENDPROC\n"
    assert whys(rapid(text)) == [waits, ""]


ASKED = 'request_boolean_from_primary_client("go on?")'


@pytest.mark.parametrize("between", [ASKED, f"ok = {ASKED}", f"if {ASKED}:\nsync()\nend", f"n = 1 + {ASKED}"])
def test_a_question_to_who_stands_at_the_pendant_leaves_the_corner_open(between: str) -> None:
    waits = "the program waits before the move that it is blended into"
    assert whys(urscript(f"{j(0.5, 0.1)}{between}\n{j(0.2)}")) == [waits, ""]
    # From round to round, too.
    assert waits in whys(urscript(f"while True:\n{between}\n{j(0.2)}{j(0.5, 0.1)}end\n"))


@pytest.mark.parametrize("setting", ["$ORI_TYPE=#CONSTANT", "$CIRC_TYPE=#PATH", "$IPO_MODE=#TCP", "$ROBROOT=R"])
def test_poses_are_not_known_where_the_tool_turns_otherwise(setting: str) -> None:
    frames = "$TOOL={X 0,Y 0,Z 0,A 0,B 0,C 0}\n$BASE={X 0,Y 0,Z 0,A 0,B 0,C 0}\n"
    assert whys(krl(f"DEF a()\n{setting}\n{frames}{KRL_SPEEDS}{ptp(17)}{LIN}END\n")) == ["", FRAME]


def test_what_is_ordinary_is_understood() -> None:
    ordinary = "$ORI_TYPE=#VAR\n$CIRC_TYPE=#BASE\n$IPO_MODE=#BASE\nPTP $AXIS_ACT\n$VEL.ORI1=200\n$GEAR_JERK[1]=50\n"
    read = krl(f"DEF a()\n{KRL_SPEEDS}{ordinary}{ptp(17)}{LIN}END\n")
    assert whys(read) == ["", ""]
    assert not read.not_understood


@pytest.mark.parametrize("done", ["GO() PRIO=-1", "$VEL.CP=2", "$OUT[1]=GO()", "PULSE($OUT[1],GO(),1)", ""])
def test_what_else_runs_while_the_arm_moves_is_not_understood(done: str) -> None:
    read = krl(f"DEF a()\n{KRL_SPEEDS}{ptp(17)}TRIGGER WHEN DISTANCE=0 DELAY=0 DO {done}\n{LIN}END\nDEF GO()\nEND\n")
    assert [line for line, _ in read.not_understood] == [5]
    assert whys(read) == ["", "its speed may be one of several"]


@pytest.mark.parametrize(("frame", "leaves_open"), [("$TOOL", True), ("$BASE", False)])
def test_a_line_is_not_blended_into_one_of_another_tool(frame: str, leaves_open: bool) -> None:
    """Whether the controller does is not certain; a base is a way to write targets, and no more."""
    far = LIN.replace("550", "500").replace("350", "300")
    text = f"{ptp(17)}{LIN[:-1]} C_DIS\n{frame}={{X 0,Y 0,Z 50,A 0,B 0,C 0}}\n{far}"
    why = "the tool changes before the move that it is blended into" if leaves_open else ""
    assert whys(krl(f"DEF a()\n{KRL_SPEEDS}$APO.CDIS=10\n{text}END\n")) == ["", why, ""]


@pytest.mark.parametrize(("variable", "why"), [("$OV_PRO=50", ""), ("$DELTAWORKBASE={X 5,Y 0,Z 0,A 0,B 0,C 0}", FRAME)])
def test_a_system_variable_that_is_not_understood_may_move_targets(variable: str, why: str) -> None:
    frames = "$TOOL=$NULLFRAME\n$BASE=$NULLFRAME\n"
    assert whys(krl(f"DEF a()\n{ptp(17)}{variable}\n{frames}{KRL_SPEEDS}{LIN}{ptp(17)}END\n"))[1:2] == [why]


def test_an_index_that_is_assigned_is_no_longer_the_loops() -> None:
    text = f"FOR I=1 TO 6\n$VEL_AXIS[I]=100\nENDFOR\nI=2\n$VEL_AXIS[I]=10\n{ptp(17)}"
    assert whys(krl(f"DEF a()\n{text}END\n")) == ["its speed may be one of several"]


@pytest.mark.parametrize(
    ("text", "blend"),
    [
        ("$APO.CDIS=5\n{corner}", 0.005),
        ("{corner}$APO.CDIS=5\n", math.inf),
        ("IF $FLAG[1] THEN\n$APO.CDIS=5\nENDIF\n{corner}", math.inf),
        ("$APO.CDIS=5\nBAS(#INITMOV,0)\n$VEL.CP=0.2\n{corner}", math.inf),
        ("$APO.CDIS=5\n$APO={{CDIS 90}}\n{corner}", math.inf),
        ("$APO.CDIS=5\nGO()\n{corner}$APO.CDIS=9\n", 0.007),
        ("$APO.CDIS=0\n{corner}", 0.0),
    ],
)
def test_a_blend_distance_is_in_force_where_it_was_set_on_every_way(text: str, blend: float) -> None:
    corner = f"{LIN[:-1]} C_DIS\nLIN {{X -600,Y -350,Z 500,A 0,B 0,C 180}}\n"
    frames = "$TOOL={X 0,Y 0,Z 0,A 0,B 0,C 0}\n$BASE={X 0,Y 0,Z 0,A 0,B 0,C 0}\n"
    body = text.format(corner=corner if "BAS" not in text else frames + corner)
    read = krl(f"DEF a()\n{KRL_SPEEDS}{ptp(17)}{body}END\nDEF GO()\n$APO.CDIS=7\nEND\n")
    told = Interpreter(read, cell().robot, cell().start, "program")
    found = [visit.leg for chain in told.chains() for visit in chain]
    assert [None if leg is None else leg.blend for leg in found] == [0.0, blend, 0.0]
    assert any("how far it is blended is not known" in note for note in told.notes) == math.isinf(blend)


@pytest.mark.parametrize(("ahead", "blends"), [("3", True), ("1", True), ("0", False), ("N", False)])
def test_a_program_that_does_not_look_ahead_blends_nothing(ahead: str, blends: bool) -> None:
    text = f"$ADVANCE={ahead}\n$APO.CDIS=5\n{KRL_SPEEDS}{ptp(17)[:-1]} C_DIS\n{ptp(27)}"
    waits = "the program waits before the move that it is blended into"
    assert whys(krl(f"DEF a()\n{text}END\n")) == ["" if blends else waits, ""]


@pytest.mark.parametrize(
    ("body", "known"),
    [
        ("n = n + 1\nsleep(0.1)\n", True),
        ("if n > 3:\nreturn 1\nend\n", True),
        ("movej(q)\n", False),
        ("set_tcp(p[0,0,1,0,0,0])\n", False),
        ("grip()\n", False),
    ],
)
def test_a_thread_that_only_counts_leaves_the_arm_where_it_is(body: str, known: bool) -> None:
    thread = f"thread T():\nwhile (True):\n{body}end\nend\n"
    assert whys(urscript(f"{thread}{j(0.5)}run T()\n{j(0.3)}"))[:2] == ["", "" if known else BEGIN]


def test_the_size_of_a_corner_of_an_unknown_tool_is_not_known() -> None:
    for tool, blend in (("p[0,0,0.2,0,0,0]", 0.05), ("t", math.inf)):
        told = Interpreter(urscript(f"set_tcp({tool})\n{j(0.5, 0.05)}{j(0.2)}"), cell().robot, cell().start, "program")
        ((first, last),) = told.chains()
        assert first.leg is not None
        assert (first.leg.blend, first.why, last.why) == (blend, "", "")
        assert bool(told.notes) == math.isinf(blend)


def test_a_round_goes_over_into_the_next_at_the_speeds_of_later_rounds() -> None:
    """The first round ends slower than the second, which goes over into the third."""
    rounds = f"FOR I=1 TO 3\n{ptp(20)}{ptp(10)[:-1]} C_DIS\n$VEL_AXIS=40\nENDFOR\n"
    read = krl(f"DEF a()\n$APO.CDIS=5\n{KRL_SPEEDS}{rounds}END\n")
    chains = Interpreter(read, cell().robot, cell().start, "program").chains()
    found = [[(visit.move.line, visit.slots[0].value) for visit in chain] for chain in chains]
    assert found == [[(6, 20.0)], [(7, 20.0), (6, 40.0)], [(7, 40.0), (6, 40.0)], [(7, 40.0)]]


def test_a_move_that_goes_nowhere_leaves_the_corner_before_it_open() -> None:
    """Half of its way is nothing: the arm goes to the target itself."""
    twice = whys(urscript(f"{j(0.5, 0.1)}{j(0.5, 0.1)}{j(0.2)}"))
    assert twice == ["the move that it is blended into goes nowhere", "", ""]
    assert whys(urscript(f"{j(0.5)}{j(0.5, 0.1)}{j(0.2)}")) == ["", "", ""]


@pytest.mark.parametrize("kind", ["LIN", "PTP"])
def test_half_a_turn_goes_either_way_round(kind: str) -> None:
    """Which is decided by digits of the pose, and by encoders."""
    said = "the tool turns by half a turn, and which way round is not known"
    for degrees in (180, -179.99, 179.99, 179.9):
        turned = LIN.replace("LIN", kind).replace("A 0", f"A {degrees}")
        told = whys(krl(f"DEF a()\n{KRL_SPEEDS}{ptp(17)}{LIN}{turned}END\n"))
        assert told == ["", "", said if degrees != 179.9 else ""]


@pytest.mark.parametrize(("override", "may"), [("100", False), ("50", False), ("120", True), ("speed", True)])
@pytest.mark.parametrize("before", ["", "IF b "])
def test_an_override_that_may_raise_speeds_leaves_them_open(before: str, override: str, may: bool) -> None:
    """VelSet takes a share of what is written, of 100 % and more."""
    raised = "VelSet of line 5 may set more than the speed that is written"
    text = f"VAR num speed;\nPROC main()\n{absj(17)}{before}VelSet {override},5000;\n{absj(27)}ENDPROC\n"
    assert (raised in whys(rapid(text))) == may


def test_what_takes_moves_off_their_paths_leaves_all_of_them_open() -> None:
    """Also those that go from one known place to another while it does."""
    for call in ("track_conveyor_linear(p[1,0,0,0,0,0], 500)", "force_mode(p[0,0,0,0,0,0],[0,0,1,0,0,0],w,2,l)"):
        said = f"{call.partition('(')[0]} of line 2 may take it off its path"
        assert whys(urscript(f"{j(0.5)}{call}\n{j(0.3)}{j(0.2)}")) == [said] * 3
    for word in ("RSI_ON(#RELATIVE)", "$TECH.MODE=#CYCLE"):
        read = krl(f"DEF a()\n{KRL_SPEEDS}{ptp(17)}{word}\n{KRL_SPEEDS}{ptp(27)}{ptp(17)}END\n")
        assert all("line 5 may take it off its path" in why for why in whys(read))
    read = rapid(f"PROC main()\n{absj(17)}SoftAct 2,30;\n{absj(27)}{absj(3)}ENDPROC\n")
    assert whys(read) == ["SoftAct of line 4 may take it off its path"] * 3


def test_persistent_data_of_moves_are_named() -> None:
    """Other tasks and the pendant change them, and an earlier run may have."""
    tool = "PERS tooldata grip:=[TRUE,[[0,0,0],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];\n"
    tool += "LOCAL PERS speeddata Quick:=[50,500,5000,1000];\nPERS num count:=0;\n"
    line = MOVE_L.replace("tool0", "grip").replace("v20", "quick")
    read = rapid(f"{tool}PROC main()\n{absj(17)}{line}ENDPROC\n")
    assert whys(read) == ["", ""]
    assert [note.partition(":")[0] for note in read.notes] == ["grip, Quick"]
    assert not rapid(f"{tool}PROC main()\n{absj(17)}{MOVE_L}ENDPROC\n").notes


@pytest.mark.parametrize(("switch", "why"), [("Off", ""), ("Wrist", FRAME), ("LockAxis4", FRAME)])
def test_lines_past_singularities_turn_the_tool_otherwise(switch: str, why: str) -> None:
    assert whys(rapid(f"PROC main()\n{absj(17)}SingArea \\{switch};\n{MOVE_L}ENDPROC\n")) == ["", why]


def test_a_line_that_a_sensor_corrects_is_not_known() -> None:
    corrected = "corrections that are not known before the program runs are added to it"
    for line in (MOVE_L.replace("tool0", "tool0\\Corr"), MOVE_L.replace("fine", "fine\\Corr")):
        assert whys(rapid(f"PROC main()\n{absj(17)}{line}ENDPROC\n")) == ["", corrected]


def test_a_program_of_rapid_that_may_run_in_cycles_says_where_they_begin() -> None:
    """Its first move goes from where main ends, unless the arm stands there already."""
    said = "line 3: in cycles it begins where main ends; that is not judged"
    for body, note in (
        (f"{absj(17)}{absj(27)}", [said]),
        (f"{absj(17)}{absj(27)}{absj(17)}", []),
        (f"{absj(17)}Outside;\n", [said]),
        (f"WHILE TRUE DO\n{absj(17)}{absj(27)}ENDWHILE\n", []),
        (f"{absj(17)}{absj(27)}EXIT;\n", []),
    ):
        told = Interpreter(rapid(f"PROC main()\n{body}ENDPROC\n"), cell().robot, cell().start, "program")
        assert len(told.chains()) == body.count("MoveAbsJ") + body.startswith("WHILE")
        assert told.notes == note


def test_a_function_of_the_program_hides_an_instruction_of_its_name() -> None:
    text = f"PROC main()\n{absj(17)}Reset;\n{absj(27)}ENDPROC\nPROC Reset()\n{absj(3)}ENDPROC\n"
    assert begins(rapid(text)) == [0.0, 17.0, 3.0]
    assert begins(urscript(f"def sync():\n{j(0.3)}end\n{j(0.5)}sync()\n{j(0.2)}")) == [0.0, 0.5, 0.3]
    twice = f"PROC Reset()\n{absj(3)}ENDPROC\n" * 2
    assert begins(rapid(f"PROC main()\n{absj(17)}Reset;\n{absj(27)}ENDPROC\n{twice}"))[:2] == [0.0, None]


@pytest.mark.parametrize(
    ("first", "second", "skips"),
    [(0.02, 0.02, False), (0.05, 0.05, False), (0.06, 0.05, True), (0.11, 0.0, True), (0.0, 0.11, True)],
)
def test_urscript_skips_a_move_whose_blends_overlap(first: float, second: float, skips: bool) -> None:
    """The second line is 0.1 m long: its controller leaves its end out where blends at its ends are longer."""
    place = "movel(p[{x},-0.38,{z},-2.03,2.40,0], v=0.1, r={r})\n"
    text = j(0.5) + place.format(x=-0.6, z=0.55, r=first) + place.format(x=-0.6, z=0.65, r=second)
    told = whys(urscript(text + place.format(x=-0.8, z=0.65, r=0)))
    assert any("overlap" in why for why in told) is skips
    assert any(told) is skips


def test_urscript_finds_joints_for_a_pose_with_the_tool_of_that_time() -> None:
    pose = "get_inverse_kin(p[-0.6,-0.38,0.55,-2.03,2.40,0])"
    other = "set_tcp(p[0,0,0.2,0,0,0])\n"
    assert whys(urscript(f"q = {pose}\n{other}movej(q, v=0.1)\n")) == [TARGET]
    assert whys(urscript(f"{other}movej({pose}, v=0.1)\n")) == [""]


@pytest.mark.parametrize(
    ("program", "holds"),
    [
        ("PROC main()\n{move}ERROR\n{set}TRYNEXT;\nENDPROC\n", True),
        ("PROC main()\n{move}ERROR\nHelp;\nTRYNEXT;\nENDPROC\nLOCAL PROC Help()\n{set}ENDPROC\n", True),
        ("PROC main()\n{move}ENDPROC\nLOCAL TRAP t\n{set}ENDTRAP\n", True),
        ("PROC main()\n{move}ERROR\nTRYNEXT;\nENDPROC\n", False),
        ("PROC main()\n{move}{set}ENDPROC\n", False),
    ],
)
def test_what_a_handler_displaces_holds_where_it_goes_back_to(program: str, holds: bool) -> None:
    for setting in ("PDispSet [[0,0,100],[1,0,0,0]];\n", "PDispOn p, tool0;\n", "SingArea \\Wrist;\n"):
        told = whys(rapid(program.format(move=absj(17) + MOVE_L, set=setting)))
        assert [why.endswith("may hold for it, too") for why in told[:2]] == [holds, holds]
        assert holds or not any(told[:2])


def test_the_turn_of_the_tool_outlasts_the_end_of_a_displacement() -> None:
    read = rapid(f"PROC main()\n{absj(17)}SingArea \\Wrist;\nPDispOff;\n{MOVE_L}ENDPROC\n")
    assert all(why.startswith("SingArea of line 4") for why in whys(read))


def test_a_cycle_that_the_program_ends_begins_the_next_where_it_stands() -> None:
    """``ExitCycle`` is the program's own jump to ``main``, from one place or from several."""
    assert begins(rapid(f"PROC main()\n{absj(17)}{absj(27)}ExitCycle;\nENDPROC\n")) == [0.0, 17.0, 27.0]
    text = f"PROC main()\n{absj(17)}{absj(27)}IF d=1 ExitCycle;\n{absj(0)}ENDPROC\n"
    assert begins(rapid(text)) == [0.0, 17.0, 27.0, None]
    text = f"PROC main()\n{absj(17)}{absj(0)}ENDPROC\nTRAP t\nExitCycle;\nENDTRAP\n"
    assert begins(rapid(text)) == [0.0, 17.0, None]


def test_a_stop_after_which_the_arm_does_not_go_back_leaves_open_where_it_is() -> None:
    for switch, begin in (("", 17.0), ("\\AllMoveTasks", 17.0), ("\\NoRegain", None)):
        read = rapid(f"PROC main()\n{absj(17)}Stop{switch};\n{absj(27)}ENDPROC\n")
        assert begins(read) == [0.0, begin]


@pytest.mark.parametrize("name", ["tool0", "wobj0"])
def test_data_of_the_program_hide_those_of_the_language(name: str) -> None:
    frame = "[[0,0,300],[1,0,0,0]]"
    own = {
        "tool0": f"[TRUE,{frame},[1,[0,0,1],[1,0,0,0],0,0,0]]",
        "wobj0": f'[FALSE,TRUE,"",{frame},[[0,0,0],[1,0,0,0]]]',
    }
    line = MOVE_L.replace("tool0", "tool0\\WObj:=wobj0")
    plain, hidden = (
        visits(rapid(f"PROC main()\n{data}{absj(17)}{line}ENDPROC\n"))[1]
        for data in ("", f"VAR {name[:4]}data {name}:={own[name]};\n")
    )
    assert plain.leg is not None
    assert hidden.leg is not None
    reached = [float(cell().robot.pose(leg.q[-1])[2, 3]) for leg in (plain.leg, hidden.leg)]
    assert reached[1] - reached[0] == pytest.approx(0.3, abs=1e-6)


def test_a_procedure_of_the_program_hides_a_move_of_its_name() -> None:
    head = "PROC MoveL(robtarget p,speeddata s,zonedata z,PERS tooldata t)\n"
    read = rapid(f"PROC main()\n{absj(17)}{MOVE_L}ENDPROC\n{head}TriggL p,v1000,io1,z,t;\nENDPROC\n")
    assert len(visits(read)) == 1
    assert read.not_understood[0] == (4, MOVE_L.strip())


def test_a_fly_by_point_with_data_of_a_stop_point_may_be_one() -> None:
    for zone, why in (("fine", ""), ("z10", "its zone is not known before the program runs")):
        line = MOVE_L.replace("fine", f"{zone}\\Inpos:=inpos50")
        assert whys(rapid(f"PROC main()\n{absj(17)}{line}{absj(17)}ENDPROC\n"))[1] == why


def test_a_function_that_is_waited_for_runs_again_and_again() -> None:
    ready = f"FUNC bool Ready()\n{absj(5)}{absj(9)}RETURN d=1;\nENDFUNC\n"
    read = rapid(f"PROC main()\n{absj(17)}WaitUntil Ready();\n{absj(27)}ENDPROC\n{ready}")
    assert begins(read) == [0.0, 17.0, 5.0, 9.0, 9.0]
    asks = "FUNC bool Ready()\nRETURN d=1;\nENDFUNC\n"
    assert begins(rapid(f"PROC main()\n{absj(17)}WaitUntil Ready();\n{absj(27)}ENDPROC\n{asks}")) == [0.0, 17.0]
