"""Measures what makes a reader stop: how often it occurs in each area of the code, and whether that
is within its limit.

    .venv/bin/python .ci/readability.py           fails where a figure is above its limit
    .venv/bin/python .ci/readability.py --lower   lowers each limit to today's figure; raises none
    .venv/bin/python .ci/readability.py --where vague_names orchard/sim    names the places

Ruff measures what its rules can say: length of lines, docstrings, complexity, parameters. This
measures the rest. The limits stand in .ci/readability.toml, for 1,000 statements of an area. They
only fall.
"""

import argparse
import ast
import io
import math
import sys
import tokenize
import tomllib
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).parents[1]
LIMITS = Path(__file__).with_suffix(".toml")

MEASURES = {
    "tuple_assignments": "several unlike values are given to several names in one statement",
    "conditionals": "an expression chooses with `if` and `else`, or by an index into a literal",
    "nested_conditionals": "an expression that chooses is part of another one",
    "comprehensions": "a list, set, map or generator is built by an expression",
    "nested_comprehensions": "a comprehension has two loops, or another one inside",
    "positional_arguments": "a call passes more than five values without their names",
    "long_lambdas": "a lambda has more than forty characters",
    "long_chains": "a name has four dots or more",
    "mixed_and_or": "`and` stands within `or` without parentheses",
    "continued_comments": "a comment behind code only continues the code",
    "vague_names": "the name of a value says nothing of it",
    "bare_functions": "a function has no docstring",
    "double_classes": "a class has the name of another one",
    "double_files": "a file of tests has the name of another one, and pytest collects only one",
    "long_test_names": "the name of a test has more than sixty characters",
}
# Names that say nothing of a value.
VAGUE = frozenset(
    ["one", "two", "other", "told", "said", "given", "found", "made", "what", "which", "way"]
)
# Words with which a comment behind code may begin, because they are the unit of a number.
UNITS = frozenset(
    [
        "m",
        "s",
        "ms",
        "us",
        "h",
        "rad",
        "ticks",
        "tick",
        "m/s",
        "rad/s",
        "kg",
        "%",
        "bytes",
        "columns",
        "pixels",
        "hz",
    ]
)
# Comments for tools, which are not for readers.
DIRECTIVES = ("noqa", "type:", "fmt:", "mypy:", "pragma:")
# Values without names in a call.
MOST_POSITIONAL = 5
# Characters.
LONGEST_LAMBDA = 40
# Characters.
LONGEST_TEST_NAME = 60
# In a chain of names.
MOST_DOTS = 3
# Characters of names such as x, y, dx.
LONGEST_COORDINATE = 2
# A rate may have last bits beyond its limit.
ROUNDING = 1e-9

Function = ast.FunctionDef | ast.AsyncFunctionDef
Comprehension = ast.ListComp | ast.SetComp | ast.DictComp | ast.GeneratorExp


@dataclass
class Area:
    """A part of the code that has limits of its own, and what was found in it."""

    name: str
    statements: int = 0
    places: dict[str, list[str]] = field(default_factory=lambda: defaultdict(list))

    def rate(self, measure: str) -> float:
        """Return how often a measure occurs in 1,000 statements."""
        return 1000.0 * len(self.places[measure]) / max(1, self.statements)


