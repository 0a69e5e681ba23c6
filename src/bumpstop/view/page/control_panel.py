"""The panel of the controls: inputs made from the table of controls, and refusals in their places."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

from bumpstop.report.colours import LIMIT
from bumpstop.report.markup import element
from bumpstop.view.controls import PANELS, Control, Shown, controls_of

if TYPE_CHECKING:
    from collections.abc import Callable

    import viser

    from bumpstop.collision import Scenario
    from bumpstop.model import Robot

_OPEN = ("Motion", "Contact")


class ControlPanel:
    """Inputs of a page, one for every control.

    Args:
        client: whose page it is.
        scenario: shown at first.
        robot: of the scenario.
        changed: told the key of a control when a person has changed it.
    """

    def __init__(
        self, client: viser.ClientHandle, scenario: Scenario, robot: Robot, changed: Callable[[str], None]
    ) -> None:
        self._gui, self._robot, self._changed = client.gui, robot, changed
        self.controls = {control.key: control for control in controls_of(scenario, robot)}
        self._inputs: dict[str, Any] = {}
        self._known: dict[str, Any] = {}  # what inputs showed when they were last written or read here
        self._folders: dict[str, viser.GuiFolderHandle] = {}
        self._refusals: dict[str, viser.GuiHtmlHandle] = {}
        for panel in PANELS:
            inside = [control for control in self.controls.values() if control.panel == panel]
            if inside:
                with client.gui.add_folder(panel, expand_by_default=panel in _OPEN) as folder:
                    for control in inside:
                        self._add(control, scenario)
                        self._folders[control.key] = folder

    def _add(self, control: Control, scenario: Scenario) -> None:
        made = _input(self._gui, control, control.read(scenario))
        key = control.key

        made.on_update(lambda _: self._changed(key))
        self._inputs[key], self._known[key] = made, made.value

    def shown(self, key: str) -> Shown:
        """What a control shows now: whoever asks takes it over."""
        self._known[key] = self._inputs[key].value
        return cast("Shown", self._known[key])

    @property
    def moving(self) -> bool:
        """A person has moved a control, and the call that tells of it is still under way."""
        return any(made.value != self._known[key] for key, made in self._inputs.items())

    def show(self, scenario: Scenario, *, but: str | None = None) -> None:
        """Have every control show a scenario.

        Args:
            scenario: to show.
            but: key of the control that a person moves just now: what it shows is theirs.
        """
        self.controls = {control.key: control for control in controls_of(scenario, self._robot)}
        for key, made in self._inputs.items():
            control = self.controls.get(key)
            if control is None:
                continue
            value = control.read(scenario)
            if control.kind == "choice":
                options = _options(control, value)
                if tuple(made.options) != options:
                    ours = made.value == self._known[key]
                    made.options = options
                    # viser puts another choice in the place of one that is gone: nobody has moved that.
                    self._known[key] = made.value if ours else self._known[key]
            if control.kind == "slider":
                low, high = (
                    min(control.low, float(cast("float", value))),
                    max(control.high, float(cast("float", value))),
                )
                if low < made.min or high > made.max:
                    made.min, made.max = min(low, made.min), max(high, made.max)
            # A person may have moved it, and the call that tells of it be still under way.
            if key == but or made.value != self._known[key]:
                continue
            if made.value != value:
                made.value = value
                self._known[key] = made.value
            # What was refused is not in the control any more.
            self.refuse(key, "")

    def refuse(self, key: str, reason: str) -> None:
        """Say under a control why what it shows is not used; an empty reason takes that back."""
        place = self._refusals.get(key)
        if key not in self._inputs or (place is None and not reason):
            return
        if place is None:
            # Most are never needed, and each would cost the page time when it opens.
            with self._folders[key]:
                place = self._refusals[key] = self._gui.add_html("", order=self._inputs[key].order + 0.5)
        look = f"color:{LIMIT};font-size:12px;padding:2px 10px;overflow-wrap:anywhere"
        if reason:
            place.content = str(element("div", f"✖ {reason}", style=look, data_refusal=key))
        if place.visible != bool(reason):
            place.visible = bool(reason)


def _options(control: Control, value: Shown) -> tuple[str, ...]:
    return tuple(dict.fromkeys((*control.choices, str(value))))


def _input(gui: viser.GuiApi, control: Control, value: Shown) -> Any:
    label, hint = control.label, control.hint or None
    if control.kind == "slider":
        number = float(cast("float", value))
        return gui.add_slider(
            label, min(control.low, number), max(control.high, number), control.step, number, hint=hint
        )
    if control.kind == "number":
        return gui.add_number(
            label, float(cast("float", value)), min=control.low, max=control.high, step=control.step, hint=hint
        )
    if control.kind == "choice":
        return gui.add_dropdown(label, _options(control, value), initial_value=str(value), hint=hint)
    if control.kind == "vector":
        x, y, z = cast("tuple[float, float, float]", value)
        return gui.add_vector3(label, (x, y, z), step=control.step, hint=hint)
    return gui.add_text(label, str(value), hint=hint)
