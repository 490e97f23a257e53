"""The radius of a rod along its length: a number, a formula of X, or a table of points."""

import ast
import operator
from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.interpolate import PchipInterpolator

LARGEST_FORMULA = 200
"""Characters of a formula."""

Points = Float[np.ndarray, " points"]

_OPERATORS = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
}
_FUNCTIONS = {
    "sin": 1,
    "cos": 1,
    "tan": 1,
    "exp": 1,
    "log": 1,
    "sqrt": 1,
    "abs": 1,
    "minimum": 2,
    "maximum": 2,
}
"""Functions of a formula, and how many arguments they take."""


@dataclass(frozen=True)
class Profile:
    """A radius along a rod.

    value   X in [0, 1] → radius [m]
    slope   X in [0, 1] → its derivative by X [m]
    """

    value: Callable[[Points], Points]
    slope: Callable[[Points], Points]


def from_formula(text: str, unit: float) -> Profile:
    """A formula of X, such as "5.8 - 1.8*X + 0.2*sin(3*pi*X)", in the given unit [m].

    Raises ValueError for what is no such formula.
    """
    tree = _parsed(text)

    def slope(x: Points) -> Points:
        derivative = jax.vmap(jax.grad(lambda at: jnp.asarray(_evaluate(tree, at, jnp), float)))
        return unit * np.asarray(derivative(jnp.asarray(x, float)))

    def value(x: Points) -> Points:
        with np.errstate(all="ignore"):  # the radii are checked where they are used
            return unit * np.broadcast_to(np.asarray(_evaluate(tree, x, np), float), x.shape)

    return Profile(value, slope)


def from_points(x: Points, radius: Points) -> Profile:
    """A smooth curve through points that keeps their rises and falls (piecewise cubic, Fritsch and Carlson).

    x        (points,)   ascending, from 0 to 1
    radius   (points,)   [m]

    Raises ValueError for fewer than two points, or places that do not rise from 0 to 1.
    """
    if len(x) < 2 or x[0] != 0 or x[-1] != 1 or not np.all(np.diff(x) > 0):
        raise ValueError("expected at least two points, with X rising from 0 to 1")
    curve = PchipInterpolator(x, radius)
    return Profile(curve, curve.derivative())


def _parsed(text: str) -> ast.expr:
    if len(text) > LARGEST_FORMULA:
        raise ValueError(f"expected a formula of at most {LARGEST_FORMULA} characters, got {len(text)}")
    try:
        tree = ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError, MemoryError, RecursionError):
        raise ValueError(f"expected a formula of X, like '5.8 - 1.8*X', got {text!r}") from None
    _check(tree)
    return tree


def _check(node: ast.AST) -> None:
    """ValueError unless only numbers, X, pi, operators and known functions stand in the formula."""
    match node:
        case ast.Constant(value=int() | float()) if not isinstance(node.value, bool):
            return
        case ast.Name(id="X" | "pi"):
            return
        case ast.UnaryOp(op=op, operand=operand) if type(op) in _OPERATORS:
            _check(operand)
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATORS:
            _check(left)
            _check(right)
        case ast.Call(func=ast.Name(id=name), args=args, keywords=[]) if _FUNCTIONS.get(name) == len(args):
            for argument in args:
                _check(argument)
        case _:
            raise ValueError(
                f"expected numbers, X, pi, + - * / ** and {', '.join(_FUNCTIONS)}, got {ast.unparse(node)[:40]!r}"
            )


def _evaluate(node: ast.expr, x: Any, library: ModuleType) -> Any:
    match node:
        case ast.Constant(value=value):
            # NumPy's number: Python's own powers of whole numbers would grow without end.
            return np.float64(min(abs(value), 1e308)) * (1 if value >= 0 else -1)
        case ast.Name(id="pi"):
            return np.float64(np.pi)
        case ast.Name():
            return x
        case ast.UnaryOp(op=op, operand=operand):
            return _OPERATORS[type(op)](_evaluate(operand, x, library))
        case ast.BinOp(left=left, op=op, right=right):
            return _OPERATORS[type(op)](_evaluate(left, x, library), _evaluate(right, x, library))
        case ast.Call(func=ast.Name(id=name), args=args):
            return getattr(library, name)(*(_evaluate(argument, x, library) for argument in args))
    raise AssertionError(node)