class Reader(ast.NodeVisitor):
    """Adds what it finds in one file to an area."""

    def __init__(self, path: Path, area: Area) -> None:
        self._path = path
        self._area = area
        # Bytes, because the columns of Python's syntax tree count bytes.
        self._lines: list[bytes] = []
        # Name and place of each class.
        self.classes: list[tuple[str, str]] = []

    def read(self) -> None:
        """Read the file. Raises SyntaxError if it is no Python."""
        text = self._path.read_text(encoding="utf-8")
        self._lines = text.encode().splitlines()
        self.visit(ast.parse(text, self._path))
        for line in continued_comments(text):
            self._add("continued_comments", line)

    def visit(self, node: ast.AST) -> None:
        """Count a statement, and look at a node and at all below it."""
        is_docstring = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
        if isinstance(node, ast.stmt) and not is_docstring:
            self._area.statements += 1
        super().visit(node)

    def visit_Assign(self, node: ast.Assign) -> None:
        """Look for several unlike values in one statement. Swaps and coordinates may share one."""
        target = node.targets[0]
        if isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple):
            names = [ast.unparse(name) for name in target.elts]
            values = [ast.unparse(value) for value in node.value.elts]
            are_coordinates = all(len(name) <= LONGEST_COORDINATE for name in names)
            if not are_coordinates and sorted(names) != sorted(values):
                self._add("tuple_assignments", node.lineno)
        self.generic_visit(node)

    def visit_IfExp(self, node: ast.IfExp) -> None:
        """Look for a choice, and for one inside it."""
        self._add("conditionals", node.lineno)
        if contains(node, ast.IfExp):
            self._add("nested_conditionals", node.lineno)
        self.generic_visit(node)

    def visit_Subscript(self, node: ast.Subscript) -> None:
        """Look for a choice that is written as an index into a literal."""
        if isinstance(node.value, ast.Dict | ast.Tuple | ast.List):
            self._add("conditionals", node.lineno)
        self.generic_visit(node)

    def visit_BoolOp(self, node: ast.BoolOp) -> None:
        """Look for `and` within `or` that no parentheses set apart."""
        parts = [part for part in node.values if isinstance(part, ast.BoolOp)]
        if isinstance(node.op, ast.Or) and not all(self._has_parentheses(part) for part in parts):
            self._add("mixed_and_or", node.lineno)
        self.generic_visit(node)

    def visit_Call(self, node: ast.Call) -> None:
        """Look for many values without names."""
        if len(node.args) > MOST_POSITIONAL:
            self._add("positional_arguments", node.lineno)
        self.generic_visit(node)

    def visit_Lambda(self, node: ast.Lambda) -> None:
        """Look for a function that deserves a name."""
        if len(ast.unparse(node)) > LONGEST_LAMBDA:
            self._add("long_lambdas", node.lineno)
        self.generic_visit(node)

    def visit_Attribute(self, node: ast.Attribute) -> None:
        """Look for a chain of names. Only the whole chain counts, and none of its parts."""
        dots = 0
        start: ast.expr = node
        while isinstance(start, ast.Attribute):
            start = start.value
            dots += 1
        if dots > MOST_DOTS:
            self._add("long_chains", node.lineno)
        self.visit(start)

    def visit_Name(self, node: ast.Name) -> None:
        """Look for a name that says nothing, where it gets its value."""
        if isinstance(node.ctx, ast.Store) and node.id in VAGUE:
            self._add("vague_names", node.lineno)

    def visit_arg(self, node: ast.arg) -> None:
        """Look for a parameter whose name says nothing."""
        if node.arg in VAGUE:
            self._add("vague_names", node.lineno)
        self.generic_visit(node)

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        """Note the name of a class."""
        self.classes.append((node.name, self._place(node.lineno)))
        self.generic_visit(node)

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        """Look for a docstring."""
        self._visit_function(node)

    def visit_AsyncFunctionDef(self, node: ast.AsyncFunctionDef) -> None:
        """Look for a docstring."""
        self._visit_function(node)

    def _visit_function(self, node: Function) -> None:
        if ast.get_docstring(node) is None:
            self._add("bare_functions", node.lineno)
        if node.name.startswith("test_") and len(node.name) > LONGEST_TEST_NAME:
            self._add("long_test_names", node.lineno)
        self.generic_visit(node)

    def generic_visit(self, node: ast.AST) -> None:
        """Look at comprehensions, which are of four types, and at all that is below a node."""
        if isinstance(node, Comprehension):
            self._add("comprehensions", node.lineno)
            if len(node.generators) > 1 or contains(node, Comprehension):
                self._add("nested_comprehensions", node.lineno)
        super().generic_visit(node)

    def _has_parentheses(self, node: ast.expr) -> bool:
        """Whether parentheses stand around an expression in the source."""
        assert node.end_lineno is not None
        before = self._lines[node.lineno - 1][: node.col_offset].rstrip()
        after = self._lines[node.end_lineno - 1][node.end_col_offset :].lstrip()
        return before.endswith(b"(") and after.startswith(b")")

    def _place(self, line: int) -> str:
        return f"{self._path.relative_to(ROOT)}:{line}"

    def _add(self, measure: str, line: int) -> None:
        self._area.places[measure].append(self._place(line))


