"""The house rules: what modules import, texts that nobody matches, and the tests that hold measured constants."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path

import pytest

import sheetsplat as ss
from sheetsplat.backends import BACKEND_TRAITS
from sheetsplat.modes import TRAITS
from sheetsplat.options.core import MODES
from sheetsplat.options.renderer import BACKENDS

ROOT = Path(ss.__file__).parent
CLONE = Path(__file__).parents[3]
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


# ---- messages are short


def words(node: ast.AST) -> str:
    """Return the words of a text in the source; what is put in counts as one, of two texts the longer one."""
    if isinstance(node, ast.Constant):
        return str(node.value or "")
    if isinstance(node, ast.JoinedStr):
        return "".join(str(part.value) if isinstance(part, ast.Constant) else "_" for part in node.values)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return words(node.left) + words(node.right)
    if isinstance(node, ast.IfExp):
        return max(words(node.body), words(node.orelse), key=len)
    return " _ "


def long_messages(tree: ast.AST) -> list[int]:
    """Return the lines of errors and warnings of more than 30 words."""
    calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)]
    told = [call for call in calls if call.func.id in ("complain", "unreadable", "warn")]  # type: ignore[attr-defined]
    return [call.lineno for call in told if len(" ".join(map(words, call.args)).split()) > 30]


def test_errors_and_warnings_have_at_most_30_words():
    found = {name: long_messages(ast.parse(path.read_text(encoding="utf-8"))) for name, path in FILES.items()}
    assert {name: lines for name, lines in found.items() if lines} == {}
    # The check can fail.
    assert long_messages(ast.parse(f"complain('{'word ' * 15}', f'{'word ' * 15}{{x}}')")) == [1]
    assert long_messages(ast.parse(f"complain('{'word ' * 15}', f'{'word ' * 14}{{x}}')")) == []


# ---- messages are no interface


def text_of_error(node: ast.AST) -> bool:
    """Return whether an expression is the text of an error, or a part of one."""
    parts: list[ast.AST] = []
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "str":
        parts = list(node.args[:1])
    elif isinstance(node, ast.Attribute) and node.attr in ("what", "found", "wanted", "advice"):
        parts = [node.value]
    return any(isinstance(part, ast.Name) and part.id in ("error", "problem", "reason") for part in parts)


def matched_texts(tree: ast.AST) -> list[int]:
    """Return the lines where something is decided by the text of an error."""
    lines = []
    for node in ast.walk(tree):
        searched: list[ast.AST] = []
        if isinstance(node, ast.Compare):
            searched = [node.left, *node.comparators]
            if not any(isinstance(one, ast.In | ast.NotIn | ast.Eq | ast.NotEq) for one in node.ops):
                searched = []
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            if node.func.attr in ("startswith", "endswith", "removeprefix", "find", "index", "count"):
                searched = [node.func.value]
            elif node.func.attr in ("search", "match", "fullmatch", "findall", "sub"):
                searched = list(node.args)
        if any(text_of_error(one) for one in searched):
            lines.append(node.lineno)
    return lines


def test_nothing_is_decided_by_the_text_of_an_error():
    found = {name: matched_texts(ast.parse(path.read_text(encoding="utf-8"))) for name, path in FILES.items()}
    assert {name: lines for name, lines in found.items() if lines} == {}
    # The check can fail.
    for wrong in ("'a' in str(error)", "error.advice.startswith('a')", "re.search('a', str(error))"):
        assert matched_texts(ast.parse(wrong)) == [1]


# ---- constants found by measurement


TABLES = (
    "cpp/src/plan/limits_errors.hpp",
    "cpp/src/plan/include/plan/limits_common.hpp",
    "cpp/src/plan/include/plan/limits_gl.hpp",
    "cpp/src/backend_cpu/include/backend_cpu/measured.hpp",
)
CPP_TEST = re.compile(r"\b([A-Z]\w+\.[A-Za-z]\w+)(?:/(\w*)(<name>)?)?")
PYTHON_TEST = re.compile(r"(?<![\w/])(?:tests/python/(?:\w+/)?)?(test_\w+)(\.py)?")
QUALIFIER = re.compile(r"^(?:largest|smallest|least|most|widest|longest)_|^(?:paper_)|_float64$")


def constants(text: str) -> Iterator[tuple[str, str]]:
    """Yield the name of each constant of a table, and the comment that names its tests: its own, else its section's."""
    section = own = ""
    in_own = in_section = False
    for line in text.splitlines():
        if line.startswith("///"):
            own = (own if in_own else "") + line[3:]
            in_own, in_section = True, False
        elif line.startswith("//"):
            section = (section if in_section else "") + line[2:]
            in_own, in_section, own = False, True, ""
        else:
            in_own = in_section = False
            if not line:
                own = ""
            if line.startswith(("constexpr ", "inline constexpr ")):
                for name in re.findall(r"(\w+)(?: = |\{)", line):
                    yield name, own if named_tests(own) else section


def named_tests(comment: str) -> list[str]:
    """Return the tests that a comment names."""
    found = ["".join(parts) for parts in CPP_TEST.findall(comment)]
    return found + ["".join(parts) for parts in PYTHON_TEST.findall(comment)]


