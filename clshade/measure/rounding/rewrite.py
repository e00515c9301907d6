"""Rewriting of OpenCL C: operations of float32 become calls of the functions of kernels/random_rounding.clh.

The compiler's front end (libclang) tells the type and the place of each expression. It needs a text without macros, which
the preprocessor pcpp makes. Other text is left as it is: integers, pointers, float64, comparisons, and what is evaluated
outside of functions.
"""

from __future__ import annotations

import bisect
import io
import re
from collections.abc import Sequence
from functools import cache
from importlib.util import find_spec
from typing import Any

from ...base.extras import how_to_install
from ...errors import ClshadeError, InputError
from ...pipeline import programs
from . import exempt

PACKAGES = {"clang": "libclang", "pcpp": "pcpp"}
_NAMES = {"+": "random_sum", "-": "random_difference", "*": "random_product", "/": "random_quotient"}
_CALLS = {"fma": "random_fma", "sqrt": "random_root"}
_OTHERS = {  # functions that round, and would round to nearest: kernels use none of them
    *("mad", "dot", "cross", "length", "distance", "normalize", "mix", "smoothstep", "hypot", "rsqrt", "cbrt"),
    *("exp", "exp2", "exp10", "log", "log2", "log10", "pow", "powr", "pown", "sin", "cos", "tan", "atan", "atan2"),
}
_VECTOR = re.compile(r"float __attribute__\(\(ext_vector_type\((\d+)\)\)\)")
_WIDER = {"int", "unsigned int", "long", "unsigned long", "double"}  # not all of these are float32 numbers
_LINE = re.compile(rb'^#line \d+ "([^"]*)"', re.MULTILINE)

# What the front end has to know of OpenCL C besides its own built-in functions.
_FOLDER, _HEADER = "/opencl", "opencl-c-base.h"


def check_packages() -> None:
    """Raise ClshadeError if an optional package is missing."""
    for module, name in PACKAGES.items():
        if find_spec(module) is None:
            raise ClshadeError(f"stability: --random-rounding: needs {name}: `{how_to_install('rounding')}`")


def _header() -> str:
    """Return declarations of OpenCL C's types and constants, and of functions that clang does not declare itself."""
    lines = [f"typedef unsigned {name} u{name};" for name in ("char", "short", "int", "long")]
    lines += ["typedef __SIZE_TYPE__ size_t;", "typedef __UINTPTR_TYPE__ uintptr_t;"]
    kinds = "char", "uchar", "short", "ushort", "int", "uint", "long", "ulong", "float", "double"
    for kind in kinds:
        lines += [f"typedef {kind} {kind}{n} __attribute__((ext_vector_type({n})));" for n in (2, 3, 4, 8, 16)]
    overloaded = "__attribute__((overloadable))"
    for n in ("", "2", "4", "8", "16"):
        for to, others in (("float", ("int", "uint")), ("int", ("float", "uint")), ("uint", ("float", "int"))):
            lines += [f"{to}{n} {overloaded} as_{to}{n}({other}{n});" for other in others]
        if n:
            for space in ("global", "private", "local", "constant"):
                lines.append(f"float{n} {overloaded} vload{n}(size_t, const {space} float *);")
            for space in ("global", "private", "local"):
                lines.append(f"void {overloaded} vstore{n}(float{n}, size_t, {space} float *);")
    for to, other in (("double", "long"), ("double", "ulong"), ("long", "double"), ("ulong", "double")):
        lines.append(f"{to} {overloaded} as_{to}({other});")
    constants = {  # of which only the types matter
        "INFINITY": "1e999f",
        "NAN": "0.0f",
        "FLT_MAX": "0x1.fffffep127f",
        "FLT_MIN": "0x1p-126f",
        "FLT_EPSILON": "0x1p-23f",
        "DBL_MAX": "0x1.fffffffffffffp1023",
        "INT_MAX": "0x7fffffff",
        "UINT_MAX": "0xffffffffu",
        "LONG_MAX": "0x7fffffffffffffffL",
        "CLK_LOCAL_MEM_FENCE": "1",
        "CLK_GLOBAL_MEM_FENCE": "2",
    }
    return "\n".join([*lines, *(f"#define {name} {value}" for name, value in constants.items()), ""])


