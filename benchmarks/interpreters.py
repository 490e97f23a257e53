"""One scalar program, run in several ways: `python -m benchmarks.interpreters`, one minute.

Energy, gradient and Hessian of the published exosuit, traced once to a graph of operations on single numbers.
That graph is run by exosight's interpreter with the vector registers of several generations of processors
(narrower ones than this machine's are emulated by leaving out its instructions), by CasADi's interpreter of
the same graph, and the function itself by XLA. Writes docs/results/interpreters.json.
"""

import json
import operator
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest import mock

import casadi
import jax
import jax.numpy as jnp
import llvmlite.binding as llvm
import numpy as np
from jaxtyping import Array, Float

from benchmarks.timing import in_turns, largest_difference
from exosight.app.bench import cpu_name
from exosight.exosuit.assembly import Exosuit, assemble
from exosight.mechanics import drive, potential
from exosight.scalar_program import interpreter, unroll
from exosight.scalar_program.graph import Graph
from exosight.scalar_program.operations import Op
from exosight.scalar_program.tracing import values_of

RESULT = Path(__file__).parents[1] / "docs" / "results" / "interpreters.json"

SAMPLES = 64
"""Poses at a time: eight vectors of lanes for us, a map over samples for CasADi."""

PROCESSORS = {
    "AVX-512": ("x86-64-v4", "", {"avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"}),
    "AVX2 with fused multiply-add": ("x86-64-v3", "", {"avx2", "fma", "bmi2"}),
    "AVX": ("x86-64", "+avx", {"avx"}),
    "no AVX (SSE2)": ("x86-64", "", set()),
}
"""LLVM's processor and features, and what /proc/cpuinfo calls what they need."""

ROBOT = assemble(Exosuit())


def evaluate(at: tuple[Array, Array]) -> list[Array]:
    """Energy and derivatives of the exosuit at coordinates and loads."""
    return jax.tree.leaves(potential(ROBOT)(*at)[0])


CASADI: dict[Op, Callable[..., Any]] = {
    Op.ADD: operator.add,
    Op.SUB: operator.sub,
    Op.MUL: operator.mul,
    Op.DIV: operator.truediv,
    Op.NEG: operator.neg,
    Op.MAX: casadi.fmax,
    Op.MIN: casadi.fmin,
    Op.LT: operator.lt,
    Op.LE: operator.le,
    Op.GT: operator.gt,
    Op.GE: operator.ge,
    Op.EQ: operator.eq,
    Op.NE: operator.ne,
    Op.AND: casadi.logic_and,
    Op.OR: casadi.logic_or,
    Op.NOT: casadi.logic_not,
    Op.ABS: casadi.fabs,
    Op.SQRT: casadi.sqrt,
    Op.SIN: casadi.sin,
    Op.COS: casadi.cos,
    Op.SELECT: casadi.if_else,
}
"""Of our operations, CasADi's: those that this graph holds."""


def by_casadi(q: Float[np.ndarray, " dofs"], loads: Float[np.ndarray, " channels"]) -> casadi.Function:
    """The graph of `evaluate` as a function of CasADi's, coordinates and loads in one column."""
    graph = Graph()
    jaxpr = jax.make_jaxpr(lambda q, loads: evaluate((q, loads)))(q, loads)
    inputs = [np.array(graph.inputs(x.size), dtype=np.int64) for x in (q, loads)]
    results = np.concatenate([np.ravel(x) for x in values_of(graph, jaxpr, inputs)])
    needed = np.zeros(len(graph.op), bool)
    needed[results] = True
    for i in reversed(range(len(graph.op))):
        if needed[i] and graph.args[i]:
            needed[list(graph.args[i])] = True
    given = casadi.SX.sym("given", q.size + loads.size)
    values: dict[int, Any] = {int(i): given[at] for at, i in enumerate(np.concatenate(inputs))}
    for i in np.flatnonzero(needed).tolist():
        if graph.op[i] == Op.CONSTANT:
            values[i] = casadi.SX(graph.known[i])
        elif graph.op[i] == Op.DOT:
            factors = [values[a] for a in graph.args[i]]
            values[i] = sum(x * y for x, y in zip(factors[2::2], factors[3::2], strict=True)) + (
                factors[0] * factors[1]
            )
        elif graph.op[i] != Op.INPUT:
            values[i] = CASADI[Op(graph.op[i])](*(values[a] for a in graph.args[i]))
    return casadi.Function("evaluate", [given], [casadi.vertcat(*(values[i] for i in results.tolist()))])


