"""The panel of the controls: inputs made from the table of controls, and refusals in their places."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

from bumpstop.report.colours import LIMIT
from bumpstop.report.markup import element
from bumpstop.view.controls import PANELS, Control, Shown, controls_of
from bumpstop.view.field_text import field_text

if TYPE_CHECKING:
    from collections.abc import Callable

    import viser

    from bumpstop.collision import Scenario
    from bumpstop.model import Robot

_OPEN = ("Motion", "Contact")
_SAME = 1e-3  # of a slider's step: nobody sees that it stands beside a number


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
        self._sliders: dict[str, Any] = {}
        # What inputs and sliders showed when they were last written or read here.
        self._known: dict[str, Any] = {}
        self._slid: dict[str, float] = {}
        self._dragged: str | None = None
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
        made = _input(self._gui, control, scenario)
        key = control.key

        # What is written here calls back, too.
        made.on_update(lambda _: self._changed(key) if made.value != self._known[key] else None)
        self._inputs[key], self._known[key] = made, made.value
        if control.kind == "slider":
            # Any number can be typed above it: the field of viser's own rounds, and limits what is typed on the way.
            number = float(cast("float", control.read(scenario)))
            low, high = min(control.low, number), max(control.high, number)
            slider = self._gui.add_slider("", low, high, control.step, number)
            slider.on_update(lambda _: self._changed(key) if slider.value != self._slid[key] else None)
            self._sliders[key], self._slid[key] = slider, slider.value

    def shown(self, key: str) -> Shown:
        """What a control shows now: whoever asks takes it over."""
        slider = self._sliders.get(key)
        self._dragged = None
        if slider is not None and slider.value != self._slid[key]:
            self._dragged, self._slid[key] = key, slider.value
            self._write(key, field_text(slider.value))
        self._known[key] = self._inputs[key].value
        return cast("Shown", self._known[key])

    @property
    def moving(self) -> bool:
        """A person has moved a control, and the call that tells of it is still under way."""
        return any(self._is_moving(key) for key in self._inputs)

    def _is_moving(self, key: str) -> bool:
        slider = self._sliders.get(key)
        return self._inputs[key].value != self._known[key] or (slider is not None and slider.value != self._slid[key])

    def _write(self, key: str, text: str) -> None:
        self._known[key] = text
        self._inputs[key].value = text

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
            text = control.text(scenario)
            if control.kind == "choice":
                options = _options(control, text)
                if tuple(made.options) != options:
                    ours = made.value == self._known[key]
                    made.options = options
                    # viser puts another choice in the place of one that is gone: nobody has moved that.
                    self._known[key] = made.value if ours else self._known[key]
            # A person may have moved it, and the call that tells of it be still under way.
            if self._is_moving(key):
                continue
            if key in self._sliders and not key == but == self._dragged:
                self._slide(control, float(cast("float", control.read(scenario))))
            if key == but:
                continue
            if made.value != text:
                self._write(key, text)
            # What was refused is not in the control any more.
            self.refuse(key, "")

    def _slide(self, control: Control, number: float) -> None:
        """Have a slider stand at a number, which widens it where it must."""
        slider = self._sliders[control.key]
        low, high = min(control.low, number), max(control.high, number)
        if low < slider.min or high > slider.max:
            slider.min, slider.max = min(low, slider.min), max(high, slider.max)
        if abs(slider.value - number) > _SAME * control.step:
            self._slid[control.key] = number
            slider.value = number

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


def _options(control: Control, text: str) -> tuple[str, ...]:
    return tuple(dict.fromkeys((*control.choices, text)))


def _input(gui: viser.GuiApi, control: Control, scenario: Scenario) -> Any:
    """A field: viser's own for numbers drop digits, and the decimal point, that their step does not have."""
    label, hint, text = control.label, control.hint or None, control.text(scenario)
    if control.kind == "choice":
        return gui.add_dropdown(label, _options(control, text), initial_value=text, hint=hint)
    return gui.add_text(label, text, hint=hint)
