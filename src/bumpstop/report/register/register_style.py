"""How pages of registers are laid out, on the screen and printed."""

from __future__ import annotations

from bumpstop.report.print_style import print_style

_STYLE = """\
#situations table, #inputs table, #assumptions table { width: 100%; }
:is(#situations, #inputs, #assumptions, #provenance, #stopping, #measurements, #limits, #standards) td {
  overflow-wrap: anywhere; }
:is(#situations, #inputs, #assumptions) tbody th { overflow-wrap: anywhere; min-width: 6rem; }
#situations table:not(.numbers) td { min-width: 5.4rem; }
:is(#situations, #stopping) .numbers td { white-space: nowrap; }
#verdict table th, .whole { white-space: nowrap; }
#verdict tr:last-child td { min-width: 18rem; height: 2.6rem; }
#situations .figures { max-width: 46rem; }
#situations figure { max-width: none; flex-basis: 100%; }
@media print { #situations figure { width: 100%; } }
"""


def register_style(name: str) -> str:
    """CSS of a page; ``name`` stands at the foot of every sheet."""
    return _STYLE + print_style(name)
