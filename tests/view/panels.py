"""A page as its panels know it, without a browser."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from bumpstop.collision import Scenario
from bumpstop.collision.scenario.scenario_file import robot_of
from bumpstop.view.document import ViewDocument
from bumpstop.view.page.pose_keys import pose_values
from bumpstop.view.point_rows import PointRows
from bumpstop.view.program_segments import ProgramSegments


class Gui:
    """Inputs of a panel, whose values tests set and read."""

    def add_folder(self, *_: Any, **__: Any) -> Gui:
        return self

    def __enter__(self) -> None: ...

    def __exit__(self, *_: object) -> None: ...

    def __getattr__(self, name: str) -> Any:
        return self._number if name == "add_slider" else self._made

    def _number(self, _: str, low: float, high: float, step: float, value: float, **__: Any) -> Any:
        return _input(value)

    def _made(self, *_: Any, initial_value: str = "all points", **__: Any) -> Any:
        return _input(initial_value)


def _input(value: Any) -> Any:
    def nothing(_: Any) -> None: ...

    return SimpleNamespace(value=value, on_click=nothing, on_update=nothing, disabled=False, content="")


class Host:
    """A page that has a document, and nothing to see.

    Attributes:
        document: on screen.
        drawn: names of what panels have drawn into the picture.
    """

    answer = None

    def __init__(
        self, scenario: Scenario, points: PointRows | None = None, program: ProgramSegments | None = None
    ) -> None:
        self.document = ViewDocument(scenario)
        self.drawn: list[str] = []
        drawing: Any = SimpleNamespace(
            add_point_cloud=lambda name, *_, **__: self.drawn.append(name),
            remove_by_name=lambda name: self.drawn.remove(name) if name in self.drawn else None,
            on_click=lambda: lambda _: None,
        )
        self.client: Any = SimpleNamespace(gui=Gui(), scene=drawing)
        self.scene = SimpleNamespace(arm_is_hit=lambda *_: False, pose=lambda _: None)
        self.opened: Any = SimpleNamespace(
            robot=robot_of(scenario), points=points, scenario=scenario, program=program, recorded=None, folder=Path()
        )

    def set_pose(self, q: np.ndarray, velocity: np.ndarray | None = None) -> None:
        key, values = pose_values(self.opened, self.document.scenario, q)
        moved = {} if velocity is None else {"motion.velocity_mm_s": (1e3 * velocity).tolist()}
        self.change({key: values} | moved)

    def change(self, changes: Mapping[str, Any], key: str = "") -> None:
        self.document = self.document.edit(changes)


class Place:
    """A piece of a page, which counts what is sent."""

    def __init__(self, content: str) -> None:
        self.__dict__.update(content=content, sent=[])

    def __setattr__(self, name: str, value: Any) -> None:
        self.__dict__[name] = value
        self.sent.append(value)


class Client:
    """A browser without a page."""

    def __init__(self) -> None:
        self.places: list[Place] = []
        self.flushed = 0
        self.gui = self.scene = self

    def add_panel(self) -> Client:
        return self

    def add_tab(self, _: str) -> Any:
        return nullcontext()

    def atomic(self) -> Any:
        return nullcontext()

    def dock_right(self) -> None: ...

    def set_width(self, _: int) -> None: ...

    def flush(self) -> None:
        self.flushed += 1

    def add_html(self, content: str) -> Place:
        self.places.append(Place(content))
        return self.places[-1]


class Sent:
    """Takes whatever is sent to it, and remembers it."""

    def __init__(self) -> None:
        self.sent: list[tuple[Any, ...]] = []

    def __getattr__(self, name: str) -> Any:
        return lambda *values, **_: self.sent.append((name, *values))
