"""Places where a small change of a source text should make a test fail: OpenCL C by its tokens, Python by its syntax
tree. See mutants.py.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass

SWAPS = {"<": "<=", "<=": "<", ">": ">=", ">=": ">", "==": "!=", "!=": "==", "+": "-", "-": "+", "*": "/", "/": "*"}
SWAPS |= {"&&": "||", "||": "&&", "&": "|", "|": "&", "<<": ">>", ">>": "<<", "%": "*", "+=": "-=", "-=": "+="}
SWAPS |= {"*=": "=", "//": "*", "|=": "&=", "&=": "|="}
NAMES = {"min": "max", "max": "min", "fmin": "fmax", "fmax": "fmin", "LEAST": "MOST", "MOST": "LEAST"}
NAMES |= {"MIN3": "MAX3", "MAX3": "MIN3", "NEXT_CORNER": "LAST_CORNER", "LAST_CORNER": "NEXT_CORNER"}
MEMBERS = {"x": "y", "y": "x", "z": "x", "w": "z", "r": "g", "g": "b", "b": "r", "lo": "hi", "hi": "lo"}
MEMBERS |= {"high": "low", "low": "high"}


@dataclass(frozen=True)
class Site:
    """A change of a text: the characters from `start` to `end` become `new`."""

    start: int
    end: int
    new: str
    kind: str

    def applied(self, text: str) -> str:
        return text[: self.start] + self.new + text[self.end :]

    def lines(self, text: str) -> tuple[int, str, str]:
        """Return the number of the first changed line, and the changed lines before and after, each joined into one
        line."""
        begin = text.rfind("\n", 0, self.start) + 1
        end = text.find("\n", self.end)
        end = len(text) if end < 0 else end
        now = text[begin : self.start] + self.new + text[self.end : end]
        return text.count("\n", 0, begin) + 1, " ".join(text[begin:end].split()), " ".join(now.split())


def sites(name: str, text: str) -> list[Site]:
    """Return all changes of a file's text, in text order."""
    changes = python_sites(text) if name.endswith(".py") else kernel_sites(text)
    return sorted(set(changes), key=lambda site: (site.start, site.end, site.new))


# OpenCL C

_HIDDEN = re.compile(
    r"//[^\n]*|/\*.*?\*/|\"[^\"\n]*\"|__has_builtin\(\w+\)"
    r"|^[ \t]*#[ \t]*(?:if|ifdef|ifndef|elif|else|endif|undef|include|error|pragma|line)[^\n]*",
    re.DOTALL | re.MULTILINE,
)
_BINARY = re.compile(r"(?<=[\w)\]]) (<=?|>=?|==|!=|\+|-|\*|/|&&|\|\||&|\||<<|>>|%) (?=[\w(!~-])")
_COMPOUND = re.compile(r" ([-+*|&]=) ")
_NUMBER = re.compile(
    r"(?<![\w.])(?:0x[0-9a-fA-F.]+p[-+]?\d+f?|0x[0-9a-fA-F]+|\d+\.\d*(?:e[-+]?\d+)?f?|\d+)(?:U?L)?(?![\w.])"
)
_NEGATED = re.compile(r"!(?=[\w(])")
_SIGN = re.compile(r"(?<=[(,=?:{] |.[({])-(?=[A-Za-z(])|(?<=return )-(?=[A-Za-z(])")
_MEMBER = re.compile(r"(?<=[\w\])])(?:\.|->)(x|y|z|w|r|g|b|lo|hi|high|low)\b(?!\()")
_CALL = re.compile(r"\b(" + "|".join(NAMES) + r")(?=\()")
_FMA = re.compile(r"\bfma\(")
_IF = re.compile(r"\bif \(")
_INDEX = re.compile(r"(?<=[\w\])])\[([a-z]\w*)\]")
_STATEMENT = re.compile(
    r"^[ \t]+(?!for \(|if \(|while \()((?:[\w\->.\[\]*() +]+? [-+*|&]?= [^;{}]*|\w+\([^;{}]*\)|continue|break|return);)",
    re.MULTILINE,
)
_DECLARED = re.compile(r"[ \t]*(?:global |local |const )*(?:int|real|reals|ints|longs|fixeds|double_single) [^=]*$")
_DECLARES = re.compile(r"^(?:const |global |private )*[A-Za-z_]\w*(?: \*?| \*const )[a-z]\w*(?:\[\w*\])*(?:,| =)")


