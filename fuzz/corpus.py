"""The files that mutations begin from. All are written here, by the library or by hand; none is anybody's recording."""

from __future__ import annotations

import io
import json
import re
import tempfile
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
Files = dict[str, bytes]


def _saved(save: Callable[[Path], Any], name: str) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        save(path)
        if path.is_dir():
            (path,) = path.glob("*.db3")
        return path.read_bytes()


def _from_page(page: str) -> str:
    """The first TOML file of a page of the documentation."""
    found = re.findall(r"^```toml\n(.*?)^```$", (ROOT / "docs" / page).read_text(encoding="utf-8"), re.M | re.S)
    return str(found[0])


def _recording() -> Any:
    import bumpstop as bs

    t = 0.01 * np.arange(60, dtype=np.float64)
    phase = t[:, None] + np.arange(2)
    return bs.Recording(t=t, q=np.sin(phase), qd=np.cos(phase), current=2 * np.sin(phase), joint_names=("a", "b"))


def campaigns() -> Files:
    """Of the examples, with its scenarios in it, as the settings of a folder have them."""
    from bumpstop.campaign import load_campaign
    from bumpstop.text_files import to_toml

    campaign = load_campaign(ROOT / "examples/campaign/two_arms.toml")
    return {"campaign.toml": to_toml(campaign.document()[1]).encode()}


def urdfs() -> Files:
    """A built-in robot as URDF, and one by hand with what others lack."""
    import bumpstop as bs
    from bumpstop.model.urdf.writer import write_urdf

    by_hand = (
        '<?xml version="1.0"?><robot name="r"><link name="l0"/>'
        '<link name="l1"><inertial><mass value="1"/><origin xyz="0 0 1" rpy="0 0 0"/><inertia ixx="1" iyy="1" izz="1" '
        'ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="j" type="revolute"><parent link="l0"/>'
        '<child link="l1"/><axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" effort="9"/></joint></robot>'
    )
    return {
        "arm.urdf": _saved(lambda path: write_urdf(bs.Robot.load("ur5e"), path), "arm.urdf"),
        "hand.urdf": by_hand.encode(),
    }


def drive_trains() -> Files:
    """Of the page on drive trains, and a model for MuJoCo with the same joints."""
    toml = _from_page("reference/robot/drive_train.md")
    joints = "".join(f'<body childclass="b"><joint name="{name}" class="a"/>' for name in tomllib.loads(toml)["joints"])
    defaults = '<default><default class="a"><joint armature="0.1"/></default></default>'
    model = f"<mujoco>{defaults}<worldbody>{joints}{'</body>' * joints.count('<body')}</worldbody></mujoco>"
    return {"drive.toml": toml.encode(), "drive.xml": model.encode()}


def limit_tables() -> Files:
    """The built-in ones under another name: theirs are taken."""
    folder = ROOT / "src/bumpstop/contact/data"
    return {
        f"my_{path.name}": path.read_text(encoding="utf-8")
        .replace(f'name = "{path.stem}"', 'name = "mine"', 1)
        .encode()
        for path in sorted(folder.glob("*.toml"))
    }


def registers() -> Files:
    """Two rows of the example, with their scenario beside them."""
    text = (ROOT / "examples/register/sia5d_downward.csv").read_text(encoding="utf-8")
    scenarios = {path.name: path.read_bytes() for path in sorted(ROOT.glob("examples/01*.toml"))}
    rows = text.replace("../", "").splitlines(keepends=True)[:3]
    return {"cell.csv": "".join(rows).encode(), **scenarios}


def dynamics() -> Files:
    """One parameter of a built-in robot."""
    text = """kind = "dynamics"
robot = "sia5d"
couplings = []
sign_speed = [0.01, 0.01, 0.01, 0.01, 0.01, 0.01, 0.01]
presliding = [0.01, 0.0, 0.03, 0.0, 0.0, 0.0, 0.0]
cutoff_hz = 10.0
rows_used = 1000
[[parameter]]
column = "m_1"
name = "joint 1 coulomb"
value = 2.0
standard_error = 0.1
"""
    return {"fit.toml": text.encode()}


