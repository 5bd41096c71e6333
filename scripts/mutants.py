"""Mutants of a module: its source with one small fault, made by Cosmic Ray's operators.

Which operators are taken, and which places are left out, is the rule of scripts/mutation.py:

- arithmetic operators become other arithmetic ones, bitwise ones (masks) other bitwise ones;
  comparisons become other comparisons, ``is`` becomes ``is not``; conditions are negated, ``and``
  becomes ``or``; a sign, ``~`` or ``not`` is dropped; numbers become one more and one less; True
  becomes False; ``break`` becomes ``continue``; a loop runs over nothing; a handler catches
  something else; a decorator is dropped; and each the other way round;
- left out are annotations, ``if TYPE_CHECKING:``, ``__all__``, docstrings, what is worked out in
  the texts of errors, warnings and log messages, and what decides how a function is compiled or
  whether its results are kept (``@cached_njit``, ``@cache``), which changes no result.
"""

from __future__ import annotations

import ast
import difflib
import hashlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import permutations
from pathlib import Path

ARITHMETIC = ("Add", "Sub", "Mul", "Div", "FloorDiv", "Mod", "Pow")
BITWISE = ("BitOr", "BitAnd", "BitXor")
COMPARISONS = ("Eq", "NotEq", "Lt", "LtE", "Gt", "GtE")
OPERATORS = (
    *(f"ReplaceBinaryOperator_{a}_{b}" for a, b in permutations(ARITHMETIC, 2)),
    *(f"ReplaceBinaryOperator_{a}_{b}" for a, b in permutations(BITWISE, 2)),
    *(f"ReplaceComparisonOperator_{a}_{b}" for a, b in permutations(COMPARISONS, 2)),
    *(f"ReplaceComparisonOperator_{a}_{b}" for a, b in permutations(("Is", "IsNot"), 2)),
    *(f"ReplaceUnaryOperator_Delete_{name}" for name in ("USub", "Invert", "Not")),
    "AddNot",
    "ReplaceTrueWithFalse",
    "ReplaceFalseWithTrue",
    "ReplaceAndWithOr",
    "ReplaceOrWithAnd",
    "ReplaceBreakWithContinue",
    "ReplaceContinueWithBreak",
    "ExceptionReplacer",
    "NumberReplacer",
    "RemoveDecorator",
    "ZeroIterationForLoop",
)
COMPILED_OR_KEPT = ("cached_njit", "njit", "cache", "lru_cache", "overload")
TELLING = ("Error", "Warning", "warn", "debug", "info", "warning", "error", "exception", "log")

Position = tuple[int, int]  # a line from 1, a column in characters from 0


@dataclass(frozen=True)
class Mutant:
    """One fault in one module."""

    module: str
    """The module's file, such as ``pose/metrics.py``."""
    text: str = field(repr=False)
    """The module as it is."""
    operator: str
    occurrence: int
    line: int

    @property
    def key(self) -> str:
        """Identify the mutant as long as the module stays as it is."""
        what = f"{self.module}\n{self.operator}\n{self.occurrence}\n{self.text}"
        return hashlib.sha256(what.encode()).hexdigest()[:16]

    def mutated(self) -> str | None:
        """Return the module with the fault; None where Python reads it as it was."""
        from cosmic_ray.mutating import mutate_code
        from cosmic_ray.operators.provider import OperatorProvider

        operator = OperatorProvider()[self.operator]()
        mutated = mutate_code(self.text, operator, self.occurrence)
        return None if mutated is None or _same(self.text, mutated) else mutated

    def diff(self, mutated: str) -> str:
        """Return what is different, without the names of files."""
        lines = difflib.unified_diff(self.text.splitlines(), mutated.splitlines(), lineterm="", n=1)
        return "\n".join(list(lines)[2:])


def mutants_of(path: Path, module: str) -> list[Mutant]:
    """Return every mutant of a file."""
    from cosmic_ray.ast import ast_nodes, get_ast
    from cosmic_ray.operators.provider import OperatorProvider

    source = path.read_text(encoding="utf-8")
    left_out = _left_out(source)
    provider = OperatorProvider()
    nodes = list(ast_nodes(get_ast(source)))
    mutants = []
    for name in OPERATORS:
        operator = provider[name]()
        places = [(node, place) for node in nodes for place in operator.mutation_positions(node)]
        for occurrence, (node, (start, _)) in enumerate(places):
            # Cosmic Ray takes the * that begins keyword-only parameters for a product.
            separator = node.parent is not None and node.parent.type == "parameters"
            if not separator and not any(a <= start < b for a, b in left_out):
                mutants.append(Mutant(module, source, name, occurrence, start[0]))
    return mutants


def _same(source: str, mutated: str) -> bool:
    """Whether Python reads the two alike."""
    try:
        return ast.dump(ast.parse(source)) == ast.dump(ast.parse(mutated))
    except SyntaxError:  # dies when it is imported
        return False


def _left_out(source: str) -> list[tuple[Position, Position]]:
    """Return the places where a fault would be none, from and to."""
    lines = source.splitlines()
    spans = []
    for node in ast.walk(ast.parse(source)):
        for part in _harmless(node):
            assert part.end_lineno is not None and part.end_col_offset is not None
            spans.append(
                (
                    _position(lines, part.lineno, part.col_offset),
                    _position(lines, part.end_lineno, part.end_col_offset),
                )
            )
    # A decorator begins at its @.
    return [((a[0], 0) if lines[a[0] - 1].lstrip()[:1] == "@" else a, b) for a, b in spans]


def _position(lines: list[str], line: int, column: int) -> Position:
    """Turn a column in bytes of UTF-8 into one in characters."""
    return line, len(lines[line - 1].encode()[:column].decode())


def _harmless(node: ast.AST) -> Iterator[ast.expr | ast.stmt]:
    """Yield the parts of a node in which a fault would be none."""
    match node:
        case ast.arg(annotation=ast.expr() as annotation):
            yield annotation
        case ast.AnnAssign(annotation=annotation):
            yield annotation
        case ast.If(test=test) if ast.unparse(test).endswith("TYPE_CHECKING"):
            yield test
            yield from node.body
        case ast.Assign(targets=[ast.Name(id="__all__")]):
            yield node
        case ast.Raise() | ast.Call() if _tells(node):
            yield from (part for part in ast.walk(node) if isinstance(part, ast.JoinedStr))
    if isinstance(node, ast.FunctionDef):
        if node.returns is not None:
            yield node.returns
        yield from (d for d in node.decorator_list if _name(d) in COMPILED_OR_KEPT)


def _tells(node: ast.Raise | ast.Call) -> bool:
    """Whether this raises an error, makes one, warns or logs."""
    return isinstance(node, ast.Raise) or _name(node).endswith(TELLING)


def _name(expression: ast.expr) -> str:
    """Return the last name of what is called: ``njit`` of ``numba.njit(nogil=True)``."""
    if isinstance(expression, ast.Call):
        expression = expression.func
    return ast.unparse(expression).rpartition(".")[2]
