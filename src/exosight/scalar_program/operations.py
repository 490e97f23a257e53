"""Operations on single numbers: their names, and how numbers that are known beforehand are folded."""

from enum import IntEnum

import numpy as np


class Op(IntEnum):
    """An operation of the interpreter; comparisons give 1.0 or 0.0.

    DIFFERENCE is a b − c d. TWO_DOTS and THREE_DOTS are sums of products, with a factor in common in each of
    their terms. SKIP leaves out the code of a block unless a number is not zero in one of the samples.
    """

    ADD = 0
    SUB = 1
    MUL = 2
    DIV = 3
    MAX = 4
    MIN = 5
    LT = 6
    LE = 7
    GT = 8
    GE = 9
    EQ = 10
    NE = 11
    AND = 12
    OR = 13
    NEG = 14
    NOT = 15
    ABS = 16
    SQRT = 17
    SELECT = 18
    MULTIPLY_ADD = 19
    NEGATIVE_MULTIPLY_ADD = 20
    DOT = 21
    SIN = 22
    COS = 23
    TAN = 24
    ASIN = 25
    ACOS = 26
    ATAN = 27
    SINH = 28
    COSH = 29
    TANH = 30
    EXP = 31
    LOG = 32
    EXPM1 = 33
    LOG1P = 34
    POW = 35
    ATAN2 = 36
    CBRT = 37
    LOOKUP = 38
    TRUNC = 39
    SKIP = 40
    DIFFERENCE = 41
    TWO_DOTS = 42
    THREE_DOTS = 43
    CONSTANT = -1
    INPUT = -2


DOTS = {Op.DOT: 1, Op.TWO_DOTS: 2, Op.THREE_DOTS: 3}
"""Sums of products, and how many of them an operation makes."""

LIBRARY = {
    Op.SIN: "sin",
    Op.COS: "cos",
    Op.TAN: "tan",
    Op.ASIN: "asin",
    Op.ACOS: "acos",
    Op.ATAN: "atan",
    Op.SINH: "sinh",
    Op.COSH: "cosh",
    Op.TANH: "tanh",
    Op.EXP: "exp",
    Op.LOG: "log",
    Op.EXPM1: "expm1",
    Op.LOG1P: "log1p",
    Op.CBRT: "cbrt",
    Op.POW: "pow",
    Op.ATAN2: "atan2",
}
"""Functions of the C library, by their names there."""

FOLD = {
    Op.DIV: np.divide,
    Op.MAX: np.maximum,
    Op.MIN: np.minimum,
    Op.LT: np.less,
    Op.LE: np.less_equal,
    Op.GT: np.greater,
    Op.GE: np.greater_equal,
    Op.EQ: np.equal,
    Op.NE: np.not_equal,
    Op.AND: np.logical_and,
    Op.OR: np.logical_or,
    Op.NOT: np.logical_not,
    Op.ABS: np.abs,
    Op.SQRT: np.sqrt,
    Op.TRUNC: np.trunc,
    Op.SIN: np.sin,
    Op.COS: np.cos,
    Op.TAN: np.tan,
    Op.ASIN: np.arcsin,
    Op.ACOS: np.arccos,
    Op.ATAN: np.arctan,
    Op.SINH: np.sinh,
    Op.COSH: np.cosh,
    Op.TANH: np.tanh,
    Op.EXP: np.exp,
    Op.LOG: np.log,
    Op.EXPM1: np.expm1,
    Op.LOG1P: np.log1p,
    Op.CBRT: np.cbrt,
    Op.POW: np.power,
    Op.ATAN2: np.arctan2,
}
"""What operations give on numbers that are known beforehand."""