def preprocessed(source: str, options: Sequence[str]) -> str:
    """Return OpenCL C without macros, as the compiler sees it with options `-DNAME=value`. Functions of numbers are OpenCL's
    own: operations.clh replaces them only where a compiler says that it is clang."""
    import pcpp

    class Quiet(pcpp.Preprocessor):  # type: ignore[misc]
        def on_error(self, file: str, line: int, message: str) -> None:
            raise InputError(f"random rounding: {file}:{line}: expected OpenCL C, found: {message}")

    reader = Quiet()
    reader.line_directive = None
    for option in options:
        if option.startswith("-D"):
            name, _, value = option[2:].partition("=")
            reader.define(f"{name} {value or 1}")
    reader.parse(source)
    text = io.StringIO()
    reader.write(text)
    if reader.return_code:
        raise InputError("random rounding: expected OpenCL C, found the directive #error")
    return text.getvalue()


def rewritten(text: str) -> tuple[str, int]:
    """Return OpenCL C without macros whose operations of float32 round at random, and their number. Raises InputError if the
    front end does not understand it."""
    from clang import cindex

    options = ["-x", "cl", "-cl-std=CL1.2", "-Wno-everything", "-Xclang", "-fdeclare-opencl-builtins", "-I", _FOLDER]
    files = [("program.cl", text), (f"{_FOLDER}/{_HEADER}", _header())]
    unit = cindex.Index.create().parse("program.cl", args=options, unsaved_files=files)
    errors = [each for each in unit.diagnostics if each.severity >= cindex.Diagnostic.Error]
    if errors:
        raise InputError(
            f"random rounding: line {errors[0].location.line}: expected OpenCL C, found: {errors[0].spelling}"
        )
    edits = _Edits(text)
    for each in unit.cursor.get_children():
        if _is_own_function(each):
            edits.visit_function(each)
    return edits.applied(), edits.count


@cache
def random_rounding(source: str, options: tuple[str, ...]) -> str:
    """Return the source of a program whose operations round at random (`programs.rewriting`)."""
    text, _ = rewritten(preprocessed(source, options))
    functions = programs.flatten(("random_rounding.clh",))
    return f"#pragma OPENCL FP_CONTRACT OFF\n{functions}{text}"


_RUN = "rounding_run"  # the parameter that functions hand on


def _is_own_function(cursor: Any) -> bool:
    """Whether this is a function of the text, which defines it, not one of OpenCL's."""
    return cursor.kind.name == "FUNCTION_DECL" and cursor.get_definition() is not None


def _type(cursor: Any) -> str:
    name: str = cursor.type.get_canonical().spelling
    return name.removeprefix("const ")


def _kind(cursor: Any) -> str:
    """Return `float`, `float4` and the like for an expression of float32, else an empty string."""
    name = _type(cursor)
    vector = _VECTOR.fullmatch(name)
    return f"float{vector[1]}" if vector else name if name == "float" else ""


