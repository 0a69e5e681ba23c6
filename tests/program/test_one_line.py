"""Several statements on one line: none is left out in silence."""

from __future__ import annotations

import math
import re

import pytest

from program.test_flow import KRL_SPEEDS, absj, begins, krl, ptp, rapid, urscript, visits, whys

UNKNOWN_SPEED = "its speed is not known before the program runs"
A, B, C = absj(1), absj(2), absj(3)


@pytest.mark.parametrize(
    "body",
    [
        f"TEST n\nCASE 1: {B}ENDTEST\n",
        f"TEST n\nCASE 1,\n2: {B}ENDTEST\n",
        f"TEST n CASE 1: {B}DEFAULT: {C}ENDTEST\n",
        f"TEST n\nDEFAULT: {B}ENDTEST\n",
        f"WHILE n=1 DO {B}ENDWHILE\n",
        f"WHILE n=1 AND\nNOT b DO {B}ENDWHILE\n",
        f"FOR i FROM 1 TO n DO {B}ENDFOR\n",
        f"IF n=1 THEN {B}ELSEIF n=2 THEN {C}ELSE {B}ENDIF\n",
        f"IF n=1\nTHEN {B}ENDIF\n",
        f"IF n=1 THEN\nENDIF {B}",
        f"next: {B}",
        f"next:\nWHILE n=1 DO {B}ENDWHILE\n",
    ],
)
def test_rapid_reads_what_stands_behind_a_word(body: str) -> None:
    read = rapid(f"PROC main()\n{A}{body}{absj(4)}ENDPROC\n")
    apart = re.sub(r"(:|DO|THEN|ELSE|ENDIF) (?=MoveAbsJ)|(?<=TEST n) ", r"\1\n", body)
    assert begins(read) == begins(rapid(f"PROC main()\n{A}{apart}{absj(4)}ENDPROC\n"))
    found = {visit.move.target.joints[0] for visit in visits(read) if visit.move.target.joints}
    angles = re.findall(r"MoveAbsJ \[\[(\d)", f"{A}{body}{absj(4)}")
    assert sorted(round(math.degrees(angle)) for angle in found) == sorted({int(angle) for angle in angles})
    assert [text for _, text in read.not_understood if text != "next:"] == []


@pytest.mark.parametrize("head", ["PROC main() ", "PROC main(\n) ", "LOCAL PROC main()\n", "LOCAL PROC main() "])
def test_rapid_reads_what_stands_behind_a_head(head: str) -> None:
    read = rapid(f"{head}{A}{B}ENDPROC PROC q() {C}ENDPROC TRAP t {C}ENDTRAP ")
    assert (read.not_understood, begins(read)) == ((), [0.0, 1.0, None, None])


@pytest.mark.parametrize("line", ["WHILE n=1", "CASE 1", "DEFAULT", "ELSEIF n=1", "TEST n", "WHILE (n=1", "PROC p"])
def test_rapid_names_what_it_cannot_divide(line: str) -> None:
    read = rapid(f"PROC main()\n{A}{line} {B}{C}ENDPROC\n")
    assert any(text.startswith(f"{line} MoveAbsJ") for _, text in read.not_understood)
    assert begins(read)[-1] is None


@pytest.mark.parametrize(
    "change",
    [
        *(f"IF di1=1 {change};" for change in ("x:=1000", "Incr x", "Add x,5", "Other x", "Other 1,f(x)")),
        "IF di1=1\nx:=1000;",
        "IF NOT (di1=1) IF b x:=1000;",
        "CASE 1: x:=900;",
        "WHILE n=1 DO x:=900;",
        "WHILE n=1 x:=900;",
        "IF (n=1 x:=900;",
    ],
)
def test_rapid_counts_what_a_line_assigns(change: str) -> None:
    move = A.replace("v100", "v100\\V:=x")
    read = rapid(f"VAR num x:=10;\nPROC main()\n{move}{change}\n{move}ENDPROC\n")
    assert whys(read)[0] == UNKNOWN_SPEED


def test_rapid_keeps_what_a_condition_reads() -> None:
    move = A.replace("v100", "v100\\V:=x")
    read = rapid(f"VAR num x:=10;\nPROC main()\n{move}IF x=1 SetDO d,1;\nIF x=1 y:=x;\n{move}ENDPROC\n")
    assert whys(read)[0] == ""


@pytest.mark.parametrize(
    "line",
    [
        *("SWITCH I\nCASE 1 {}", "SWITCH I\nDEFAULT {}", "IF X THEN {}", "IF X THEN\nELSE {}", "IF X THEN\nENDIF {}"),
        *("LOOP {}", "REPEAT {}", "WHILE X AND $IN[1] {}", "FOR I=1 TO 3 {}", "SWITCH I {}", "WHILE (X {}"),
        *("REPEAT\nUNTIL X {}", "END\nDEF B() {}"),
    ],
)
def test_krl_names_what_stands_behind_a_word(line: str) -> None:
    read = krl(f"DEF a()\n{KRL_SPEEDS}{ptp(1)}{line.format(ptp(2))}END\n")
    assert any("PTP {A1 2" in text for _, text in read.not_understood)
    place = "XA={A1 17,A2 -85,A3 88,A4 -93,A5 -90,A6 0}\n"
    read = krl(f"DEF a()\n{place}{KRL_SPEEDS}PTP XA\n{line.format('XA=XB')}\nEND\n")
    assert whys(read)[0] == "its target is not known before the program runs"


def test_krl_conditions_hold_no_statements() -> None:
    line = "SWITCH I\nCASE 1,'H1F',#A\nENDSWITCH\nIF (X==1) AND NOT Y B_OR Z THEN\nELSE\nENDIF\nREPEAT\nUNTIL (X)\n"
    read = krl(f"DEF a(X:IN)\n{KRL_SPEEDS}{line}FOR I=1 TO 9 STEP 2\nENDFOR\nEND\nGLOBAL DEFFCT INT B( )\nENDFCT\n")
    assert read.not_understood == ()


@pytest.mark.parametrize("line", ["if c: z = 1", "while c: z = 1", "y = 1; z = 1"])
def test_urscript_counts_what_a_line_assigns(line: str) -> None:
    read = urscript(f"z = 0\n{line}\nmovej([z,-1.57,1.57,-1.57,-1.57,0])\n")
    assert whys(read)[-1] == "its target is not known before the program runs"
