"""Who may look at a page, and what is opened."""

from __future__ import annotations

import asyncio
import http.client
import signal
import socket
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import polars as pl
import pytest

import bumpstop as bs
from bumpstop.cli.main import main
from bumpstop.study import WorkspaceStudy
from bumpstop.view.document import scenario_text
from bumpstop.view.opened import open_source
from bumpstop.view.page import server as server_module
from bumpstop.view.page.server import ViewServer, free_port, is_loopback, may_connect, wake_in_its_loop
from bumpstop.view.point_rows import point_rows
from view.cases import LOWER_ARM, urdf_of_twelve_joints

KEY = {"Upgrade": "websocket", "Connection": "Upgrade", "Sec-WebSocket-Key": "x3JJHMbDL1EzLkh9GBhXDw=="}


@pytest.mark.parametrize(
    ("headers", "upgrade", "allowed"),
    [
        ({"host": "127.0.0.1:8642"}, False, True),
        ({"host": "localhost:8642", "origin": "http://localhost:8642"}, True, True),
        ({"host": "[::1]:8642", "origin": "http://[::1]:8642"}, True, True),
        ({"host": "127.0.0.1:8642", "origin": "http://evil.example"}, True, False),
        ({"host": "127.0.0.1:8642", "origin": "http://127.0.0.1:9999"}, True, False),
        ({"host": "127.0.0.1:8642", "origin": "null"}, True, False),
        ({"host": "127.0.0.1:8642"}, True, False),
        ({"host": "evil.example:8642", "origin": "http://evil.example:8642"}, True, False),
        ({"host": "evil.example:8642"}, False, False),
        ({}, False, False),
    ],
)
def test_only_own_pages_may_connect(headers: dict[str, str], upgrade: bool, allowed: bool) -> None:
    assert may_connect(headers, "127.0.0.1", upgrade=upgrade) is allowed


@pytest.mark.parametrize(
    ("host", "called", "allowed"),
    [
        # A name that was bound to an address of this machine.
        ("0.0.0.0", "evil.example", False),
        ("0.0.0.0", "arm.evil.example", False),
        ("0.0.0.0", "", False),
        ("0.0.0.0", "Arm", True),
        ("0.0.0.0", "arm.cell.example", True),
        ("0.0.0.0", "arm.local", True),
        ("0.0.0.0", "localhost", True),
        ("0.0.0.0", "192.168.1.7", True),
        ("0.0.0.0", "[fe80::1]", True),
        ("robot.cell.example", "robot.cell.example", True),
        ("robot.cell.example", "evil.example", False),
        # The address that the command prints.
        ("127.0.0.2", "127.0.0.2", True),
        ("127.0.0.2", "localhost", True),
        ("127.0.0.2", "192.168.1.7", False),
        ("127.0.0.1", "127.evil.example", False),
        ("::1", "[::1]", True),
    ],
)
def test_other_hosts_keep_to_their_own_pages(
    host: str, called: str, allowed: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(socket, "gethostname", lambda: "arm")
    monkeypatch.setattr(socket, "getfqdn", lambda: "arm.cell.example")
    server_module._own_names.cache_clear()
    own = f"{called}:8642"
    assert may_connect({"host": own, "origin": f"http://{own}"}, host, upgrade=True) is allowed
    assert may_connect({"host": own}, host, upgrade=False) is allowed
    assert not may_connect({"host": own, "origin": "http://evil.example"}, host, upgrade=True)
    server_module._own_names.cache_clear()


def test_what_is_loopback() -> None:
    assert is_loopback("127.0.0.1")
    assert is_loopback("127.0.0.2")
    assert is_loopback("localhost")
    assert not is_loopback("0.0.0.0")
    assert not is_loopback("127.evil.example")


def test_foreign_origins_are_refused_by_the_server() -> None:
    server = ViewServer(open_source(str(LOWER_ARM)))
    try:
        host, port = server.url.removeprefix("http://").split(":")
        assert host == "127.0.0.1"

        def status(headers: dict[str, str]) -> int:
            connection = http.client.HTTPConnection(host, int(port), timeout=10)
            connection.request("GET", "/", headers=headers)
            found = connection.getresponse().status
            connection.close()
            return found

        own = f"http://{host}:{port}"
        assert status({}) == 200
        assert status(KEY | {"origin": "http://evil.example", "Sec-WebSocket-Version": "13"}) == 403
        assert status(KEY | {"origin": own, "Sec-WebSocket-Version": "13"}) == 101
        assert status({"host": "evil.example"}) == 403
    finally:
        server.stop()


@pytest.mark.parametrize("name", bs.robots())
def test_every_robot_has_a_page_to_start_from(name: str) -> None:
    opened = open_source(name)
    assert opened.robot.name == name
    assert 0 < bs.evaluate(opened.scenario).peak_force.quantile(0.5) < np.inf
    assert opened.notes


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"pose_deg": [0.0, 30.0]}, "pose_deg: has 2 values"),
        ({"contact.limits": "gone.toml"}, "contact.limits: .*gone.toml' cannot be read"),
    ],
)
def test_a_scenario_without_controls_is_refused(changes: dict[str, object], message: str, tmp_path: Path) -> None:
    """Its page was blank."""
    file = tmp_path / "scenario.toml"
    file.write_text(scenario_text(bs.load_scenario(LOWER_ARM, changes)), encoding="utf-8")
    with pytest.raises(bs.InputError, match=message):
        open_source(str(file))


