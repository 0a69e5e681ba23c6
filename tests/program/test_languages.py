"""What readers understand: targets, speeds, blends, and what they do not."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import bumpstop as bs
from bumpstop.program.evaluation import evaluate_program
from bumpstop.program.interpreter import Interpreter, Visit
from bumpstop.program.languages.krl import read_krl
from bumpstop.program.languages.rapid import read_rapid
from bumpstop.program.languages.rotation import from_euler_zyx, from_quaternion
from bumpstop.program.languages.statements import ReadProgram
from bumpstop.program.languages.urscript import read_urscript
from bumpstop.program.motion.kinematics import transform
from bumpstop.program.segment import Segment
from bumpstop.program.source import TextProgram, read_source
from bumpstop.program.writing import write_program
from program.corpora import EXAMPLES, cell

HOME = "[0, -1.57, 1.57, -1.57, -1.57, 0]"
ASIDE = "[0.3, -1.57, 1.57, -1.57, -1.57, 0]"


def chains(read: ReadProgram, *, start: bool = True) -> list[tuple[Visit, ...]]:
    return Interpreter(read, cell().robot, cell().start if start else None, "program").chains()


def whys(text: str, *, start: bool = True) -> list[str]:
    return [visit.why for chain in chains(read_urscript(text.encode()), start=start) for visit in chain]


def test_urscript_defaults_and_arguments() -> None:
    text = f"q = {HOME}\nmovej({ASIDE}, 1.5, 0.3)\nmovej(q)\n"
    text += "movel(p[-0.7,-0.17,0.6,3.1,0,0], v=0.1*2, a=d2r(90), r=0.02)\n"
    first, second, third = (visit for chain in chains(read_urscript(text.encode())) for visit in chain)
    assert (first.slots[0].value, first.move.acceleration) == (0.3, 1.5)
    assert (second.slots[0].value, second.move.acceleration) == (1.05, 1.4)
    assert text[second.slots[0].start - 1 : second.slots[0].start + 1] == "q)"
    assert third.slots[0].value == pytest.approx(0.2)
    assert third.move.acceleration == pytest.approx(math.pi / 2)
    assert third.move.blend == 0.02
    assert text[third.slots[0].start : third.slots[0].end] == "0.1*2"
    assert third.leg is not None
    end = cell().robot.pose(third.leg.q[-1])
    assert np.allclose(end, transform((-0.7, -0.17, 0.6, 3.1, 0, 0)), atol=1e-8)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("x = 0.1\nx = 0.2\nmovej({A}, v=x)", "speed is not known"),
        ("movej(get_target())", "target is not known"),
        ("q = {A}\nq[0] = 1\nmovej(q)", "target is not known"),
        ("movej({A}, t=2, r=0.1)", "time t is given with a blend"),
        ("movel({A}, t=0.1)", "below 0.2 s"),
        ("movec(p[-0.7,-0.1,0.6,0,0,0], p[-0.7,0,0.6,3.1,0,0], mode=1)", "its mode turns the tool"),
        ("movec(x(), p[-0.7,0,0.6,3.1,0,0])", "target is not known"),
        ("pick(1)\nmovej({A})\nmovel(p[-0.7,-0.17,0.6,3.1,0,0])", "tool or frame"),
        ("movej([0, 1, 2])", "has 3 joints"),
        ("set_tcp(tool())\nmovel(p[-0.7,-0.17,0.6,3.1,0,0])", "tool or frame"),
        ("movel(p[5,0,0,0,0,0])", "cannot follow"),
        ("movej({A}, w=1)", "argument is not understood"),
        ("movej({A}, a=1, 3)", "argument is not understood"),
        ("movej({A}, v=0.1, v=3)", "argument is not understood"),
        ("movej({A}, 1, 0.1, v=3)", "argument is not understood"),
        ("movej({A}, 1, 0.1, 0, 0, 1)", "argument is not understood"),
    ],
)
def test_what_depends_on_what_is_not_known_is_named(text: str, why: str) -> None:
    assert why in whys(text.replace("{A}", ASIDE))[-1]


def test_where_a_move_begins() -> None:
    assert whys(f"movej({HOME})\nmovej({ASIDE})", start=False) == ["where it begins is not known", ""]
    # What may move the arm, and branches, leave it anywhere.
    found = whys(f"movej({ASIDE})\npick_up(3)\nmovej({HOME})\nmovej({ASIDE})")
    assert found == ["", "where it begins is not known", ""]
    found = whys(f"movej({ASIDE})\nif x:\n movej({HOME})\nend\nmovej({ASIDE})\nmovej({HOME})")
    assert found == ["", "", "where it begins is not known", ""]


def test_a_tool_that_is_set_again_is_known_again() -> None:
    text = f"pick(1)\nmovej({ASIDE})\nset_tcp(p[0,0,0,0,0,0])\nmovel(p[-0.65,-0.38,0.6,3.1,0,0])"
    assert whys(text) == ["where it begins is not known", ""]


def test_loops_begin_where_they_end() -> None:
    text = f"def main():\n movej({ASIDE})\n while True:\n  movej({HOME})\n  turn()\n end\nend\n"
    text += f"def turn():\n movej({ASIDE}, v=0.2)\nend"
    found = [visit for chain in chains(read_urscript(text.encode()), start=False) for visit in chain]
    assert [(visit.move.line, visit.why) for visit in found] == [(2, "where it begins is not known"), (4, ""), (9, "")]


ARC = {
    "URScript": b"movec(p[-0.75,-0.1,0.65,1,2,3], p[-0.7,0,0.7,3.1,0,0.2], a=2, v=0.2)",
    "KRL": b"$VEL.CP=0.2\nCIRC {X -750,Y -100,Z 650},{X -700,Y 0,Z 700,A %f,B %f,C %f}",
    "RAPID": b"PROC a()\n MoveC [[-750,-100,650],[1,0,0,0],[0,0,0,0],[9E9]],[[-700,0,700],[%f,%f,%f,%f],"
    b"[0,0,0,0],[9E9]],v200,fine,tool0;\nENDPROC",
}


def test_arcs_go_through_three_points_in_every_language() -> None:
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_rotvec((3.1, 0, 0.2))
    x, y, z, w = turn.as_quat()
    a, b, c = turn.as_euler("ZYX", degrees=True)
    texts = ARC["URScript"], ARC["KRL"] % (a, b, c), ARC["RAPID"] % (w, x, y, z)
    paths = []
    for text, read in zip(texts, (read_urscript, read_krl, read_rapid), strict=True):
        ((visit,),) = chains(read(text))
        assert visit.why == ""
        assert visit.leg is not None
        assert [slot.value for slot in visit.slots] == [200 if read is read_rapid else 0.2]
        paths.append(visit.leg.q)
    poses = cell().robot.pose(paths[0])
    place, via, end = poses[:, :3, 3], np.array([-0.75, -0.1, 0.65]), np.array([-0.7, 0, 0.7])
    begin = place[0]
    # As far from one point as from the other two, in their plane.
    normal = np.cross(via - begin, end - begin)
    equations = np.stack([via - begin, end - begin, normal])
    centre = np.linalg.solve(equations, [((p - begin) @ (p + begin)) / 2 for p in (via, end)] + [normal @ begin])
    radius = np.linalg.norm(begin - centre)
    assert np.abs(np.linalg.norm(place - centre, axis=1) - radius).max() < 1e-7
    assert np.abs((place - begin) @ normal).max() < 1e-8
    step = np.linalg.norm(np.diff(place, axis=0), axis=1)
    assert step.max() == pytest.approx(step.min(), rel=1e-5)
    nearest = np.linalg.norm(place - via, axis=1)
    assert nearest.min() <= step.max() / 2
    assert 0.2 < nearest.argmin() / len(place) < 0.8
    assert np.allclose(poses[-1], transform((*end, 3.1, 0, 0.2)), atol=1e-8)
    for other in paths[1:]:
        assert np.allclose(other, paths[0], atol=1e-5)


def test_arcs_that_cannot_be_followed() -> None:
    begin = cell().robot.pose(cell().start)[:3, 3]
    near, far = (", ".join(map(repr, (begin + np.array([0, 0, -d])).tolist())) for d in (0.05, 0.1))
    assert whys(f"movec(p[{near}, 3.1, 0, 0], p[{far}, 3.1, 0, 0])") == ["the three points of its arc lie on a line"]
    krl = b"$VEL.CP=0.2\nCIRC {X -750,Y -100,Z 650},{X -700,Y 0,Z 700,A 0,B 0,C 180},CA 90\n"
    ((visit,),) = chains(read_krl(krl))
    assert visit.why == "it is not understood"


def test_what_a_subprogram_may_set_is_not_known_after_it() -> None:
    move = b"LIN {X -690,Y -174,Z 600,A 0,B 0,C 180}\nPTP {A1 10,A2 -90,A3 90,A4 -90,A5 -90,A6 0}\n"
    ptp = b"PTP {A1 17,A2 -90,A3 90,A4 -90,A5 -90,A6 0}\n"
    known = [visit for chain in chains(read_krl(b"$VEL.CP=0.2\n$VEL_AXIS=10\n" + move)) for visit in chain]
    assert [visit.why for visit in known] == ["", ""]
    text = b"$VEL.CP=0.2\n$VEL_AXIS=10\nGRIP(1)\n" + ptp + move
    after = [visit for chain in chains(read_krl(text)) for visit in chain]
    assert {visit.why for visit in after} == {"its speed may be one of several"}
    text = b"GRIP(1)\n$VEL.CP=0.2\n$VEL_AXIS=10\n" + ptp + move
    after = [visit for chain in chains(read_krl(text)) for visit in chain]
    assert [visit.why for visit in after[:2]] == [
        "where it begins is not known",
        "the tool or frame of its target is not known",
    ]


def test_tools_and_rotations() -> None:
    turned = from_euler_zyx(30.0, -20.0, 50.0)
    a, b, c = (math.radians(x) for x in (30.0, -20.0, 50.0))
    Z = np.array([[math.cos(a), -math.sin(a), 0], [math.sin(a), math.cos(a), 0], [0, 0, 1]])
    Y = np.array([[math.cos(b), 0, math.sin(b)], [0, 1, 0], [-math.sin(b), 0, math.cos(b)]])
    X = np.array([[1, 0, 0], [0, math.cos(c), -math.sin(c)], [0, math.sin(c), math.cos(c)]])
    assert np.allclose(transform((0, 0, 0, *turned))[:3, :3], Z @ Y @ X, atol=1e-12)
    assert from_quaternion(0, 0, 0, 0) is None
    assert np.allclose(from_quaternion(-2, 0, 0, -2), (0, 0, math.pi / 2))  # type: ignore[arg-type]
    text = "set_tcp(p[0,0,0.1,0,0,0])\nmovel(p[-0.7,-0.17,0.6,3.1,0,0])"
    ((visit,),) = chains(read_urscript(text.encode()))
    assert visit.leg is not None
    assert np.allclose(cell().robot.pose(visit.leg.q[-1], point=(0, 0, 0.1))[:3, 3], (-0.7, -0.17, 0.6), atol=1e-8)


def test_a_script_that_polyscope_wrote_is_read() -> None:
    """Labels of its tree, set-up, and poses with the joints that they were recorded with."""
    q = np.array([0.3, -1.5, 1.5, -1.5, -1.5, 0.4])
    posed = cell().robot.pose(q)
    pose = [*posed[:3, 3], *Rotation.from_matrix(posed[:3, :3]).as_rotvec()]

    def script(near: str) -> str:
        return f"""def Program():
  set_standard_analog_input_domain(0, 1)
  set_tool_output_mode(0)
  thread Step_Counter():
    while (True):
      steps = steps + 1
      sync()
    end
  end
  run Step_Counter()
  set_tcp(p[0.0,0.0,0.0,0.0,0.0,0.0])
  global Waypoint_1_p=p{[round(float(x), 6) for x in pose]}
  global Waypoint_1_q={near}
  while (True):
    $ 1 "Robot Program"
    $ 2 "Waypoint_1" "breakAfter"
    movej(get_inverse_kin(Waypoint_1_p, qnear=Waypoint_1_q), a=1.4, v=1.05)
    movej([0.2, -1.57, 1.57, -1.57, -1.57, 0.0], a=1.4, v=1.05)
  end
