"""Long comparisons of bumpstop with everything it can be compared with.

``python -m validation --out out/validation`` runs them all, prints a line for every check, writes ``index.html`` and
``results.json`` and ends with status 1 if any check fails. ``--only NAME`` runs one, ``--quick`` runs small sizes.
"""
