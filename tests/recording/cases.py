"""Small recordings and the real ones beside the repository."""

from __future__ import annotations

import os
import zipfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from bumpstop.recording import Recording

SHARED = Path(os.environ.get("BUMPSTOP_SHARED", Path(__file__).parents[2].parent / "shared")) / "data"
JOINTS = ("a", "b")


def real(name: str) -> Path:
    """A real recording, or the test is skipped."""
    path = SHARED / name
    if not path.exists():
        pytest.skip(f"{path} is not there (BUMPSTOP_SHARED names its folder)")
    return path


def recording(rows: int = 200, dt: float = 0.01, dof: int = 2) -> Recording:
    """Sines with everything measured."""
    t = dt * np.arange(rows)
    phase = t[:, None] + np.arange(dof)
    names = JOINTS if dof == 2 else tuple(f"j{i}" for i in range(dof))
    return Recording(
        t=t,
        q=np.sin(phase),
        qd=np.cos(phase),
        current=2 * np.sin(phase),
        tau=3 * np.cos(phase),
        wrench=np.tile(np.sin(t)[:, None], 6),
        q_ref=np.sin(phase + 0.01),
        joint_names=names,
        robot="arm",
    )


def lines(rows: int = 200) -> list[str]:
    """Headerless CSV: time, two positions, a text nobody wants."""
    return [f"{0.01 * i:.2f},{np.sin(0.01 * i):.9f},{np.cos(0.01 * i):.9f},ok" for i in range(rows)]


COLUMNS = {"time": {"column": 1}, "position": {"columns": [2, 3]}}


def written(folder: Path, text: list[str]) -> Path:
    """A CSV file of these lines."""
    path = folder / "run.csv"
    path.write_text("\n".join(text) + "\n", encoding="utf-8")
    return path


_OFFICE = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
_PACKAGE = "http://schemas.openxmlformats.org/package/2006"
_SHEETS = "http://schemas.openxmlformats.org/spreadsheetml/2006/main"
_PARTS = {
    "[Content_Types].xml": f'<Types xmlns="{_PACKAGE}/content-types">'
    '<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>'
    '<Default Extension="xml" ContentType="application/xml"/></Types>',
    "_rels/.rels": f'<Relationships xmlns="{_PACKAGE}/relationships">'
    f'<Relationship Id="r1" Type="{_OFFICE}/officeDocument" Target="xl/workbook.xml"/></Relationships>',
    "xl/workbook.xml": f'<workbook xmlns="{_SHEETS}" xmlns:r="{_OFFICE}">'
    '<sheets><sheet name="run" sheetId="1" r:id="r1"/></sheets></workbook>',
    "xl/_rels/workbook.xml.rels": f'<Relationships xmlns="{_PACKAGE}/relationships">'
    f'<Relationship Id="r1" Type="{_OFFICE}/worksheet" Target="worksheets/sheet1.xml"/></Relationships>',
}


def workbook(path: Path, rows: Sequence[Sequence[str | float | None]]) -> Path:
    """An Excel file of one sheet, as little as the format needs."""
    sheet = ""
    for i, row in enumerate(rows):
        cells = ""
        for place, value in zip("ABCDEFGH", row, strict=False):
            if value is None:
                continue
            text = f't="inlineStr"><is><t>{value}</t></is>' if isinstance(value, str) else f"><v>{value!r}</v>"
            cells += f'<c r="{place}{i + 1}" {text}</c>'
        sheet += f'<row r="{i + 1}">{cells}</row>'
    with zipfile.ZipFile(path, "w") as file:
        for name, text in _PARTS.items():
            file.writestr(name, text)
        file.writestr(
            "xl/worksheets/sheet1.xml", f'<worksheet xmlns="{_SHEETS}"><sheetData>{sheet}</sheetData></worksheet>'
        )
    return path
