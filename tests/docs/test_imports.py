"""Who imports whom in Python: nothing in a circle, whether at the top, in functions or for types alone."""

from __future__ import annotations

import ast
import graphlib
from pathlib import Path

import pytest

from docs.pages import ROOT

# Module, then what is imported from which module; a name of None is the module itself.
Imports = dict[str, set[tuple[str, str | None]]]


def imports_of(tree: Path) -> Imports:
    """Of every module below a folder."""
    found: Imports = {}
    for path in tree.rglob("*.py"):
        parts = path.relative_to(tree).with_suffix("").parts
        name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
        syntax = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
        used = {(alias.name, None) for node in syntax if isinstance(node, ast.Import) for alias in node.names}
        for node in syntax:
            if isinstance(node, ast.ImportFrom):
                assert node.level == 0, f"{path} imports by dots"
                used |= {(node.module or "", alias.name) for alias in node.names}
        found[name] = used
    return found


def graph_of(imports: Imports) -> dict[str, set[str]]:
    """Modules and those they import. A package stands for the module from which it has the name."""
    packages = {name for name in imports if any(other.startswith(f"{name}.") for other in imports)}

    def defined_in(module: str, name: str | None) -> str:
        if f"{module}.{name}" in imports:
            return f"{module}.{name}"
        if module in packages:
            for other, handed_on in imports[module]:
                if handed_on == name:
                    return defined_in(other, name)
        return module

    return {
        module: {found for pair in used if (found := defined_in(*pair)) in imports.keys() - packages}
        for module, used in imports.items()
        if module not in packages
    }


def test_no_module_imports_one_that_needs_it() -> None:
    graph = graph_of(imports_of(ROOT / "src"))
    assert "bumpstop.collision.outcome" in graph["bumpstop.collision.result"]
    graphlib.TopologicalSorter(graph).prepare()


@pytest.mark.parametrize(
    "second",
    [
        "from room.one import f",
        "def g():\n    from room import f",
        "if TYPE_CHECKING:\n    import room.one",
        "from room import one",
    ],
)
def test_a_circle_is_found(tmp_path: Path, second: str) -> None:
    (tmp_path / "room").mkdir()
    (tmp_path / "room/__init__.py").write_text("from room.one import f\n")
    (tmp_path / "room/one.py").write_text("from room.two import g\n")
    (tmp_path / "room/two.py").write_text("\n")
    graphlib.TopologicalSorter(graph_of(imports_of(tmp_path))).prepare()
    (tmp_path / "room/two.py").write_text(second)
    with pytest.raises(graphlib.CycleError):
        graphlib.TopologicalSorter(graph_of(imports_of(tmp_path))).prepare()