def kernel_sites(text: str) -> Iterator[Site]:
    """Yield changes of OpenCL C, except in comments and in preprocessor lines other than macro bodies."""
    code = _HIDDEN.sub(lambda match: re.sub(r"[^\n]", " ", match[0]), text)
    for pattern, table, kind in (
        (_BINARY, SWAPS, "operator"),
        (_COMPOUND, SWAPS, "operator"),
        (_CALL, NAMES, "name"),
        (_MEMBER, MEMBERS, "member"),
    ):
        for match in pattern.finditer(code):
            yield Site(*match.span(1), table[match[1]], kind)
    for match in _NUMBER.finditer(code):
        for new in _other_numbers(match[0]):
            yield Site(*match.span(), new, "constant")
    for match in (*_NEGATED.finditer(code), *_SIGN.finditer(code)):
        yield Site(*match.span(), "", "sign")
    for match in _INDEX.finditer(code):
        if not _DECLARED.match(code[code.rfind("\n", 0, match.start()) + 1 : match.start()]):
            yield Site(match.end(1), match.end(1), " + 1", "index")
    for match in _IF.finditer(code):
        end = _closing(code, match.end())
        yield Site(match.end(), end, f"!({text[match.end() : end]})", "condition")
    for match in _FMA.finditer(code):
        parts = _arguments(code, match.end())
        if len(parts) == 3:
            _, b, c = (text[slice(*part)] for part in parts)
            yield Site(parts[2][0], parts[2][1], f"-({c})", "fma")
            yield Site(parts[1][0], parts[2][1], f"{c}, {b}", "fma")
    for match in _STATEMENT.finditer(code):
        if not _DECLARES.match(match[1]) and "\\\n" not in match[1]:
            yield Site(*match.span(1), ";", "statement")


def _other_numbers(number: str) -> list[str]:
    """Return a literal off by one, or doubled and negated."""
    plain = re.fullmatch(r"(0x[0-9a-fA-F]+|\d+)((?:U?L)?)", number)
    if plain is None:
        zero = not re.search(r"[1-9a-f]", re.sub(r"[ep].*|f$|^0x", "", number))
        return ["1.0f"] if zero else [f"(2 * {number})", f"(-{number})"]
    value, suffix = int(plain[1], 0), plain[2]
    return [f"{value + 1}{suffix}"] + ([f"{value - 1}{suffix}"] if value else [])


def _closing(code: str, start: int) -> int:
    """Return the position of the parenthesis that closes the one open at `start`."""
    depth = 1
    for at in range(start, len(code)):
        depth += (code[at] in "([{") - (code[at] in ")]}")
        if depth == 0:
            return at
    return len(code)


def _arguments(code: str, start: int) -> list[tuple[int, int]]:
    """Return the start and end of each argument of a call whose first argument begins at `start`."""
    end, depth, parts = _closing(code, start), 0, []
    for at in range(start, end):
        depth += (code[at] in "([{") - (code[at] in ")]}")
        if code[at] == "," and depth == 0:
            parts.append((start, at))
            start = at + 1 + (len(code[at + 1 :]) - len(code[at + 1 :].lstrip()))
    return [*parts, (start, end)]


# Python

