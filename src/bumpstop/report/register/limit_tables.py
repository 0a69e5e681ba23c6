"""Limit tables as they are: every region and pressure area with source and status."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bumpstop.report.markup import Html, element, paragraph, table, whole
from bumpstop.report.section import Part

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bumpstop.contact import LimitTable


class LimitTablesPart(Part):
    """Regions and pressure areas of each table."""

    title = "Limits of body regions"
    anchor = "limits"

    def __init__(self, tables: Sequence[LimitTable]) -> None:
        self._tables = tables

    def content(self) -> list[Html]:
        """Two tables for each."""
        found = [
            paragraph(
                "The tables as bumpstop has them. They rest on different grounds: a force of one with a pressure of "
                "another means nothing. Figures are transcriptions with a status; none claims conformity."
            )
        ]
        for one in self._tables:
            found += _one(one)
        return found


def _one(limits: LimitTable) -> list[Html]:
    regions = [
        (
            region.label,
            whole(f"{region.force_N:g}"),
            whole("not permitted" if region.transient_force_N is None else f"{region.transient_force_N:g}"),
            whole(f"{region.spring_N_mm:g}"),
            "" if region.effective_mass_kg is None else whole(f"{region.effective_mass_kg:g}"),
            whole(region.status),
        )
        for region in limits.regions
    ]
    labels = {region.name: region.label for region in limits.regions}
    areas = [
        (
            labels[area.region],
            "whole region" if area.label == "region" else area.label,
            whole(f"{area.pressure_N_cm2:g}"),
            whole("not permitted" if area.transient_pressure_N_cm2 is None else f"{area.transient_pressure_N_cm2:g}"),
            whole(area.status),
        )
        for area in limits.areas
    ]
    found = [
        element("h3", f"{limits.name}: {limits.title}"),
        paragraph(f"Source: {limits.source}. Status: {limits.status}. {limits.note}"),
        table(
            ("body region", "quasi-static, N", "transient, N", "spring, N/mm", "mass, kg", "status"),
            regions,
            caption=f"Force limits of {limits.name}",
        ),
    ]
    if areas:
        headings = ("body region", "area", "quasi-static, N/cm²", "transient, N/cm²", "status")
        found.append(table(headings, areas, caption=f"Pressure limits of {limits.name}"))
    return found
