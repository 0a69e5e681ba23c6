"""The settings of a detection page: what was asked for, the detector's own, and what computed the page."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from bumpstop.report.collision.tables import flat
from bumpstop.report.markup import Html, element, table
from bumpstop.report.section import Part

if TYPE_CHECKING:
    from collections.abc import Mapping


class SettingsPart(Part):
    """What was asked for, the detector's settings, and what computed it."""

    title = "Settings"
    anchor = "settings"

    def __init__(self, asked: Mapping[str, str], detector: Mapping[str, Any]) -> None:
        self._asked, self._detector = asked, detector

    def content(self) -> list[Html]:
        """Three tables; that of the detector only where there was one."""
        from bumpstop.shards import versions

        settings = [(element("code", key), value) for key, value in flat(dict(self._detector))]
        tables = [table(("", ""), list(self._asked.items()), caption="Asked for")]
        if settings:
            tables.append(table(("setting", "value"), settings, caption="Detector"))
        return [*tables, table(("", ""), list(versions().items()), caption="Made by")]