end
"""

    read = read_urscript(script(str(q.round(4).tolist())).encode())
    first, back, again = (visit for chain in chains(read) for visit in chain)
    assert [line for line, _ in read.not_understood] == [4, 10]
    assert [visit.why for visit in (first, back, again)] == ["", "", ""]
    assert first.leg is not None
    assert np.allclose(first.leg.q[-1], q, atol=1e-4)
    assert np.allclose(first.leg.q[:, 1], np.linspace(first.leg.q[0, 1], first.leg.q[-1, 1], len(first.leg.q)))
    # Joints of another pose say nothing of the posture.
    (first,), *_ = chains(read_urscript(script("[0.6, -1.5, 1.5, -1.5, -1.5, 0.4]").encode()))
    assert first.why == "the posture that is written beside its target is not one of its pose"


def test_krl_settings_hold_until_the_next() -> None:
    source = (EXAMPLES / "place.src").read_bytes()
    found = [v for chain in chains(read_krl(source, (EXAMPLES / "place.dat").read_bytes())) for v in chain]
    assert [visit.move.word for visit in found] == ["PTP", "LIN", "LIN", "PTP"]
    assert [source[visit.slots[0].start : visit.slots[0].end] for visit in found] == [b"20", b"0.2", b"0.2", b"20"]
    assert found[0].leg is not None
    assert found[0].leg.q[-1][0] == pytest.approx(math.radians(17))
    # Without the data beside it HOME is not known.
    assert "target is not known" in chains(read_krl(source))[0][0].why


def test_krl_moves_without_a_speed_get_one() -> None:
    source = b"DEF a()\n  PTP {A1 10,A2 -90,A3 90,A4 -90,A5 -90,A6 0}\n"
    source += b"  LIN {X -690,Y -174,Z 500,A 0,B 0,C 180} C_DIS\nEND\n"
    read = read_krl(source)
    (ptp,), (lin,) = chains(read)
    assert ptp.slots[0].value is None
    assert lin.slots[0].edit(0.123456).text == "  $VEL.CP=0.1234\n"
    assert ptp.slots[0].edit(7.9).text.count("=7\n") == 6


@pytest.mark.parametrize(
    ("quotient", "known"), [("3/2", None), ("4/2", 2.0), ("-7/7*2", -2.0), ("2.5/2", 1.25), ("N/2", None)]
)
def test_krl_cuts_the_rest_off_a_quotient_of_integers(quotient: str, known: float | None) -> None:
    """Of a number that may be an integer or not the quotient is known where it is whole."""
    text = f"DEF a()\nDECL INT N=5\n$VEL_AXIS=20\nPTP {{A1 {quotient},A2 -85,A3 88,A4 -93,A5 -90,A6 0}}\nEND\n"
    ((visit,),) = chains(read_krl(text.encode()))
    assert (visit.leg is not None) == (known is not None)
    if visit.leg is not None and known is not None:
        assert math.degrees(visit.leg.q[-1, 0]) == pytest.approx(known)


def test_what_the_arm_carries_is_said_to_be_the_robots() -> None:
    said = "what the arm carries is set, and not followed: the load of the scenario's robot is judged"
    assert read_urscript(b"set_payload(5)\n").notes == (f"line 1: {said}",)
    assert read_krl(b"DEF a()\n$LOAD={M 5}\nEND\n").notes == (f"line 2: {said}",)
    move = b"MoveAbsJ [[17,-85,88,-93,-90,0],[9E9]],v100,fine,tool0\\TLoad:=l;\n"
    read = read_rapid(b"PROC a()\nGripLoad l;\n" + move + b"ENDPROC\n")
    assert read.notes == (f"line 2: {said}", f"line 3: {said}")


def test_a_stop_point_of_rapid_stays_one_with_another_size() -> None:
    own = "CONST zonedata own:=[TRUE,50,50,50,1,1,1];\n"
    for zone, blend in (("fine\\Z:=50", 0.0), ("own\\Z:=50", 0.0), ("z10\\Z:=50", 0.05), ("z10\\Z:=x", None)):
        text = f"{own}PROC a()\nMoveAbsJ [[17,-85,88,-93,-90,0],[9E9]],v100,{zone},tool0;\nENDPROC\n"
        ((visit,),) = chains(read_rapid(text.encode()))
        assert (visit.move.blend, bool(visit.why)) == (blend or 0.0, blend is None)


POSE = "X -600,Y -350,Z 550,A 0,B 0,C 180"  # the arm gets there at 16, -90, 103, -103, -90 and 106 degrees
OTHER = "the posture that is written beside its target is another one than the arm gets to"


@pytest.mark.parametrize(
    ("move", "why"),
    [
        (f"PTP {{{POSE}}}", ""),
        (f"PTP {{{POSE},S 2,T 26}}", ""),
        (f"PTP {{{POSE},S 2,T 27}}", OTHER),
        (f"PTP {{{POSE},S 'B010',T 'b011010'}}", ""),
        (f"PTP {{{POSE},S 'H2',T 'H1B'}}", OTHER),
        (f"PTP {{{POSE},S 2}}", "the posture that its S names is not known without T"),
        (f"LIN {{{POSE},S 2}}", ""),
        (f"LIN {{{POSE},S 2,T 27}}", ""),
        ("MoveJ [[-600,-350,550],[0,1,0,0],[0,-2,1,0],[9E9]],v20,fine,tool0;", ""),
        ("MoveJ [[-600,-350,550],[0,1,0,0],[0,-1,1,0],[9E9]],v20,fine,tool0;", OTHER),
        ("MoveL [[-600,-350,550],[0,1,0,0],[0,-1,1,0],[9E9]],v20,fine,tool0;", ""),
    ],
)
def test_a_joint_move_to_another_posture_is_not_judged(move: str, why: str) -> None:
    if move.startswith("Move"):
        start = "MoveAbsJ [[17,-85,88,-93,-90,0],[9E9]],v100,fine,tool0;\n"
        read = read_rapid(f"PROC a()\n{start}{move}\nENDPROC\n".encode())
    else:
        start = "$VEL.CP=0.2\n$VEL_AXIS=20\nPTP {A1 17,A2 -85,A3 88,A4 -93,A5 -90,A6 0}\n"
        read = read_krl(f"DEF a()\n{start}{move}\nEND\n".encode())
    assert [visit.why for chain in chains(read) for visit in chain] == ["", why]


def test_a_joint_move_that_a_nearer_posture_shortens_is_not_judged() -> None:
    """The tool turns by more than half a turn on the way, or the line there leads the arm round."""
    near = "the arm has a nearer posture for its target than on its line there"
    draw, told = np.random.default_rng(5), []
    for _ in range(20):
        q = cell().start + draw.uniform(-1.7, 1.7, 6)  # type: ignore[operator]
        pose = cell().robot.pose(q)
        x = [*pose[:3, 3].tolist(), *Rotation.from_matrix(pose[:3, :3]).as_rotvec().tolist()]
        ((visit,),) = chains(read_urscript(f"movej(p{x})\n".encode()))
        told.append(visit.why)
        if visit.leg is not None:
            # What is judged turns no further than the arm needs to.
            assert np.linalg.norm(visit.leg.q[-1] - visit.leg.q[0]) < np.linalg.norm(q - visit.leg.q[0]) + 2e-3
    assert near in told
    assert "" in told


def test_a_speed_that_nothing_said_is_written(tmp_path: Path) -> None:
    path = tmp_path / "a.src"
    path.write_bytes(b"DEF a()\r\n  LIN {X -690,Y -174,Z 600,A 0,B 0,C 180} ; down\r\nEND\r\n")
    source = read_source(path, cell(), 0.5)
    assert isinstance(source, TextProgram)
    (segment,) = source.segments
    assert not segment.speed_known
    assert source.written({}) == path.read_bytes()
    lines = source.written({segment: 1.0}).split(b"\r\n")
    assert lines[1:3] == [b"  $VEL.CP=0.5", b"  LIN {X -690,Y -174,Z 600,A 0,B 0,C 180} ; down"]


def test_rapid_speeds_and_zones() -> None:
    source = (EXAMPLES / "place.mod").read_bytes()
    every = [visit for chain in chains(read_rapid(source)) for visit in chain]
    assert [visit.slots[0].value for visit in every] == [100, 200, 40, 150, 50]
    assert [visit.move.blend for visit in every] == [0, 0.01, 0, 0, 0]
    assert [visit.slots[0].edit(12.3456).text for visit in every] == [
        *["\\V:=12.34"] * 3,
        *["12.34"] * 2,
    ]
    text = b"PROC a()\n MoveAbsJ [[17,-85,88,-93,-90,0],[9E9]],v100\\T:=4,fine,tool0;\n"
    read = read_rapid(text + b" MoveL [[-600,-350,550],[0,1,0,0],[0,0,0,0],[9E9]],v9\\T:=2,z10,tool0;\nENDPROC")
    (timed,), (blended,) = chains(read)
    assert (timed.slots[0].value, timed.slots[0].unit, timed.why) == (4, "s", "")
    assert "time T is given with a zone" in blended.why
    assert "line 2: its time says nothing of its ramps" in read.notes[0]
    assert every[2].leg is not None
    assert np.allclose(cell().robot.pose(every[2].leg.q[-1])[:3, 3], (-0.6, -0.35, 0.47), atol=1e-8)


def _written(path: Path, factors: float) -> tuple[bytes, bytes]:
    source = read_source(path, cell(), 1.0)
    assert isinstance(source, TextProgram)
    every: Mapping[Segment, float] = dict.fromkeys(source.segments, factors)
    return path.read_bytes(), source.written(every)


@pytest.mark.parametrize("name", ["place.script", "place.src", "place.mod"])
def test_only_speeds_change(name: str) -> None:
    before, same = _written(EXAMPLES / name, 1.0)
    assert same == before
    _, after = _written(EXAMPLES / name, 0.5)
    changed = [(a, b) for a, b in zip(before.split(b"\n"), after.split(b"\n"), strict=True) if a != b]
    assert changed
    for old, new in changed:
        # What is left of a line without its numbers is the same, but for the argument that was added.
        for added in (b"\\V:=", b", v="):
            if added in new and added not in old:
                new = new.replace(added, b"", 1)
        assert [part for part in new if part not in b"0123456789."] == [p for p in old if p not in b"0123456789."]


def test_data_of_a_krl_program_go_with_it(tmp_path: Path) -> None:
    """Without them nothing of what was written could be judged again."""
    for name in ("place.src", "place.DAT"):
        (tmp_path / name).write_bytes((EXAMPLES / name.lower()).read_bytes())
    scenario = bs.load_scenario(EXAMPLES / "cell.toml")
    result = evaluate_program(tmp_path / "place.src", scenario, faster=False)
    files = write_program(result, tmp_path / "place.src", tmp_path / "out")
    assert tmp_path / "out" / "place.DAT" in files
    assert (tmp_path / "out" / "place.DAT").read_bytes() == (EXAMPLES / "place.dat").read_bytes()
    assert evaluate_program(tmp_path / "out" / "place.src", scenario, faster=False).present == "PASS"
    result = evaluate_program(EXAMPLES / "place.mod", scenario, faster=False)
    files = write_program(result, EXAMPLES / "place.mod", tmp_path / "rapid")
    assert not [file for file in files if file.suffix.lower() == ".dat"]


def test_what_is_not_understood_is_named_by_line() -> None:
    read = read_urscript(b"movej([0,0,0,0,0,0])\nservoj(q, t=0.002)\nx = \nfor i in y\n")
    assert read.not_understood == ((2, "servoj(q, t=0.002)"), (4, "for i in y"))
    rapid = read_rapid(b"PROC a()\n  SearchL \\Stop, di1, p, p10, v100, tool0;\nENDPROC\nENDIF\n")
    assert [line for line, _ in rapid.not_understood] == [2, 4]
    krl = read_krl(b"DEF a()\n  SPTP P1\n  $OV_PRO=50\nEND\nEND\n")
    assert [line for line, _ in krl.not_understood] == [2, 3, 5]
