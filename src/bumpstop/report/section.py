"""What every part of a page has in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, ClassVar

from bumpstop.collision.probability_text import percent
from bumpstop.report.markup import Html, element

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bumpstop.collision import CollisionResult
    from bumpstop.report.picture import Picture, Rendered


class Part(ABC):
    """A part of a page: a heading, text and tables, and the figures that go with them.

    Attributes:
        title: the heading.
        anchor: its address inside the page.
    """

    title: ClassVar[str]
    anchor: ClassVar[str]

    def applies(self) -> bool:
        """Whether there is anything to say."""
        return True

    @abstractmethod
    def content(self) -> list[Html]:
        """Text and tables, in order; they stand above the figures."""

    def pictures(self) -> list[Picture]:
        """The figures, in order."""
        return []

    def html(self, rendered: Sequence[Rendered]) -> Html:
        """The part as a section of a page, with its figures already drawn."""
        figures = [element("div", *(picture.html() for picture in rendered), class_="figures")] if rendered else []
        heading = element("h2", self.title, id=f"{self.anchor}-title")
        return element(
            "section", heading, *self.content(), *figures, id=self.anchor, aria_labelledby=f"{self.anchor}-title"
        )


class Section(Part):
    """A part of the report on one collision.

    Attributes:
        result: what is reported on.
    """

    def __init__(self, result: CollisionResult) -> None:
        self.result = result

    def _percent(self, p: float) -> str:
        """A probability of the result."""
        return percent(p, integrated=self.result.kind == "exact")
