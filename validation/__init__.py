"""Long comparisons of bumpstop with everything it can be compared with.

``python -m validation --out out/validation`` runs them all, prints a line for every check, writes ``index.html`` and
``results.json`` and ends with status 1 if any check fails. ``--only NAME`` runs one, ``--quick`` runs small sizes,
``--jobs N`` as many at a time; those that race with clocks run alone, at the end.
"""

import sys
from pathlib import Path

# The reference simulator and the scenarios to compare live with the tests.
_TESTS = str(Path(__file__).resolve().parent.parent / "tests")
if _TESTS not in sys.path:
    sys.path.insert(0, _TESTS)
