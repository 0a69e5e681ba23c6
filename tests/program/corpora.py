"""Programs to try readers on, and a cell that judges them."""

from __future__ import annotations

import random
from functools import cache
from pathlib import Path

import numpy as np

import bumpstop as bs
from bumpstop.arrays import FloatArray
from bumpstop.program.cell import Cell
from bumpstop.program.interpreter import Interpreter
from bumpstop.program.languages.urscript import read_urscript
from bumpstop.program.segment import MoveSegment

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "examples" / "programs"
URSCRIPT = (
    (EXAMPLES / "place.script").read_bytes(),
    b"",
    b"\n\r\n\t movej ( [0,1,2,3,4,5] ,a = 1.4,v=1.05 ) # \xff\xfe comment\r\nend end\n",
    b"def f():\n while True:\n  x = p[1,2\n  if (not ]]]):\n movel(x, v=1e)\n",
    b'textmsg("movej([0,0,0,0,0,0])")\nthread t():\n movep(p[.1,.2,.3,0,0,0], 1.2, .1, r=0.01)\nend\n\x00',
    b"def a():\n movec(p[.1,.2,.3,0,0,0], p[.2,.1,.3,0,0,0], v=.2, r=.01, mode=0)\n movej([1,2,3,4,5,6], t=2.5)\nend",
)
KRL = (
    (EXAMPLES / "place.src").read_bytes(),
    (EXAMPLES / "place.dat").read_bytes(),
    b"&ACCESS\r\nDEF x()\r\n"
    b";FOLD PTP P1 Vel=100 %\r\nPTP {E6AXIS: A1 0, A2 -90.5} C_PTP\r\nLIN {X 1,Y\r\n$VEL.CP=\r\nEND",
    b"SWITCH I\nCASE 1\nLIN P1 C_DIS C_VEL\nDEFAULT\nGOTO A\nENDSWITCH\nENDLOOP\n\x80\x81",
    b"$VEL.CP=.2\nCIRC {X 1,Y 2,Z 3},{X 3,Y 2,Z 1,A 0,B 0,C 180},CA 90 C_DIS\nGRIP(1)\nCIRC P1,P2\n",
    b"GLOBAL INTERRUPT DECL 3 WHEN $STOPMESS==TRUE DO IR_STOPM ( )\nINTERRUPT ON 3\nBAS (#INITMOV,0 )\n"
    b";FOLD LIN P1 Vel=2 m/s;%{PE}%P 3:C_DIS, 5:2\nLDAT_ACT={APO_DIST 5,ORI_TYP #VAR}\n"
    b'FDAT_ACT={TOOL_NO 0,BASE_NO 1,IPO_FRAME #BASE,POINT2[] " "}\nBAS(#CP_PARAMS,2)\nLIN P1 C_DIS\n',
)
RAPID = (
    (EXAMPLES / "place.mod").read_bytes(),
    b"MODULE m\r\nPROC main() MoveL \\Conc, p1, v100\\V:=50, z10\\Z:=3, tool0\\WObj:=w;\r\nENDPROC",
    b'IF a THEN TPWrite "; MoveL"; ELSEIF b MoveJ p,v,z; ENDIF ! \xc3\xa4 MoveL p1,v1,fine,tool0;\n'
    b"MoveAbsJ [[0,0],[9E9]],v5,z0,t;",
    b"CONST robtarget p:=[[1,2,3],[1,0,0,0],[0,0,0,0],[9E9]];WHILE TRUE DO ;;; ENDWHILE \x00 ENDMODULE",
    b"PROC a() MoveC p1,[[1,2,3],[1,0,0,0],[0,0,0,0],[9E9]],v10\\T:=5,z1,tool0; MoveC a,b,c,d,e; MoveC ;ENDPROC",
)


@cache
def cell() -> Cell:
    return Cell(bs.load_scenario(EXAMPLES / "cell.toml"))


def segments(text: str) -> list[MoveSegment]:
    read = read_urscript(text.encode())
    found = Interpreter(read, cell().robot, cell().start, "program").chains()
    return [MoveSegment(chain, cell().robot, cell().joint_acceleration, 1.0) for chain in found]


def bell(begin: FloatArray, end: FloatArray, duration: float, t: FloatArray) -> FloatArray:
    s = np.clip(t / duration, 0, 1)[:, None]
    return np.asarray(begin + (end - begin) * (10 * s**3 - 15 * s**4 + 6 * s**5))


def mutated(sources: tuple[bytes, ...], seed: int, *, whole: bool = False) -> bytes:
    """Bytes of two programs, or of one as a ``whole``, with some swapped, dropped, doubled or thrown in."""
    draw = random.Random(seed)
    one, other = draw.choice(sources), draw.choice(sources)
    text = bytearray(one if whole else one[: draw.randint(0, len(one))] + other[draw.randint(0, len(other)) :])
    for _ in range(draw.randint(0, 12)):
        at = draw.randint(0, len(text))
        what = draw.randint(0, 3)
        if what == 0:
            text[at : at + draw.randint(1, 9)] = b""
        elif what == 1:
            text[at:at] = text[at : at + draw.randint(1, 40)]
        elif what == 2:
            text[at:at] = bytes(draw.choices(b"()[]{}\\;:=,.\n\"'!#$&p9eE-+ \xff\x00", k=draw.randint(1, 4)))
        else:
            text[at:at] = draw.choice([b"[" * 60, b"1e999", b"LIN ", b"movej(", b"MoveL ", b" end\n", b"$VEL.CP="])
    return bytes(text)
