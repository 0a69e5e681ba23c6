"""Documents that a dossier refers to."""

from __future__ import annotations

from bumpstop.register.documents import referred_documents
from bumpstop.report.markup import Html, paragraph, table, whole
from bumpstop.report.section import Part


class DocumentsPart(Part):
    """Standards by name, with the status of every reference."""

    title = "Documents referred to"
    anchor = "standards"

    def content(self) -> list[Html]:
        """One table."""
        rows = [
            (whole(one.name), one.clause or "none named", one.about, whole(one.status), one.source)
            for one in referred_documents()
        ]
        return [
            paragraph("References as bumpstop has them. “unverified”: not compared with the document itself."),
            table(("document", "clause", "for", "status", "source"), rows, caption="Documents"),
        ]
