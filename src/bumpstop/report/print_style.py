"""How pages that are filed are printed: A4, page numbers, a line below every page that says what it belongs to."""

from __future__ import annotations

_STYLE = """\
@page { size: A4; margin: 16mm 14mm 18mm;
  @bottom-left { content: NAME; font: 8pt system-ui, "DejaVu Sans", Arial, sans-serif; color: #5c5c5c; }
  @bottom-right { content: "page " counter(page) " of " counter(pages);
    font: 8pt system-ui, "DejaVu Sans", Arial, sans-serif; color: #5c5c5c; } }
@media print {
  html { font-size: 8.5pt; }
  thead { display: table-header-group; }
  thead, thead tr { break-inside: avoid; break-after: avoid; }
  tbody tr:first-child { break-before: avoid; }
  th, td { padding-right: .7rem; }
  .wide { break-inside: auto; }
  h3 + p { break-after: avoid; }
  /* A short table stays on one sheet, and with it what stands above. */
  table:not(:has(tbody tr:nth-child(13))) { break-inside: avoid; }
}
"""


def print_style(name: str) -> str:
    """CSS of a page; ``name`` stands at the foot of every sheet."""
    return _STYLE.replace("NAME", _css_string(name))


def _css_string(text: str) -> str:
    """A text as CSS quotes it; whatever could end the string or the style element is escaped."""
    plain = "".join(c if c.isalnum() or c in " .,:-()" else f"\\{ord(c):06x}" for c in text)
    return f'"{plain}"'
