"""Formulas in x, y, z, t by a closed arithmetic grammar; nothing else can be named or called.

comparison  := sum [("<" | "<=" | ">" | ">=") sum]          1 where true, else 0
sum         := product {("+" | "-") product}
product     := unary {("*" | "/") unary}
unary       := ("+" | "-") unary | power
power       := atom [("^" | "**") unary]
atom        := number | name | function "(" comparison {"," comparison} ")" | "(" comparison ")"
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..._types import Floats
from .shown import cut, shown

VARIABLES = ("x", "y", "z", "t")
CONSTANTS = {"pi": np.pi, "e": np.e}
FUNCTIONS: dict[str, tuple[int, Callable[..., Any]]] = {
    **{
        name: (1, getattr(np, name))
        for name in ("sin", "cos", "tan", "exp", "log", "sqrt", "tanh", "sinh", "cosh", "abs")
    },
    "step": (1, lambda s: np.where(np.asarray(s) >= 0.0, 1.0, 0.0)),
    "min": (2, np.minimum),
    "max": (2, np.maximum),
}
_OPERATORS: dict[str, Callable[..., Any]] = {
    "+": np.add,
    "-": np.subtract,
    "*": np.multiply,
    "/": np.divide,
    "^": np.power,
    "**": np.power,
    "<": lambda a, b: np.where(np.less(a, b), 1.0, 0.0),
    "<=": lambda a, b: np.where(np.less_equal(a, b), 1.0, 0.0),
    ">": lambda a, b: np.where(np.greater(a, b), 1.0, 0.0),
    ">=": lambda a, b: np.where(np.greater_equal(a, b), 1.0, 0.0),
}
_TOKEN = re.compile(
    r"\s*(?:(\d+\.?\d*(?:[eE][+-]?\d+)?|\.\d+(?:[eE][+-]?\d+)?)|([A-Za-z_]\w*)|(\*\*|<=|>=|[-+*/^(),<>]))"
)
_LONGEST = 2000
_DEEPEST = 50

Program = tuple[tuple[str, Any], ...]


class FormulaError(ValueError):
    """A formula that the grammar does not know."""


@dataclass(frozen=True)
class Formula:
    """A number that may depend on place and time.

    Raises :class:`FormulaError` with the formula and the place where it goes wrong.

    >>> Formula("2*x + step(t - 1)")(np.array([[1.0, 3.0]]), t=2.0).tolist()
    [3.0, 7.0]
    >>> Formula("open(x)")                                          # doctest: +ELLIPSIS
    Traceback (most recent call last):
    ...
    skfem_peridynamics.app.scene.formula.FormulaError: formula "open(x)": 'open' is not a name it knows ...
    """

    text: str | float
    program: Program = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "program", _Parser(str(self.text)).parse())

    def uses(self, *names: str) -> bool:
        """Return whether the formula depends on any of these variables."""
        return any(kind == "variable" and operand in names for kind, operand in self.program)

    def __call__(self, x: Floats, t: float = 0.0) -> Floats:
        """Evaluate at points (dim, n) and one time, (n,). Raises ``FormulaError`` where that is not finite."""
        values: dict[str, Any] = dict(zip(VARIABLES, x, strict=False)) | {"t": t}
        stack: list[Any] = []
        with np.errstate(all="ignore"):
            for kind, operand in self.program:
                if kind == "number":
                    stack.append(operand)
                elif kind == "variable":
                    if operand not in values:
                        raise FormulaError(
                            f"formula {shown(self.text)} uses {operand}, but the body has {len(x)} dimensions"
                        )
                    stack.append(values[operand])
                else:
                    count, apply = operand
                    arguments = stack[-count:]
                    del stack[-count:]
                    stack.append(apply(*arguments))
        out = np.broadcast_to(np.asarray(stack[0], dtype=float), x.shape[1:])
        bad = np.flatnonzero(~np.isfinite(out))
        if len(bad):
            where = ", ".join(f"{name} = {c:.6g}" for name, c in zip(VARIABLES, x[:, bad[0]], strict=False))
            raise FormulaError(f"formula {shown(self.text)} is {out[bad[0]]} at {where}, t = {t:.6g}")
        return out


class _Parser:
    """Recursive descent into a program for a stack."""

    def __init__(self, text: str) -> None:
        self.text = text
        if len(text) > _LONGEST:
            raise FormulaError(f"formula of {len(text)} characters is longer than {_LONGEST}: {text[:40]!r}...")
        self.tokens: list[tuple[str, str]] = []
        at = 0
        while text[at:].strip():
            match = _TOKEN.match(text, at)
            if match is None:
                raise self.error(f"{text[at:].strip()[0]!r} is not part of arithmetic")
            number, name, sign = match.groups()
            self.tokens.append(("number", number) if number else ("name", name) if name else ("sign", sign))
            at = match.end()
        self.place = 0
        self.depth = 0
        self.out: list[tuple[str, Any]] = []

    def error(self, why: str) -> FormulaError:
        return FormulaError(f'formula "{cut(self.text)}": {why}')

    def parse(self) -> Program:
        if not self.tokens:
            raise self.error("is empty")
        self.check_names()
        self.comparison()
        if self.place < len(self.tokens):
            raise self.error(f"{shown(self.tokens[self.place][1])} was not expected there")
        return tuple(self.out)

    def check_names(self) -> None:
        for kind, name in self.tokens:
            if kind == "name" and name not in VARIABLES and name not in CONSTANTS and name not in FUNCTIONS:
                known = ", ".join([*VARIABLES, *CONSTANTS, *FUNCTIONS])
                raise self.error(f"{shown(name)} is not a name it knows (those are {known})")

    def sees(self, *signs: str) -> str | None:
        kind, text = self.tokens[self.place] if self.place < len(self.tokens) else ("end", "")
        return text if kind == "sign" and text in signs else None

    def takes(self, *signs: str) -> str | None:
        sign = self.sees(*signs)
        self.place += sign is not None
        return sign

    def needs(self, sign: str) -> None:
        if self.takes(sign) is None:
            token = shown(self.tokens[self.place][1]) if self.place < len(self.tokens) else "the end"
            raise self.error(f"{sign!r} was expected, not {token}")

    def left(self, operand: Callable[[], None], signs: tuple[str, ...], once: bool = False) -> None:
        operand()
        while (sign := self.takes(*signs)) is not None:
            operand()
            self.out.append(("call", (2, _OPERATORS[sign])))
            if once:
                return

    def comparison(self) -> None:
        self.depth += 1
        if self.depth > _DEEPEST:
            raise self.error(f"is nested deeper than {_DEEPEST} levels")
        self.left(self.sum, ("<", "<=", ">", ">="), once=True)
        self.depth -= 1

    def sum(self) -> None:
        self.left(self.product, ("+", "-"))

    def product(self) -> None:
        self.left(self.unary, ("*", "/"))

    def unary(self) -> None:
        self.depth += 1
        if self.depth > _DEEPEST:
            raise self.error(f"is nested deeper than {_DEEPEST} levels")
        sign = self.takes("+", "-")
        if sign is None:
            self.power()
        else:
            self.unary()
            if sign == "-":
                self.out.append(("call", (1, np.negative)))
        self.depth -= 1

    def power(self) -> None:
        self.atom()
        if self.takes("^", "**"):
            self.unary()
            self.out.append(("call", (2, np.power)))

    def atom(self) -> None:
        if self.takes("("):
            self.comparison()
            self.needs(")")
            return
        if self.place == len(self.tokens):
            raise self.error("ends too early")
        kind, text = self.tokens[self.place]
        self.place += 1
        if kind == "number":
            self.out.append(("number", float(text)))
        elif kind == "name" and text in FUNCTIONS:
            self.call(text)
        elif kind == "name":
            self.out.append(("number", CONSTANTS[text]) if text in CONSTANTS else ("variable", text))
        else:
            raise self.error(f"{shown(text)} was not expected there")

    def call(self, name: str) -> None:
        count, apply = FUNCTIONS[name]
        self.needs("(")
        for k in range(count):
            if k:
                self.needs(",")
            self.comparison()
        self.needs(")")
        self.out.append(("call", (count, apply)))