def contains(node: ast.AST, kind: object) -> bool:
    """Return whether a node of a kind, a type or several, stands below this one."""
    return any(isinstance(part, kind) for part in ast.walk(node) if part is not node)  # type: ignore[arg-type]


def continued_comments(text: str) -> Iterator[int]:
    """Yield the lines whose comment stands behind code and begins in lower case.

    A unit may stand there.
    """
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type != tokenize.COMMENT or not token.line[: token.start[1]].strip():
            continue
        words = token.string.lstrip("#: ")
        first_word = words.translate(str.maketrans(",:;", "   ")).split(" ")[0]
        is_directive = words.startswith(DIRECTIVES)
        if words[:1].islower() and first_word.lower() not in UNITS and not is_directive:
            yield token.start[0]


def files_of(settings: dict[str, list[str]]) -> list[Path]:
    """Return the Python files of an area.

    `settings`: its folders, files, and what it leaves out.
    """
    left_out = {ROOT / name for name in settings.get("without", [])}
    files = set[Path]()
    for name in settings["folders"]:
        path = ROOT / name
        files.update(path.rglob("*.py") if path.is_dir() else [path])
    return sorted(path for path in files if not left_out.intersection([path, *path.parents]))


def measured(name: str, files: Sequence[Path]) -> Area:
    """Return what was found in some files."""
    area = Area(name)
    classes: dict[str, list[str]] = defaultdict(list)
    names: dict[str, list[str]] = defaultdict(list)
    for path in files:
        if path.name.startswith("test_"):
            names[path.name].append(f"{path.relative_to(ROOT)}")
        reader = Reader(path, area)
        reader.read()
        for class_name, place in reader.classes:
            classes[class_name].append(place)
    for measure, named in (("double_classes", classes), ("double_files", names)):
        for places in named.values():
            if len(places) > 1:
                area.places[measure].extend(places)
    return area


def rounded_up(rate: float) -> float:
    """Return a limit that a rate just keeps, with one digit."""
    return math.ceil(rate * 10.0 - ROUNDING) / 10.0


def main() -> int:
    """Measure all areas, or name the places of one measure. Return 1 if a limit is passed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--lower", action="store_true", help="lower the limits to today's figures")
    parser.add_argument("--where", choices=MEASURES, help="name the places of this measure")
    parser.add_argument("paths", nargs="*", type=Path, help="with --where: files and folders")
    options = parser.parse_args()
    if options.where:
        return name_places(options.where, options.paths or [ROOT / "orchard"])
    limits = tomllib.loads(LIMITS.read_text())
    faults = Counter[str]()
    for name, settings in limits.items():
        area = measured(name, files_of(settings))
        for measure, limit in settings["limits"].items():
            rate = rounded_up(area.rate(measure))
            if rate > limit:
                faults[name] += 1
                meaning = MEASURES[measure]
                print(f"{name}: {measure} = {rate}, at most {limit}: {meaning}", file=sys.stderr)
            elif options.lower:
                settings["limits"][measure] = rate
    if options.lower:
        LIMITS.write_text(as_toml(LIMITS.read_text(), limits))
    return 1 if faults else 0


def name_places(measure: str, paths: Sequence[Path]) -> int:
    """Print each place of a measure in some files and folders."""
    folders = [str(path.absolute().relative_to(ROOT)) for path in paths]
    area = measured("", files_of({"folders": folders}))
    for place in area.places[measure]:
        print(place)
    return 0


def as_toml(text: str, limits: dict[str, dict[str, dict[str, float]]]) -> str:
    """Return the text of the limits' file with other figures. Comments and order stay."""
    # The area whose part of the file the lines are in.
    table = ""
    lines = []
    for line in text.splitlines():
        if line.startswith("["):
            table = line.strip("[]").partition(".")[0]
        measure, equals, _ = line.partition(" = ")
        if equals and measure in MEASURES:
            lines.append(f"{measure} = {limits[table]['limits'][measure]:g}")
        else:
            lines.append(line)
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    sys.exit(main())