def ours(q: Array, loads: Array, targets: dict[int, str] = interpreter.TARGETS) -> Callable[[], np.ndarray]:
    """Our program of it, by the interpreter known under these names; results (samples, numbers)."""
    program = unroll(lambda at: (evaluate(at),), [(q[0], loads[0])])

    def of_one(q: Array, loads: Array) -> Array:
        return jnp.concatenate([jnp.ravel(x) for x in program(0, None, (q, loads))[0]])

    with mock.patch.object(interpreter, "TARGETS", targets):
        compiled = jax.jit(jax.vmap(of_one)).lower(q, loads).compile()
    return lambda: jax.block_until_ready(compiled(q, loads))


def by_xla(q: Array, loads: Array) -> Callable[[], np.ndarray]:
    """The function itself, compiled by XLA."""

    def of_one(q: Array, loads: Array) -> Array:
        return jnp.concatenate([jnp.ravel(x) for x in evaluate((q, loads))])

    options = {"xla_cpu_multi_thread_eigen": False}
    compiled = jax.jit(jax.vmap(of_one), compiler_options=options).lower(q, loads).compile()
    return lambda: jax.block_until_ready(compiled(q, loads))


def poses() -> tuple[Array, Array]:
    """Coordinates and loads on the paper's path, a tenth off the equilibria."""
    loads = np.linspace(0, 4, SAMPLES + 1)[1:, None]
    return jnp.asarray(0.9 * np.asarray(drive([ROBOT], loads).q)[0]), jnp.asarray(loads)


def vectors(q: Array, loads: Array) -> dict[str, Callable[[], np.ndarray]]:
    """Our interpreter for each kind of processor whose instructions this one has."""
    has = {name for name, on in llvm.get_host_cpu_features().items() if on}
    found = {}
    for name, (processor, features, needed) in PROCESSORS.items():
        if needed <= has:
            targets = {bits: f"exosight_{name.split()[0]}_{bits}" for bits in interpreter.TARGETS}
            interpreter.register(processor, features, targets)
            found[f"exosight, {name}"] = ours(q, loads, targets)
        else:
            print(f"{name}: left out, this processor lacks {', '.join(sorted(needed - has))}")
    return found


def main() -> None:
    """Check that all give the same, time them in turns, write."""
    q, loads = poses()
    function = by_casadi(np.asarray(q[0]), np.asarray(loads[0]))
    mapped, columns = function.map(SAMPLES), np.concatenate([q, loads], axis=1).T
    single = ours(q[:1], loads[:1])
    buffer, call = function.buffer()
    given, result = np.ascontiguousarray(columns[:, 0]), np.zeros(function.size1_out(0))
    buffer.set_arg(0, memoryview(given))
    buffer.set_res(0, memoryview(result))
    runs: dict[str, Callable[[], Any]] = {
        "exosight, this processor": ours(q, loads),
        **vectors(q, loads),
        "XLA": by_xla(q, loads),
        "CasADi, mapped over poses": lambda: mapped(columns),
    }
    alone = {"exosight, one pose": single, "CasADi, one pose": lambda: (call(), result)[1]}
    expected = np.asarray(runs["XLA"]())
    rows = []
    spent = in_turns(runs | alone)
    for name, run in (runs | alone).items():
        one, seconds = name in alone, spent[name] / (1 if name in alone else SAMPLES)
        found = np.asarray(run()).T if name.startswith("CasADi, mapped") else np.asarray(run())
        found, there = (np.atleast_2d(found), expected[:1]) if one else (found, expected)
        parts = np.cumsum([np.size(x) for x in evaluate((q[0], loads[0]))])[:-1]
        split = [np.split(each, parts, axis=1) for each in (found, there)]
        base = spent["exosight, one pose"] if one else spent["exosight, this processor"] / SAMPLES
        rows.append(
            {"way": name, "evaluation [us]": 1e6 * seconds, "ratio": seconds / base}
            | {"difference": largest_difference(*split)}
        )
        print(json.dumps(rows[-1]), flush=True)
    result_of_all = {
        "cpu": cpu_name(),
        "casadi": casadi.__version__,
        "instructions of CasADi": function.n_instructions(),
        "rows": rows,
    }
    RESULT.write_text(json.dumps(result_of_all, indent=1) + "\n")


if __name__ == "__main__":
    main()
