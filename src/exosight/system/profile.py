"""The radius of a rod along its length: a number, a formula of X, or a table of points."""

import ast
import operator
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.interpolate import PchipInterpolator

LARGEST_FORMULA = 200
"""Characters of a formula."""

CLOSEST = 1e-6
"""Between the places X of neighbouring points."""

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
_FUNCTIONS: Mapping[str, tuple[Callable[..., Any], int]] = MappingProxyType(
    {
        "sin": (np.sin, 1),
        "cos": (np.cos, 1),
        "tan": (np.tan, 1),
        "exp": (np.exp, 1),
        "log": (np.log, 1),
        "sqrt": (np.sqrt, 1),
        "abs": (lambda x: np.where(np.real(x) < 0, -x, x), 1),  # NumPy's is real where x is complex
        "minimum": (np.minimum, 2),
        "maximum": (np.maximum, 2),
    }
)
"""Functions of a formula, and how many arguments they take; all take complex numbers."""

_STEP = 1e-100
"""Of the complex step derivative; so small that its square is lost beside anything."""


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

    Its slope is Im f(X + ih) / h with a tiny h, exact to round-off: Squire and Trapp, doi
    10.1137/S003614459631241X. Where a formula has no value or no slope, these are not finite or very large.

    Raises ValueError for what is no such formula.
    """
    tree = _parsed(text)

    def at(x: np.ndarray) -> np.ndarray:
        with np.errstate(all="ignore"):  # sizes and slopes are checked where they are used
            return np.broadcast_to(_evaluate(tree, x), x.shape)

    return Profile(lambda x: unit * at(x), lambda x: unit * np.imag(at(x + 1j * _STEP)) / _STEP)


def from_points(x: Points, radius: Points) -> Profile:
    """A smooth curve through points that keeps their rises and falls (piecewise cubic, Fritsch and Carlson).

    x        (points,)   ascending, from 0 to 1
    radius   (points,)   [m]

    Raises ValueError for fewer than two points, or places that do not rise from 0 to 1.
    """
    if len(x) < 2 or x[0] != 0 or x[-1] != 1:
        raise ValueError("expected at least two points, the first at X = 0 and the last at X = 1")
    closest = int(np.argmin(np.diff(x)))
    if not x[closest + 1] - x[closest] >= CLOSEST:
        raise ValueError(
            f"expected X to rise by at least {CLOSEST:g} from point to point, got {x[closest]:g} and then "
            f"{x[closest + 1]:g}"
        )
    curve = PchipInterpolator(x, radius)
    return Profile(curve, curve.derivative())


def _parsed(text: str) -> ast.expr:
    if len(text) > LARGEST_FORMULA:
        raise ValueError(f"expected a formula of at most {LARGEST_FORMULA} characters, got {len(text)}")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Python's on what the check below refuses, such as "1if"
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
        case ast.Call(func=ast.Name(id=name), args=args, keywords=[]) if name in _FUNCTIONS and (
            _FUNCTIONS[name][1] == len(args)
        ):
            for argument in args:
                _check(argument)
        case _:
            raise ValueError(
                f"expected numbers, X, pi, + - * / ** (power) and {', '.join(_FUNCTIONS)}, got "
                f"{ast.unparse(node)[:40]!r}"
            )


def _evaluate(node: ast.expr, x: Any) -> Any:
    match node:
        case ast.Constant(value=int() | float() as value):
            # NumPy's number: Python's own powers of whole numbers would grow without end.
            return np.float64(min(value, 1e308))
        case ast.Name(id="pi"):
            return np.float64(np.pi)
        case ast.Name():
            return x
        case ast.UnaryOp(op=op, operand=operand):
            return _OPERATORS[type(op)](_evaluate(operand, x))
        case ast.BinOp(left=left, op=op, right=right):
            return _OPERATORS[type(op)](_evaluate(left, x), _evaluate(right, x))
        case ast.Call(func=ast.Name(id=name), args=args):
            return _FUNCTIONS[name][0](*(_evaluate(argument, x) for argument in args))
    raise AssertionError(node)