def thresholds() -> Files:
    """Of the page on detection, as TOML and as JSON."""
    values = {
        "thresholds_Nm": [20, 10, 20, 20, 20, 20, None],
        "per_speed_Nm_s": [1, 1, 1, 1, 1, 1, 1],
        "period_s": 0.004,
    }
    return {"t.toml": _from_page("reference/robot/detection.md").encode(), "t.json": json.dumps(values).encode()}


def labels() -> Files:
    """Two contacts, by the column names of the page."""
    return {"labels.csv": b"start_s,end_s,kind\n1.0,1.5,hand\n3.0,3.25,arm\n"}


def column_files() -> Files:
    """Of the page on recordings, and one for a MATLAB file."""
    return {"columns.toml": _from_page("reference/robot/recording.md").encode(), "mat.toml": _MATLAB_COLUMNS}


_MATLAB_COLUMNS = b'time = { variable = "t", unit = "s" }\nposition = { variable = "rec.q", unit = "rad" }\n'


def recordings_csv() -> Files:
    """With names and without, with points and with commas."""
    rows = [(0.01 * i, np.sin(0.01 * i), np.cos(0.01 * i)) for i in range(20)]
    named = "t,q_1,q_2\n" + "".join(f"{t:.2f},{a:.9f},{b:.9f}\n" for t, a, b in rows)
    return {
        "named.csv": named.encode(),
        "comma.csv": named.replace(",", ";").replace(".", ",").encode(),
        "tab.tsv": named.replace(",", "\t").encode(),
    }


def recordings_parquet() -> Files:
    """As the library writes it."""
    return {"r.parquet": _saved(_recording().save, "r.parquet")}


def recordings_mcap() -> Files:
    """As the library writes it."""
    return {"r.mcap": _saved(_recording().save, "r.mcap")}


