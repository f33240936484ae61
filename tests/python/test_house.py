"""The house rules of the package: no circles between its modules, and no private name of one read by another."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import sheetsplat as ss

ROOT = Path(ss.__file__).parent
FILES = {
    ".".join(("sheetsplat", *path.relative_to(ROOT).with_suffix("").parts)).removesuffix(".__init__"): path
    for path in sorted(ROOT.rglob("*.py"))
}

NATIVE = "sheetsplat._sheetsplat"


def is_for_types_only(node: ast.AST) -> bool:
    """Return whether a statement is ``if TYPE_CHECKING``."""
    return isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"


def statements(tree: ast.AST) -> Iterator[ast.AST]:
    """Yield every statement that runs, those in functions too."""
    waiting = [tree]
    while waiting:
        for node in ast.iter_child_nodes(waiting.pop()):
            if not is_for_types_only(node) and not isinstance(node, ast.expr):
                yield node
                waiting.append(node)


@cache
def imported(module: str) -> list[tuple[str, str]]:
    """Return (module, name) of every import from the package; the name is empty where the module itself is imported."""
    found = []
    for node in statements(ast.parse(FILES[module].read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found += [(alias.name, "") for alias in node.names if alias.name.split(".")[0] == "sheetsplat"]
        elif isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "sheetsplat":
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                is_module = inner in FILES or inner == NATIVE
                found.append((inner, "") if is_module else (str(node.module), alias.name))
    return found


def edges() -> dict[str, set[str]]:
    """Return the modules that each module imports, at its top or in a function."""
    return {name: {other for other, _ in imported(name) if other in FILES and other != name} for name in FILES}


def circle(graph: dict[str, set[str]]) -> list[str]:
    """Return the modules of one circle, or nothing."""
    done: set[str] = set()

    def follow(name: str, way: list[str]) -> list[str]:
        if name in way:
            return way[way.index(name) :]
        if name in done:
            return []
        for other in sorted(graph[name]):
            if found := follow(other, [*way, name]):
                return found
        done.add(name)
        return []

    return next((found for name in sorted(graph) if (found := follow(name, []))), [])


def test_imports_form_no_circle():
    assert circle(edges()) == []
    # The check can fail.
    assert circle({"a": {"b"}, "b": {"c"}, "c": {"b"}}) == ["b", "c"]


def test_no_private_name_of_another_module_is_imported():
    """A module whose name begins with an underscore is private to the package that it lies in."""
    wrong = []
    for name in FILES:
        for other, imported_name in imported(name):
            package, _, last = other.rpartition(".")
            foreign = last.startswith("_") and other != NATIVE and not f"{name}.".startswith(f"{package}.")
            private = imported_name.startswith("_") and not imported_name.startswith("__")
            if foreign or private:
                wrong.append(f"{name}: {other} {imported_name}")
    assert wrong == []