class _Edits:
    """Changes of a text, gathered while its expressions are visited. count: of operations."""

    def __init__(self, text: str) -> None:
        from clang.cindex import CursorKind

        self._text = text.encode()
        self._kinds = CursorKind
        # Where it begins and ends, whether it opens an expression, and what comes there.
        self._changes: list[tuple[int, int, bool, bytes]] = []
        self.count = 0
        self._moves = False  # whether operations of the function that is visited do
        self._lines = [(match.start(), match[1].decode()) for match in _LINE.finditer(self._text)]

    def file_at(self, offset: int) -> str:
        """Return the kernel file that holds the text's byte `offset`."""
        at = bisect.bisect_right(self._lines, (offset, "\U0010ffff")) - 1
        return self._lines[at][1] if at >= 0 else ""

    def _put(self, start: int, end: int, text: str) -> None:
        self._changes.append((start, end, True, text.encode()))

    def applied(self) -> str:
        """Return the changed text. At one place ends of expressions come first, inner ones before outer ones, then
        beginnings, outer ones before inner ones: the order in which `visit` finds them."""
        parts, at = [], 0
        for start, end, _, new in sorted(self._changes, key=lambda change: (change[0], change[2])):
            parts += [self._text[at:start], new]
            at = end
        return b"".join([*parts, self._text[at:]]).decode()

    def visit_function(self, function: Any) -> None:
        """Gather the changes of a function: it hands on the run, and its operations move unless it is exempt."""
        name = function.spelling
        self._moves = name not in exempt.FUNCTIONS and self.file_at(function.location.offset) not in exempt.FILES
        body = next((each for each in function.get_children() if each.kind == self._kinds.COMPOUND_STMT), None)
        if re.search(rb"\b(?:__)?kernel\b", self._text[function.extent.start.offset : function.location.offset]):
            if body is not None:
                first = body.extent.start.offset + 1
                self._put(first, first, f" const uint {_RUN} = RUN_OF_ITEM;")
        else:
            has_some = any(each.kind == self._kinds.PARM_DECL for each in function.get_children())
            self._put_first(function.location.offset + len(name), f"const uint {_RUN}", has_some)
        if body is not None:
            self.visit(body)

    def _put_first(self, after: int, text: str, others: bool) -> None:
        """Put a first parameter or argument into the list that opens next; others: whether there are more."""
        start = self._text.index(b"(", after) + 1
        self._put(start, start, text + (", " if others else ""))

    def visit(self, cursor: Any) -> None:
        """Gather the changes of an expression or statement and all within."""
        changed = self._open(cursor)
        for child in cursor.get_children():
            self.visit(child)
        if changed:
            end = cursor.extent.end.offset
            self._changes.append((end, end, False, b")"))

    def _open(self, cursor: Any) -> bool:
        """Make the changes of one expression before its parts. Returns whether it becomes a call, which has to be closed."""
        kinds, children = self._kinds, list(cursor.get_children())
        if cursor.kind == kinds.CALL_EXPR and cursor.referenced is not None and _is_own_function(cursor.referenced):
            self._put_first(children[0].extent.end.offset, _RUN, len(children) > 1)
            return False
        if not self._moves:
            return False
        if cursor.kind == kinds.BINARY_OPERATOR and _kind(cursor):
            return self._binary(cursor, *children)
        if cursor.kind == kinds.COMPOUND_ASSIGNMENT_OPERATOR and _kind(cursor):
            return self._compound(cursor, *children)
        if cursor.kind == kinds.CALL_EXPR and cursor.spelling in _CALLS and _kind(cursor):
            self._put(cursor.extent.start.offset, children[1].extent.start.offset, self._call(_CALLS[cursor.spelling]))
            return False
        if cursor.kind == kinds.CALL_EXPR and cursor.spelling in _OTHERS and _kind(cursor):
            raise InputError(f"random rounding: expected fma or sqrt, found {cursor.spelling}")
        if cursor.kind == kinds.CSTYLE_CAST_EXPR and _kind(cursor) == "float":
            return self._convert(cursor, children[-1])
        return False

    def _call(self, name: str) -> str:
        """Return the beginning of the next operation's call."""
        self.count += 1
        return f"{name}({_RUN}, {self.count}u, "

    def _convert(self, cursor: Any, operand: Any) -> bool:
        changes = _type(operand) in _WIDER and not self._constant(operand)
        if changes:
            self._put(cursor.extent.start.offset, operand.extent.start.offset, self._call("random_real"))
        return changes

    def _constant(self, cursor: Any) -> bool:
        """Whether an expression names no variable and no function: the compiler computes it."""
        return all(each.kind != self._kinds.DECL_REF_EXPR for each in cursor.walk_preorder())

    def _operator(self, left: Any, right: Any) -> tuple[int, int, str]:
        """Return where the operator between two expressions begins and ends, and its text."""
        start, end = left.extent.end.offset, right.extent.start.offset
        return start, end, self._text[start:end].decode().strip()

    def _binary(self, cursor: Any, left: Any, right: Any) -> bool:
        start, end, operator = self._operator(left, right)
        if operator not in _NAMES or self._constant(cursor):
            return False
        self._put(cursor.extent.start.offset, cursor.extent.start.offset, self._call(_NAMES[operator]))
        self._put(start, end, ", ")
        return True

    def _compound(self, cursor: Any, left: Any, right: Any) -> bool:
        start, end, operator = self._operator(left, right)
        if not _kind(right):
            raise InputError(f"random rounding: {operator}: expected an operand of float32, found {_type(right)}")
        target = self._text[left.extent.start.offset : left.extent.end.offset].decode()
        if re.search(r"\(|\+\+|--", target):
            raise InputError(f"random rounding: {target} {operator}: expected a target that can be named twice")
        self._put(start, end, f" = {self._call(_NAMES[operator[:-1]])}{target}, ")
        return True