def test_a_urdf_of_twelve_joints(tmp_path: Path) -> None:
    file = tmp_path / "snake.urdf"
    file.write_text(urdf_of_twelve_joints(), encoding="utf-8")
    opened = open_source(str(file))
    assert opened.robot.dof == 12
    assert opened.scenario.assumed[0] == "pose_rad", "what was made up is told wherever the scenario goes"
    assert 0 < bs.evaluate(opened.scenario).peak_force.quantile(0.5) < np.inf


def test_meshes_of_a_urdf_stand_where_its_links_are(tmp_path: Path) -> None:
    """A box beside the third link; what cannot be read is told, and drawn from the kinematics."""
    import trimesh

    trimesh.creation.box((0.1, 0.2, 0.3)).export(tmp_path / "box.stl")
    (tmp_path / "bad.stl").write_bytes(b"no mesh")
    visual = (
        '<visual><origin xyz="1 0 0" rpy="0 0 1.5707963267948966"/><geometry><mesh filename="{}"/></geometry></visual>'
    )
    text = urdf_of_twelve_joints()
    text = text.replace('<link name="l2"/>', f'<link name="l2">{visual.format("box.stl")}</link>')
    text = text.replace('<link name="l4"/>', f'<link name="l4">{visual.format("bad.stl")}</link>')
    file = tmp_path / "snake.urdf"
    file.write_text(text, encoding="utf-8")
    opened = open_source(str(file))
    shapes = {shape.link: shape for shape in opened.shapes}
    assert len(shapes) == 13
    box = shapes[2].vertices
    assert np.ptp(box, axis=0) == pytest.approx([0.2, 0.1, 0.3])
    assert box.mean(axis=0) == pytest.approx([1.0, 0.0, 0.0])
    assert shapes[4].vertices.shape == shapes[6].vertices.shape
    assert [note for note in opened.notes if "bad.stl" in note]


@pytest.mark.parametrize(
    ("origin", "scale", "words"),
    [
        ("", "1 1", "has scale '1 1', which is not three numbers"),
        ("", "a b c", "has scale 'a b c', which is not three numbers"),
        ("", "nan 1 1", "has scale 'nan 1 1', which is not three numbers"),
        ('<origin rpy="0.3 0.2"/>', "1 1 1", "has rpy '0.3 0.2', which is not three numbers"),
        ('<origin xyz="0 0"/>', "1 1 1", "has xyz '0 0', which is not three numbers"),
    ],
)
def test_a_mesh_that_cannot_be_placed_is_told(origin: str, scale: str, words: str, tmp_path: Path) -> None:
    """It was an internal fault, or vertices that are no numbers."""
    opened = open_source(str(urdf_with_box(tmp_path, [(origin, "box.stl", scale)])))
    assert opened.notes[-1] == f"The mesh box.stl of link l2 {words}: the link is drawn from the kinematics."
    shapes = {shape.link: shape for shape in opened.shapes}
    assert shapes[2].vertices.shape == shapes[6].vertices.shape


def test_a_mesh_beside_another_is_left_out(tmp_path: Path) -> None:
    """The link was said to be drawn from the kinematics, and had the other mesh alone."""
    opened = open_source(str(urdf_with_box(tmp_path, [("", "gone.stl", "1 1 1"), ("", "box.stl", "1 1 1")])))
    assert opened.notes[-1] == "The mesh gone.stl of link l2 is not there: this mesh is left out."