def recordings_db3() -> Files:
    """The same messages as a bag of SQLite."""
    from rosbags.rosbag2 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    types, made = store.types, _recording()
    header, stamp = types["std_msgs/msg/Header"], types["builtin_interfaces/msg/Time"]
    state = types["sensor_msgs/msg/JointState"]

    def write(path: Path) -> None:
        with Writer(path, version=9) as writer:
            topic = writer.add_connection("/joint_states", state.__msgtype__, typestore=store)
            for i, t in enumerate(made.t):
                ns = round(t * 1e9)
                head = header(stamp=stamp(sec=ns // 10**9, nanosec=ns % 10**9), frame_id="")
                message = state(
                    header=head, name=["a", "b"], position=made.q[i], velocity=made.qd[i], effort=made.current[i]
                )
                writer.write(topic, ns, store.serialize_cdr(message, state.__msgtype__))

    return {"r.db3": _saved(write, "bag")}


def recordings_excel() -> Files:
    """A sheet of numbers, packed without compression so that mutations meet its cells."""
    import zipfile

    rows = "".join(
        f'<row r="{i + 2}"><c r="A{i + 2}"><v>{0.01 * i}</v></c><c r="B{i + 2}"><v>{np.sin(i)}</v></c></row>'
        for i in range(30)
    )
    head = (
        '<row r="1"><c r="A1" t="inlineStr"><is><t>t</t></is></c><c r="B1" t="inlineStr"><is><t>q_1</t></is></c></row>'
    )
    main = "http://schemas.openxmlformats.org/spreadsheetml/2006/main"
    office = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
    package = "http://schemas.openxmlformats.org/package/2006"
    parts = {
        "[Content_Types].xml": f'<Types xmlns="{package}/content-types"><Default Extension="xml" '
        'ContentType="application/xml"/></Types>',
        "_rels/.rels": f'<Relationships xmlns="{package}/relationships"><Relationship Id="r1" '
        f'Type="{office}/officeDocument" Target="xl/workbook.xml"/></Relationships>',
        "xl/workbook.xml": f'<workbook xmlns="{main}" xmlns:r="{office}"><sheets>'
        '<sheet name="s" sheetId="1" r:id="r1"/>'
        "</sheets></workbook>",
        "xl/_rels/workbook.xml.rels": f'<Relationships xmlns="{package}/relationships"><Relationship Id="r1" '
        f'Type="{office}/worksheet" Target="worksheets/sheet1.xml"/></Relationships>',
        "xl/worksheets/sheet1.xml": f'<worksheet xmlns="{main}"><sheetData>{head}{rows}</sheetData></worksheet>',
    }
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        for name, text in parts.items():
            archive.writestr(name, text)
    return {"r.xlsx": file.getvalue()}


def recordings_matlab() -> Files:
    """A structure of matrices, compressed and not; its column file is columns.toml."""
    import scipy.io

    made = _recording()
    found: Files = {"columns.toml": _MATLAB_COLUMNS}
    for name, compressed in (("r.mat", False), ("packed.mat", True)):
        file = io.BytesIO()
        scipy.io.savemat(file, {"t": made.t, "rec": {"q": made.q, "text": "abc"}}, do_compression=compressed)
        found[name] = file.getvalue()
    return found


def residuals() -> Files:
    """As the library writes them."""
    from bumpstop.detection.tuning.residual_record import write_residuals

    rows = np.random.default_rng(0).normal(size=(120, 3))
    return {"r.parquet": _saved(lambda path: write_residuals(path, 0.004 * np.arange(120.0), rows), "r.parquet")}


def trajectories() -> Files:
    """JointTrajectory as JSON and as YAML."""
    points = [
        {"positions": [0.1 * i] * 7, "velocities": [0.1] * 7, "time_from_start": {"sec": i, "nanosec": 0}}
        for i in range(5)
    ]
    import bumpstop as bs

    names = [joint.name for joint in bs.Robot.load("sia5d").joints]
    text = json.dumps({"joint_names": names, "points": points})
    yaml = (
        "joint_names: &n [" + ", ".join(names) + "]\npoints:\n" + "".join(f"- {json.dumps(each)}\n" for each in points)
    )
    return {"t.json": text.encode(), "t.yaml": yaml.encode()}


def gauge_curves() -> Files:
    """The example with every twentieth of its rows: what is tried a million times is short."""
    lines = (ROOT / "examples/measure/hand.csv").read_text(encoding="utf-8").splitlines(keepends=True)
    first = next(i for i, line in enumerate(lines) if line[0].isdigit())
    return {"hand.csv": "".join(lines[:first] + lines[first::20]).encode()}


def cpp_texts() -> Files:
    """A robot and two detectors as C++ reads them: one of currents, one with fitted dynamics."""
    import bumpstop as bs
    from bumpstop.detection import Detector, DetectorSettings, Thresholds, describe_detector
    from bumpstop.identification import DynamicsModel
    from bumpstop.identification.dynamics.regressor_columns import column_names
    from bumpstop.joint import JointTorqueModel
    from bumpstop.model import describe

    thresholds = Thresholds(np.array([20, 10, 20, 20, 20, 20, np.inf]), fast=np.array([9.0] * 6 + [np.inf]))
    sia5d, ur5e = bs.Robot.load("sia5d"), bs.Robot.load("ur5e")
    settings = DetectorSettings(period_s=0.004, payload_kg=1.5)
    of_currents = Detector(sia5d, JointTorqueModel.load("sia5d"), thresholds, settings)
    couplings, top_speed, loaded = (((4, 1.0), (5, -0.7)),), np.array([2.0, *[np.nan] * 6]), (1, 4)
    names = column_names(ur5e, couplings, top_speed, loaded)
    model = DynamicsModel(
        robot=ur5e,
        columns=tuple(range(len(names))),
        values=np.linspace(0.01, 0.09, len(names)),
        sign_speed=np.full(6, 0.05),
        top_speed=top_speed,
        couplings=couplings,
        loaded=loaded,
        cutoff_hz=10.0,
    )
    fitted = Detector(ur5e, model, np.full(6, 10.0), DetectorSettings(period_s=0.004))
    return {
        "arm.robot": describe(sia5d).encode(),
        "currents.detector": describe_detector(of_currents).encode(),
        "fitted.detector": describe_detector(fitted).encode(),
    }