@cache
def cases() -> dict[str, set[str]]:
    """Return the C++ tests, and the names of the cases of those in test_limits*.cpp."""
    found: dict[str, set[str]] = {}
    for path in (CLONE / "tests/cpp").rglob("*.cpp"):
        text = path.read_text(encoding="utf-8")
        for suite, name in re.findall(r"^TEST(?:_F|_P)?\((\w+), (\w+)\)", text, re.MULTILINE):
            found.setdefault(f"{suite}.{name}", set())
    text = "".join(path.read_text(encoding="utf-8") for path in (CLONE / "tests/cpp/plan").glob("test_limits*.cpp"))
    for suite, table in re.findall(r"SUITE_P\(Limits, (\w+), testing::ValuesIn\((\w+)\)", text):
        rows = text.split(f"std::vector<Limit> {table}{{")[1].split("\n};")[0]
        for name in found:
            if name.startswith(f"{suite}."):
                found[name] |= set(re.findall(r'^    \{"(\w+)"', rows, re.MULTILINE))
    return found


@cache
def python_tests() -> set[str]:
    """Return the names of Python's tests and of their files."""
    files = list(Path(__file__).parents[1].rglob("test_*.py"))
    names = {name for file in files for name in re.findall(r"^def (test_\w+)", file.read_text("utf-8"), re.MULTILINE)}
    return names | {file.stem for file in files}


def missing_tests(constant: str, comment: str) -> list[str]:
    """Return the tests that a comment names and that do not exist; `<name>`: a case of the constant's name."""
    missing = [name for name, _ in PYTHON_TEST.findall(comment) if name not in python_tests()]
    for test, case, by_name in CPP_TEST.findall(comment):
        if test not in cases():
            missing.append(test)
        elif by_name:
            short = QUALIFIER.sub("", QUALIFIER.sub("", QUALIFIER.sub("", constant)))
            wanted = (constant, f"{case}{short}")
            if not any(one == name or one.startswith(f"{name}_") for one in cases()[test] for name in wanted):
                missing.append(f"{test}/{case}{short}")
        elif case and case not in cases()[test]:
            missing.append(f"{test}/{case}")
    return missing


@pytest.mark.parametrize("table", TABLES)
def test_measured_constants_name_tests_that_exist(table):
    found = list(constants((CLONE / table).read_text(encoding="utf-8")))
    assert len(found) > 5
    # The rounding of a number is no measurement.
    unheld = [name for name, comment in found if not named_tests(comment) and not name.endswith("_epsilon")]
    assert unheld == []
    assert {name: missing for name, comment in found if (missing := missing_tests(name, comment))} == {}


def test_the_check_of_measured_constants_can_fail():
    text = "/// Seen at 3. Test: Plan.NoSuchTest.\nconstexpr double largest_thing = 2.0;\n\nconstexpr int other = 1;\n"
    (thing, comment), (_, none) = constants(text)
    assert missing_tests(thing, comment) == ["Plan.NoSuchTest"] and named_tests(none) == []
    assert missing_tests("largest_thing", "tests: GlRefuses.Beyond/<name>") == ["GlRefuses.Beyond/thing"]
    assert missing_tests("", "Test: test_no_such_thing.") == ["test_no_such_thing"]


# Names of modes and backends in comparisons, which would have to be found again for each new one: files ask for traits.
COMPARED = {
    "*.py": r"{what}\W{{0,3}} (?:==|!=|\bin) \(?\"(?:{names})\"",
    "*.[ch]pp": r"{what}\W{{0,3}} (?:==|!=) (?:ss::)?\w+::(?:{names})\b",
}


def compared_names(folder: Path, what: str, names: Iterable[str]) -> list[str]:
    """Return the lines of a folder that compare a mode or a backend with one of some names."""
    found = []
    for pattern, comparison in COMPARED.items():
        is_compared = re.compile(comparison.format(what=what, names="|".join(names)))
        for path in sorted(folder.rglob(pattern)):
            lines = path.read_text(encoding="utf-8").splitlines()
            found += [
                f"{path.name}:{n}: {line.strip()}"
                for n, line in enumerate(lines, 1)
                # (Examples ask as users do.)
                if is_compared.search(line) and ">>>" not in line
            ]
    return found


@pytest.mark.parametrize("folder", ["python/sheetsplat", "python/bindings", "cpp/src", "cpp/apps"])
def test_nothing_is_decided_by_the_name_of_a_mode_or_backend(folder):
    assert compared_names(CLONE / folder, "mode", TRAITS) == []
    assert compared_names(CLONE / folder, "backend_?", BACKEND_TRAITS) == []


def test_the_search_for_compared_names_can_fail(tmp_path):
    (tmp_path / "one.py").write_text('sums = mode in ("xray", "average")\nif options["mode"] == "xray":\n    pass\n')
    (tmp_path / "two.cpp").write_text("if (plan.mode == Mode::mip || scene.mode != Mode::average) {\n")
    assert len(compared_names(tmp_path, "mode", ["xray", "mip"])) == 3


def test_the_names_of_modes_and_backends_are_those_of_the_engine():
    assert tuple(TRAITS) == MODES
    assert ("auto", *BACKEND_TRAITS) == BACKENDS