@pytest.mark.parametrize("scale", ["1 1 1", "-1 1 1", "-1 -1 1", "-1 -1 -2"])
def test_the_faces_of_a_mirrored_mesh_look_outwards(scale: str, tmp_path: Path) -> None:
    import trimesh

    opened = open_source(str(urdf_with_box(tmp_path, [("", "box.stl", scale)])))
    (box,) = (shape for shape in opened.shapes if shape.link == 2)
    assert trimesh.Trimesh(box.vertices, box.faces, process=False).volume > 0.005


def urdf_with_box(folder: Path, visuals: list[tuple[str, str, str]]) -> Path:
    """A URDF whose third link has meshes: origin, file and scale of each. One file is there, of a box."""
    import trimesh

    trimesh.creation.box((0.1, 0.2, 0.3)).export(folder / "box.stl")
    link = "".join(
        f'<visual>{origin}<geometry><mesh filename="{name}" scale="{scale}"/></geometry></visual>'
        for origin, name, scale in visuals
    )
    file = folder / "snake.urdf"
    text = urdf_of_twelve_joints().replace('<link name="l2"/>', f'<link name="l2">{link}</link>')
    file.write_text(text, encoding="utf-8")
    return file


def test_a_study_opens_with_its_rows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scenario = bs.load_scenario(LOWER_ARM)
    study = WorkspaceStudy(scenario=scenario, poses=40)
    rows = study.shard(0)
    rows.write_parquet(tmp_path / "rows.parquet")
    (tmp_path / "settings.toml").write_text(scenario_text(scenario), encoding="utf-8")
    for source in (tmp_path, tmp_path / "rows.parquet"):
        points = open_source(str(source)).points
        assert points is not None
        assert points.value == pytest.approx(rows["p99_N"].to_numpy())
        assert opened_place(points.q[3]) == pytest.approx(points.place[3])
    # Computed on the page they are the same, without a package for tables, which has 50 MB.
    with monkeypatch.context() as without:
        without.setitem(sys.modules, "polars", None)
        computed = point_rows(study.shard_columns(0), 7, "workspace")
    for name in ("place", "q", "velocity", "value"):
        assert (getattr(points, name) == getattr(computed, name)).all()
    pl.DataFrame({"x": [1.0]}).write_parquet(tmp_path / "rows.parquet")
    with pytest.raises(bs.InputError, match="has no column q_1"):
        open_source(str(tmp_path))


def test_rows_that_ignore_limits_say_so(tmp_path: Path) -> None:
    """They were shown as if they were of the scenario on screen, whose joints keep to their limits."""
    scenario = bs.load_scenario(LOWER_ARM)
    study = WorkspaceStudy(scenario=scenario, poses=12, joint_limits="ignore", velocity_limits="ignore")
    study.shard(0).write_parquet(tmp_path / "rows.parquet")
    for ignored, words in (
        ("", ""),
        ('joint_limits = "ignore"', "computed with joint limits ignored"),
        (
            'joint_limits = "ignore"\nvelocity_limits = "ignore"',
            "computed with joint limits and joint velocity limits ignored",
        ),
        ('joint_limits = "respect"\nvelocity_limits = "ignore"', "computed with joint velocity limits ignored"),
    ):
        made_by = f'[made_by]\nstudy = "workspace"\n{ignored}\n'
        (tmp_path / "settings.toml").write_text(f"{scenario_text(scenario)}\n{made_by}", encoding="utf-8")
        opened = open_source(str(tmp_path))
        assert opened.points is not None
        assert opened.points.otherwise == opened.points.slice(0, 0.0).otherwise == words
        assert [words in note for note in opened.notes] == ([True] if words else [])


def opened_place(q: np.ndarray) -> np.ndarray:
    return bs.Robot.load("sia5d").pose(q)[:3, 3]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nobody"], "cannot be opened"),
        (["ur10ee"], "did you mean"),
        (["ur10e", "--port", "70000"], "--port"),
        (
            ["ur10e", "--host", "nosuch.invalid"],
            "--host: 'nosuch.invalid' is not known to this machine; wanted an address",
        ),
        (["ur10e", "--host", "8.8.8.8"], "--host: '8.8.8.8' is no address of this machine; wanted an address"),
        (["ur10e", "--record", "/dev/null"], "--record: '/dev/null' cannot be written (Not a directory)"),
        (["ur10e", "--robot", "ur10e"], "has no meaning without a recording"),
        (["absent.parquet", "--robot", "ur10e"], "absent.parquet: there is no such file"),
        (["absent.parquet", "--thresholds", "40,40,40,20,20,20"], "absent.parquet: there is no such file"),
        (["ur10e", "--model", "m.toml"], "has no meaning without --thresholds"),
        (["absent.toml"], "absent.toml"),
    ],
)
def test_refusals(arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["view", *arguments, "--no-browser"])
    assert ended.value.code == 2
    assert message in capsys.readouterr().err.splitlines()[-1]


