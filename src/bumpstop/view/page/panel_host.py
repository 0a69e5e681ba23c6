"""What panels ask of the page that they stand on."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from collections.abc import Mapping

    import viser

    from bumpstop.arrays import FloatArray
    from bumpstop.view.answer import Answer
    from bumpstop.view.document import ViewDocument
    from bumpstop.view.opened import Opened
    from bumpstop.view.page.scene_view import SceneView


class PanelHost(Protocol):
    """A page, as its panels know it.

    Attributes:
        client: the browser.
        opened: what the page began with.
    """

    client: viser.ClientHandle
    opened: Opened

    @property
    def document(self) -> ViewDocument:
        """What is on screen."""

    @property
    def answer(self) -> Answer | None:
        """The newest result; None before the first."""

    @property
    def scene(self) -> SceneView:
        """The three-dimensional picture."""

    def refresh(self) -> None:
        """Compute and draw what is on screen."""

    def undo(self, *, again: bool = False) -> None:
        """One step back, or ``again`` forward."""

    def compare(self, *, keep: bool) -> None:
        """Keep what is on screen to compare with, or forget it."""

    def settled(self, button: str) -> tuple[ViewDocument, Answer | None] | None:
        """Wait until what a person has changed is computed; what is on screen, and its result.

        None: that takes long, and a note says so with the name of the button that was pressed.
        """

    def change(self, changes: Mapping[str, Any], key: str) -> None:
        """Change keys of the scenario on screen; a refusal is told at the control of ``key``."""

    def set_pose(self, q: FloatArray, velocity: FloatArray | None = None) -> None:
        """Put the arm into just this pose (dof,) [rad or m], with a velocity of the tip (3,) [m/s] if one is given."""