_OPERATORS: dict[type, str] = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!="}
_OPERATORS |= {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.FloorDiv: "//", ast.Mod: "%"}
_OPERATORS |= {ast.LShift: "<<", ast.RShift: ">>", ast.BitAnd: "&", ast.BitOr: "|"}
_WORDS: dict[type, tuple[str, str]] = {ast.And: ("and", "or"), ast.Or: ("or", "and"), ast.Is: ("is", "is not")}
_WORDS |= {ast.IsNot: ("is not", "is"), ast.In: ("in", "not in"), ast.NotIn: ("not in", "in")}


def python_sites(text: str) -> Iterator[Site]:
    """Yield changes of Python code, except in strings, annotations and code for type checkers only."""
    encoded = text.encode()
    starts = [0]
    for line in encoded.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))

    def place(line: int, column: int) -> int:
        return len(encoded[: starts[line - 1] + column].decode())

    def span(node: ast.AST) -> tuple[int, int]:
        return place(node.lineno, node.col_offset), place(node.end_lineno, node.end_col_offset)  # type: ignore[attr-defined]

    def between(left: ast.AST, right: ast.AST, old: str, new: str) -> Iterator[Site]:
        begin, end = span(left)[1], span(right)[0]
        match = re.search(rf"(?<![\w<>=!]){re.escape(old)}(?![\w<>=])", text[begin:end])
        if match:
            yield Site(begin + match.start(), begin + match.end(), new, "operator")

    for node in _evaluated(ast.parse(text)):
        if isinstance(node, ast.Compare):
            sides = [node.left, *node.comparators]
            for left, operator, right in zip(sides, node.ops, sides[1:], strict=False):
                old, new = _WORDS.get(type(operator)) or _swap(operator)
                yield from between(left, right, old, new)
        elif isinstance(node, ast.BinOp) and type(node.op) in _OPERATORS:
            yield from between(node.left, node.right, *_swap(node.op))
        elif isinstance(node, ast.BoolOp):
            for left, right in zip(node.values, node.values[1:], strict=False):
                yield from between(left, right, *_WORDS[type(node.op)])
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.Not, ast.USub)):
            yield Site(span(node)[0], span(node.operand)[0], "", "sign")
        elif isinstance(node, ast.Constant):
            for new in _other_constants(node.value):
                yield Site(*span(node), new, "constant")
        elif isinstance(node, (ast.If, ast.IfExp)):
            begin, end = span(node.test)
            yield Site(begin, end, f"(not ({text[begin:end]}))", "condition")
        elif _removable(node):
            yield Site(*span(node), "pass", "statement")


def _swap(operator: ast.AST) -> tuple[str, str]:
    old = _OPERATORS[type(operator)]
    return old, SWAPS[old]


def _other_constants(value: object) -> list[str]:
    if isinstance(value, bool):
        return [str(not value)]
    if isinstance(value, int):
        return [str(value + 1), str(value - 1) if value > 0 else "(-1)"]
    if isinstance(value, float):
        return [f"({2.0 * value!r})", f"({-value!r})"] if value else ["1.0"]
    return []


def _removable(node: ast.AST) -> bool:
    """Return whether the rest can still run without a statement."""
    if isinstance(node, ast.Expr):
        return isinstance(node.value, ast.Call)
    if isinstance(node, ast.Assign):
        return any(isinstance(target, (ast.Attribute, ast.Subscript)) for target in node.targets)
    return isinstance(node, (ast.AugAssign, ast.Raise, ast.Continue, ast.Break))


def _evaluated(node: ast.AST) -> Iterator[ast.AST]:
    """Yield the descendants that are executed: no annotations, no f-strings, nothing for type checkers only, and not
    the stack level of a warning."""
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "type_comment"):
            continue
        for child in value if isinstance(value, list) else [value]:
            if not isinstance(child, ast.AST) or isinstance(child, ast.JoinedStr):
                continue
            if isinstance(child, ast.If) and "TYPE_CHECKING" in ast.dump(child.test):
                continue
            if isinstance(child, ast.keyword) and child.arg == "stacklevel":
                continue
            yield child
            yield from _evaluated(child)