def test_a_taken_port_has_another_in_its_place_but_for_the_last() -> None:
    """viser went on to 65536 in a thread of its own, and the command waited for it for ever."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen(1)
        port = taken.getsockname()[1]
        assert port < free_port("127.0.0.1", port) < port + 100
    with socket.socket() as last:
        last.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        last.bind(("127.0.0.1", 65_535))
        last.listen(1)
        with pytest.raises(bs.InputError, match=r"^--port: 65535 and the ports after it are taken; wanted one that is"):
            ViewServer(open_source("ur10e"), port=65_535)
    assert free_port("127.0.0.1", 65_535) == 65_535
    assert free_port("localhost", 0) == 0


def test_what_is_drawn_wakes_the_sender_in_its_own_thread() -> None:
    """An event of asyncio that another thread sets may raise there: plots were lost."""
    from viser._messages import RemoveSceneNodeMessage
    from viser.infra._async_message_buffer import AsyncMessageBuffer

    loop = asyncio.new_event_loop()
    buffer = AsyncMessageBuffer(loop, persistent_messages=False)
    wake_in_its_loop(SimpleNamespace(_websock_connection=SimpleNamespace(get_message_buffer=lambda: buffer)))
    drawing = threading.Thread(target=buffer.push, args=(RemoveSceneNodeMessage("/way"),))
    drawing.start()
    drawing.join()
    assert not buffer.message_event.is_set()
    # In a thread of its own: that of the tests may have the loop of a browser.
    with ThreadPoolExecutor(1) as sender:
        sender.submit(loop.run_until_complete, asyncio.wait_for(buffer.message_event.wait(), 10.0)).result()
    loop.close()


def test_without_viser(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setitem(__import__("sys").modules, "viser", None)
    with pytest.raises(SystemExit) as ended:
        main(["view", "ur10e", "--no-browser"])
    assert ended.value.code == 2
    assert "pip install 'bumpstop[view]'" in capsys.readouterr().err


def test_pictures_without_a_browser(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["view", str(LOWER_ARM), "--record", str(tmp_path / "out")])
    assert ended.value.code == 0
    from PIL import Image

    with Image.open(tmp_path / "out" / "view.gif") as moving:
        assert moving.n_frames > 10
        # The distribution stands in every frame: its area, in the right half.
        for frame in (0, moving.n_frames // 2):
            moving.seek(frame)
            right = np.asarray(moving.convert("RGB"), dtype=int)[100:, moving.width // 2 :]
            assert (abs(right - (179, 221, 245)).max(axis=2) < 30).sum() > 300
    with Image.open(tmp_path / "out" / "view.png") as still:
        assert still.width == 900
        # The colour of the verdict stands in the corner.
        assert still.convert("RGB").getpixel((16, 30)) == (213, 94, 0)


@pytest.mark.parametrize(("host", "warned"), [("0.0.0.0", True), ("127.0.0.1", False)])
def test_a_host_that_lets_others_in_is_warned_of(
    host: str, warned: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def ended(*_: object) -> bool:
        raise KeyboardInterrupt

    server = SimpleNamespace(url="http://here", stop=lambda: None)
    monkeypatch.setattr("bumpstop.view.page.server.ViewServer", lambda *_, **__: server)
    monkeypatch.setattr("bumpstop.view.freed_memory.return_freed_memory", lambda: None)
    monkeypatch.setattr(threading.Event, "wait", ended)
    with pytest.raises(SystemExit):
        main(["view", str(LOWER_ARM), "--host", host, "--no-browser"])
    assert ("whoever reaches it can read and change these pages" in capsys.readouterr().err) is warned


def test_ctrl_c_closes_the_page() -> None:
    code = "from bumpstop.cli.main import main; main()"
    command = [sys.executable, "-c", code, "view", "ur10e", "--port", "0", "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as run:
        assert run.stdout is not None
        assert run.stdout.readline().startswith("the page: http://127.0.0.1:")
        run.send_signal(signal.SIGINT)
        out, err = run.communicate(timeout=60)
    assert (run.returncode, out) == (0, "the page is closed\n")
    assert "error" not in err
