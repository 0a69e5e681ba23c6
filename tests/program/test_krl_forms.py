"""Programs that the smartPAD writes: inline forms, which call BAS for speed, blend, tool and base."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.program.evaluation import evaluate_program
from bumpstop.program.interpreter import Interpreter
from bumpstop.program.languages.blocks import moves_unseen
from bumpstop.program.languages.krl import read_krl
from bumpstop.program.languages.statements import ReadProgram
from bumpstop.program.writing import write_program
from program.corpora import EXAMPLES, cell
from program.test_flow import FRAME, KRL_SPEEDS, LIN, ptp, visits, whys

SPEED = "its speed may be one of several"
INI = """;FOLD INI;%{PE}
  ;FOLD BASISTECH INI
    GLOBAL INTERRUPT DECL 3 WHEN $STOPMESS==TRUE DO IR_STOPM ( )
    INTERRUPT ON 3
    BAS (#INITMOV,0 )
  ;ENDFOLD (BASISTECH INI)
;ENDFOLD (INI)
"""
HOME = """;FOLD PTP HOME Vel= 20 % DEFAULT;%{PE}%MKUKATPBASIS,%CMOVE,%VPTP,%P 1:PTP, 2:HOME, 3:, 5:20, 7:DEFAULT
$BWDSTART = FALSE
PDAT_ACT=PDEFAULT
FDAT_ACT=FHOME
BAS (#PTP_PARAMS,20 )
$H_POS=XHOME
PTP  XHOME
;ENDFOLD
"""
P1 = """;FOLD PTP P1 CONT Vel=30 % PDAT1 Tool[1]:grip Base[1];%{PE}%P 1:PTP, 2:P1, 3:C_DIS, 5:30, 7:PDAT1
$BWDSTART=FALSE
PDAT_ACT=PPDAT1
FDAT_ACT=FP1
BAS(#PTP_PARAMS,30)
PTP XP1 C_DIS
;ENDFOLD
"""
P2 = """;FOLD LIN P2 Vel=0.2 m/s CPDAT1 Tool[1]:grip Base[1] ;%{PE}
  ;FOLD Parameters ;%{h}
    ;Params IlfProvider=movement.old; Kuka.PointName=P2; Kuka.VelocityPath=0.2; IlfCommand=LIN
  ;ENDFOLD
  $BWDSTART = FALSE
  LDAT_ACT = LCPDAT1
  FDAT_ACT = FP1
  BAS(#CP_PARAMS, 0.2)
  SET_CD_PARAMS (1)
  LIN XP2
;ENDFOLD
"""
TOOL = "$TOOL = STOOL2(FP1), $BASE = SBASE(FP1.BASE_NO), $IPO_MODE = SIPO_MODE(FP1.IPO_FRAME)"
FRAMES = f"{TOOL}, $LOAD = SLOAD(FP1.TOOL_NO)"
OF_AXES = "$ACC_AXIS[1] = SACC_JOINT(PPDAT1), $APO = SAPO_PTP(PPDAT1), $GEAR_JERK[1] = SGEAR_JERK(PPDAT1)"
OF_LINES = "$ACC = SACC_CP(LCPDAT1), $ORI_TYPE = SORI_TYP(LCPDAT1), $APO = SAPO(LCPDAT1), $JERK = SJERK(LCPDAT1)"
COLLISION = "$COLLMON_TOL_PRO[1] = USE_CM_PRO_VALUES(0)"
SPTP = f""";FOLD SPTP P1 CONT Vel=30 % PDAT1 Tool[1]:grip Base[1] ;%{{PE}}
  ;FOLD Parameters ;%{{h}}
    ;Params IlfProvider=movement.spline; Kuka.PointName=P1; Kuka.VelocityPtp=30; IlfCommand=SPTP
  ;ENDFOLD
SPTP XP1 WITH $VEL_AXIS[1] = SVEL_JOINT(30.0), {FRAMES}, {OF_AXES}, {COLLISION} C_Spl
;ENDFOLD
"""
SLIN = f""";FOLD SLIN P2 Vel=0.2 m/s CPDAT1 Tool[1]:grip Base[1] ;%{{PE}}
  ;FOLD Parameters ;%{{h}}
    ;Params IlfProvider=movement.spline; Kuka.PointName=P2; Kuka.VelocityPath=0.2; IlfCommand=SLIN
  ;ENDFOLD
SLIN XP2 WITH $VEL = SVEL_CP(0.2, , LCPDAT1), {FRAMES}, {OF_LINES}, {COLLISION}
;ENDFOLD
"""
SPLINE_HOME = re.sub("FP1", "FHOME", re.sub("PPDAT1", "PDEFAULT", SPTP.replace("XP1", "XHOME").replace(" C_Spl", "")))
SPLINES = f"DEF form( )\n{INI}{SPLINE_HOME}{SPTP}{SLIN}{SPLINE_HOME}END\n"
PROGRAM = f"DEF form( )\n{INI}{HOME}{P1}{P2}{HOME}END\n"
DATA = """DEFDAT FORM
EXT BAS (BAS_COMMAND :IN,REAL :IN )
DECL E6POS XP1={X -600.0,Y -350.0,Z 550.0,A 0.0,B 0.0,C 180.0,S 2,T 26,E1 0.0}
DECL FDAT FP1={TOOL_NO 1,BASE_NO 1,IPO_FRAME #BASE,POINT2[] " ",TQ_STATE FALSE}
DECL PDAT PPDAT1={VEL 100.0,ACC 100.0,APO_DIST 50.0,APO_MODE #CDIS,GEAR_JERK 50.0}
DECL E6POS XP2={X -600.0,Y -174.0,Z 500.0,A 0.0,B 0.0,C 180.0,S 2,T 26,E1 0.0}
DECL LDAT LCPDAT1={VEL 2.0,ACC 100.0,APO_DIST 40.0,APO_FAC 50.0,ORI_TYP #VAR,CIRC_TYP #BASE,CB {AUX_PT {ORI #BASE}}}
ENDDAT
"""
CONFIG = """DEFDAT $CONFIG
DECL FRAME TOOL_DATA[16]
TOOL_DATA[1]={X 0.0,Y 0.0,Z 100.0,A 0.0,B 0.0,C 0.0}
DECL FRAME BASE_DATA[32]
BASE_DATA[1]={X 0.0,Y 0.0,Z -100.0,A 0.0,B 0.0,C 0.0}
DECL PDAT PDEFAULT={VEL 100.0,ACC 100.0,APO_DIST 100.0,APO_MODE #CPTP}
DECL FDAT FHOME={TOOL_NO 0,BASE_NO 0,IPO_FRAME #BASE,POINT2[] " "}
DECL E6AXIS XHOME={A1 17.0,A2 -85.0,A3 88.0,A4 -93.0,A5 -90.0,A6 0.0}
DECL REAL SLOW=0.1
ENDDAT
"""


def forms(text: str = PROGRAM, data: str = DATA, config: str = CONFIG) -> ReadProgram:
    return read_krl(text.encode(), data.encode(), config.encode())


def test_forms_say_speed_blend_tool_and_base() -> None:
    read = forms()
    assert not read.not_understood
    home, first, second, back = visits(read)
    assert [visit.why for visit in (home, first, second, back)] == [""] * 4
    assert [visit.slots[0].value for visit in (home, first, second, back)] == [20, 30, 0.2, 20]
    assert first.leg is not None
    assert second.leg is not None
    assert (first.leg.blend, second.leg.blend, second.leg.acceleration) == (0.05, 0.0, None)
    end = cell().robot.pose(second.leg.q[-1])[:3, 3]
    assert np.allclose(end, [-0.6, -0.174, 0.5], atol=1e-6), "the tool of 100 mm looks down, the base is as much lower"


@pytest.mark.parametrize(
    ("old", "new", "lin"),
    [
        ("FDAT FP1={TOOL_NO 1,BASE_NO 1,IPO_FRAME #BASE", "FDAT FP1={TOOL_NO 1,BASE_NO 1,IPO_FRAME #TCP", FRAME),
        ("FDAT FP1={TOOL_NO 1,BASE_NO 1,IPO_FRAME #BASE", "FDAT FP1={TOOL_NO 1,BASE_NO 1", FRAME),
        ("TOOL_NO 1", "TOOL_NO 2", FRAME),
        ("BASE_NO 1", "BASE_NO N", FRAME),
        ("DECL FDAT FP1", "DECL FDAT FP9", SPEED),
        ("ORI_TYP #VAR", "ORI_TYP #CONSTANT", FRAME),
        ("CIRC_TYP #BASE", "CIRC_TYP #PATH", FRAME),
        ("DECL LDAT LCPDAT1", "DECL LDAT LCPDAT9", SPEED),
        ("BAS(#CP_PARAMS, 0.2)", "BAS(#CP_PARAMS, SLOW)", SPEED),
        ("BAS(#CP_PARAMS, 0.2)", "BAS(#EX_BASE, 1)", SPEED),
        ("LDAT_ACT = LCPDAT1", "LDAT_ACT = LCPDAT1\nLDAT_ACT.ORI_TYP=#CONSTANT", SPEED),
        ("LDAT_ACT = LCPDAT1", "LDAT_ACT = LCPDAT1\nLCPDAT1.ORI_TYP=#CONSTANT", SPEED),
        ("BAS(#CP_PARAMS, 0.2)", "IF $IN[1] THEN\nLDAT_ACT=LOTHER\nENDIF\nBAS(#CP_PARAMS, 0.2)", SPEED),
    ],
)
def test_what_is_not_certain_leaves_poses_unknown(old: str, new: str, lin: str) -> None:
    assert old in PROGRAM + DATA
    found = [visit for visit in visits(forms(PROGRAM.replace(old, new), DATA.replace(old, new))) if visit.move.linear]
    assert [visit.why for visit in found] == [lin]


def test_without_the_controllers_data_a_note_says_what_to_give() -> None:
    read = forms(config="")
    assert {FRAME} < set(whys(read))
    given = "give the program's .dat and the controller's $config.dat in its folder"
    assert f"TOOL_DATA[1] is not known; {given}" in read.notes
    assert f"line 13: PDEFAULT is not known; {given}" in read.notes


def test_a_number_of_the_controller_may_be_another_when_the_program_runs() -> None:
    """Records are taught; what else stands in $config.dat programs leave there for each other."""
    read = forms(f"DEF a()\n$VEL_AXIS=20\n{ptp(17)}$VEL.CP=SLOW\n{LIN}END\n")
    assert whys(read)[1] == SPEED


def test_a_form_ends_at_its_move() -> None:
    assert whys(forms(f"DEF a()\n{HOME}{ptp(27)}BAS(#PTP_PARAMS,90)\n{ptp(17)}END\n")) == [
        *("", ""),
        SPEED,
    ]
    slow = forms(f"DEF a()\n{KRL_SPEEDS}{HOME}{P2}{ptp(17)}END\n")
    assert whys(slow) == ["", "", SPEED], "a form of a line may set the axes, too"


def test_a_blend_in_percent_is_half_of_the_way() -> None:
    read = forms(data=DATA.replace("#CDIS", "#CPTP"))
    interpreter = Interpreter(read, cell().robot, cell().start, "program")
    (blended,) = [v for chain in interpreter.chains() for v in chain if v.leg is not None and v.leg.blend > 0]
    assert blended.leg is not None
    assert blended.leg.blend == np.inf
    assert any("half of the way" in note for note in interpreter.notes)


def test_single_commands_of_bas() -> None:
    text = "BAS(#INITMOV,0)\nBAS(#VEL_PTP,20)\nBAS(#ACC_PTP,50)\nBAS(#VEL_CP,0.3)\nBAS(#TOOL,1)\nBAS(#BASE,0)\n"
    read = forms(f"DEF a()\n{text}{ptp(17)}{LIN}END\n")
    assert not read.not_understood
    joint, line = visits(read)
    assert (joint.slots[0].value, line.slots[0].value, joint.why, line.why) == (20, 0.3, "", "")
    assert line.leg is not None
    assert np.isclose(line.leg.tool[2, 3], 0.1)
    assert whys(forms(f"DEF a()\n{KRL_SPEEDS}BAS(#INITMOV,0)\n{ptp(17)}{LIN}END\n")) == [SPEED, SPEED]
    assert whys(forms(f"DEF a()\n{KRL_SPEEDS}{text}{ptp(17)}{LIN}END\nDEF BAS(C:IN,R:IN)\nEND\n")) == [SPEED, SPEED]


@pytest.mark.parametrize(
    ("interrupt", "harmless", "unseen"),
    [
        ("GLOBAL INTERRUPT DECL 3 WHEN $STOPMESS==TRUE DO IR_STOPM ( )\nINTERRUPT ON 3\n", True, False),
        ("GLOBAL INTERRUPT DECL 3 WHEN $IN[1]==TRUE DO IR_STOPM ( )\nINTERRUPT ON 3\n", False, False),
        ("INTERRUPT DECL N WHEN $IN[1]==TRUE DO IR_STOPM ( )\nINTERRUPT ON 3\n", False, False),
        ("INTERRUPT ON 3\n", False, False),
        ("SET_CD_PARAMS(2)\n", True, False),
        ("SET_CD_PARAMS(GO())\n", False, True),
        ("GLOBAL INTERRUPT DECL 3 WHEN $STOPMESS==TRUE DO HIT ( )\n", False, False),
    ],
)
def test_the_interrupt_of_every_program(interrupt: str, harmless: bool, unseen: bool) -> None:
    read = forms(f"DEF a()\n{interrupt}{KRL_SPEEDS}{ptp(17)}END\n")
    assert (not read.not_understood) == harmless
    assert any(moves_unseen(body) for body in read.functions.values()) == unseen


def test_a_new_speed_stands_in_the_fold_too(tmp_path: Path) -> None:
    for name, text in (("form.src", PROGRAM), ("form.dat", DATA), ("$config.dat", CONFIG)):
        (tmp_path / name).write_text(text)
    out, path = tmp_path / "out", tmp_path / "form.src"
    result = evaluate_program(path, bs.load_scenario(EXAMPLES / "cell.toml"))
    assert result.written_outcome == "PASS"
    write_program(result, path, out)
    assert {file.name for file in out.iterdir()} >= {"form.src", "form.dat", "$config.dat"}
    before, after = PROGRAM.splitlines(), (out / "form.src").read_text().splitlines()
    changed = [(a, b) for a, b in zip(before, after, strict=True) if a != b]
    assert len(changed) == 9, "two lines of each form, three of the last kind"
    (speed,) = {b.rpartition(", ")[2][:-1] for a, b in changed if a == "  BAS(#CP_PARAMS, 0.2)"}
    assert [b.count(speed) for a, b in changed if "0.2" in a] == [1, 1, 1]
    assert not [b for a, b in changed if "0.2 " in b or "0.2;" in b]
    read = forms("\n".join(after))
    assert all(visit.slots[0].value == float(s) for visit, s in zip(visits(read)[2:3], [speed], strict=True))


def test_spline_forms_say_speed_blend_tool_and_base() -> None:
    read = forms(SPLINES)
    assert not read.not_understood
    home, first, second, back = visits(read)
    assert [visit.why for visit in (home, first, second, back)] == [""] * 4
    assert [visit.slots[0].value for visit in (home, first, second, back)] == [30, 30, 0.2, 30]
    assert [visit.move.linear for visit in (home, first, second, back)] == [False, False, True, False]
    assert first.leg is not None
    assert second.leg is not None
    assert (first.leg.blend, second.leg.blend, second.leg.acceleration) == (0.05, 0.0, None)
    end = cell().robot.pose(second.leg.q[-1])[:3, 3]
    assert np.allclose(end, [-0.6, -0.174, 0.5], atol=1e-6), "the same places as of the other forms"


def test_what_a_spline_form_sets_holds_for_it_alone() -> None:
    before = "$VEL_AXIS=20\n$VEL.CP=0.4\n$ACC.CP=1\n$TOOL=$NULLFRAME\n$BASE=$NULLFRAME\n"
    own = SPTP.replace(" C_Spl", "") + SLIN
    _, line, joint, last = visits(forms(f"DEF a()\n{before}{own}{ptp(17)}{LIN}END\n"))
    assert line.leg is not None
    assert line.leg.acceleration is None, "$ACC.CP is another one's"
    assert (line.slots[0].value, last.slots[0].value) == (0.2, 0.4)
    assert joint.why == SPEED, "how the speed of axis 1 holds for all axes is not known"
    assert last.leg is not None
    assert (last.why, last.leg.acceleration) == ("", 1)
    assert np.allclose(last.leg.tool, np.eye(4))


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('IPO_FRAME #BASE,POINT2[] " ",TQ_STATE', 'IPO_FRAME #TCP,POINT2[] " ",TQ_STATE'),
        ("TOOL_NO 1", "TOOL_NO 2"),
        ("BASE_NO 1", "BASE_NO N"),
        ("DECL FDAT FP1", "DECL FDAT FP9"),
        ("ORI_TYP #VAR", "ORI_TYP #CONSTANT"),
        ("DECL LDAT LCPDAT1", "DECL LDAT LCPDAT9"),
        ("SVEL_CP(0.2, , LCPDAT1)", "SVEL_CP(SLOW, , LCPDAT1)"),
        ("SVEL_CP(0.2, , LCPDAT1)", "SVEL_CP(0.2, 5.0, LCPDAT1)"),
        ("SVEL_CP(0.2, , LCPDAT1)", "SVEL_CP(0.2, , LCPDAT2)"),
        ("SVEL_CP(0.2, , LCPDAT1)", "SVEL_CP(0.2)"),
        ("$VEL = SVEL_CP(0.2, , LCPDAT1), ", ""),
        ("$VEL = SVEL_CP(0.2, , LCPDAT1), ", "$VEL = SVEL_CP(0.2, , LCPDAT1), $VEL = SVEL_CP(0.4, , LCPDAT1), "),
        ("$ORI_TYPE = SORI_TYP(LCPDAT1), ", ""),
        ("$APO = SAPO(LCPDAT1), ", "$APO = SAPO(LCPDAT1), $APO.CDIS = N, "),
        ("$ACC = SACC_CP(LCPDAT1), ", "$ACC = SACC_CP(GO()), "),
        ("SBASE(FP1.BASE_NO)", "SBASE(FP2.BASE_NO)"),
        ("SLIN XP2 WITH", "SLIN XP2 C_SPL WITH"),
        (f"{OF_LINES}, {COLLISION}", f"{OF_LINES}, {COLLISION} C_DIS"),
        ("SLIN XP2 WITH", "SPLINE\nSLIN XP2 WITH"),
        ("SLIN XP2 WITH", "SLIN GO() WITH"),
        ("SVEL_CP(0.2, , LCPDAT1)", "SVEL_CP(0.2*GO(), , LCPDAT1)"),
        ("SVEL_CP(0.2, , LCPDAT1)", "SVEL_CP(0.2, , LCPDAT1)*2"),
        ("SLIN XP2 WITH", "FP1.TOOL_NO=2\nSLIN XP2 WITH"),
    ],
)
def test_what_is_not_certain_of_a_spline_form_is_not_judged(old: str, new: str) -> None:
    assert old in SPLINES + DATA
    read = forms(SPLINES.replace(old, new), DATA.replace(old, new))
    lines = [visit for visit in visits(read) if visit.move.linear]
    assert all(visit.why for visit in lines)
    assert lines or read.not_understood


def test_functions_of_the_programs_own_are_not_kukas() -> None:
    read = forms(f"{SPLINES}DEFFCT FRAME STOOL2(F:IN)\nENDFCT\n")
    assert len(read.not_understood) >= 4
    assert not visits(read)


def test_spline_moves_blend_into_spline_moves_alone() -> None:
    for text in (f"{SPTP}{P2}", f"{P1}{SLIN}"):
        first = visits(forms(f"DEF form( )\n{INI}{HOME}{text}END\n"))[1]
        assert "spline" in first.why
    first = visits(forms(f"DEF form( )\n{INI}{HOME}{SPTP}{SLIN}END\n"))[1]
    assert first.why == ""


def test_other_spline_moves_are_not_followed() -> None:
    circle = SLIN.replace("SLIN XP2", "SCIRC XP1, XP2")
    plain = "SPLINE\nSPL XP1\nENDSPLINE\n"
    for text in (circle, "SLIN XP2\n", "SPTP XP1\n", "SLIN_REL {X 1}\n", plain):
        read = forms(f"DEF form( )\n{INI}{SPLINE_HOME}{text}{SLIN}END\n")
        assert read.not_understood
        assert "" not in [visit.why for visit in visits(read)][1:]


def test_a_new_speed_of_a_spline_form_stands_in_its_fold_too(tmp_path: Path) -> None:
    for name, text in (("form.src", SPLINES), ("form.dat", DATA), ("$config.dat", CONFIG)):
        (tmp_path / name).write_text(text)
    out, path = tmp_path / "out", tmp_path / "form.src"
    result = evaluate_program(path, bs.load_scenario(EXAMPLES / "cell.toml"))
    assert result.written_outcome == "PASS"
    write_program(result, path, out)
    before, after = SPLINES.splitlines(), (out / "form.src").read_text().splitlines()
    changed = [(a, b) for a, b in zip(before, after, strict=True) if a != b]
    read = forms("\n".join(after))
    assert not read.not_understood
    assert changed
    for _, new in changed:
        if "SVEL_" in new:
            at = after.index(new)
            speed = new.partition("SVEL_")[2].partition("(")[2].partition(",")[0].partition(")")[0]
            speed = speed.removesuffix(".0")
            assert f"Vel={speed} " in after[at - 4]
            assert f"={speed};" in after[at - 2]
