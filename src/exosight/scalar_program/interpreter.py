"""The interpreter: runs a program over eight samples at once, in vector registers, called by XLA.

It is a loop of a few hundred instructions, made by LLVM (through llvmlite, which comes with Numba) for the
processor at hand within a second: no compiler is needed, and no binary is shipped. XLA calls it
through its foreign function interface (`xla_call`), so the programs run inside compiled loops, without
Python's lock.
"""

import ctypes
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

import jax
import llvmlite
import llvmlite.binding as llvm
from llvmlite import ir

from exosight.scalar_program.cache import kept_bytes, source_hash
from exosight.scalar_program.machine_code import DOUBLE, LONG, WORD, Builder, Value, loop, variable
from exosight.scalar_program.operations import DOTS, LIBRARY, Op
from exosight.scalar_program.xla_call import define_call

LANES = 8
"""Samples side by side: one vector register of AVX-512, two of AVX2, four of SSE or NEON. A single sample has
no others to wait for, and moves an eighth of the memory."""

COMPARE = {Op.LT: "<", Op.LE: "<=", Op.GT: ">", Op.GE: ">=", Op.EQ: "==", Op.NE: "!="}

INTRINSIC = {Op.ABS: "fabs", Op.SQRT: "sqrt", Op.TRUNC: "trunc"}
"""Functions that LLVM has for vectors, by their names there."""

TARGETS = {16: "exosight_scalar_program_16", 32: "exosight_scalar_program_32"}
"""Names under which XLA knows the interpreter, by the bits of a word of code."""


@cache
def obstacle() -> str:
    """Why there is no interpreter on this machine; empty where LLVM makes it and XLA takes it."""
    try:
        llvm.initialize_native_target()
        llvm.initialize_native_asmprinter()
        register(llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten())
    except Exception as error:  # whatever stands in its way, XLA can do the same work
        return (str(error).splitlines() or [type(error).__name__])[0]
    return ""


def register(processor: str, features: str, targets: Mapping[int, str] = TARGETS) -> None:
    """Make the interpreter for a processor (LLVM's names), known to XLA under the names of targets."""
    engine = _engine(processor, features, targets)
    for name in targets.values():
        address = engine.get_function_address(name)
        jax.ffi.register_ffi_target(name, jax.ffi.pycapsule(ctypes.c_void_p(address)), platform="cpu")
    _ENGINES.append(engine)  # the code lives as long as this


_ENGINES: list[Any] = []


def _engine(processor: str, features: str, targets: Mapping[int, str]) -> Any:
    """What holds the machine code; it is kept on disk, as making it takes a second."""
    machine = llvm.Target.from_default_triple().create_target_machine(
        cpu=processor, features=features, opt=2, jit=True
    )
    made_for = "\n".join((llvmlite.__version__, machine.triple, processor, features, str(targets)))
    code = kept_bytes(f"{source_hash(made_for.encode())}.o", lambda: _machine_code(machine, targets))
    library = ctypes.CDLL(None)
    for name in LIBRARY.values():
        llvm.add_symbol(name, ctypes.cast(getattr(library, name), ctypes.c_void_p).value)
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine)
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    return engine


def _machine_code(machine: Any, targets: Mapping[int, str]) -> bytes:
    module = ir.Module("scalar_program")
    module.triple, module.data_layout = machine.triple, str(machine.target_data)
    for bits, name in targets.items():
        word = ir.IntType(bits)
        define_call(module, name, _run(module, word, 1), _run(module, word, LANES))
    parsed = llvm.parse_assembly(str(module))
    parsed.verify()
    # More, or unrolled loops, take LLVM three times as long and make programs no faster.
    options = llvm.create_pipeline_tuning_options(speed_level=1)
    options.loop_unrolling = False
    llvm.create_pass_builder(machine, options).getModulePassManager().run(
        parsed, llvm.create_pass_builder(machine, options)
    )
    return machine.emit_object(parsed)


def _run(module: ir.Module, word: ir.IntType, lanes: int) -> Value:
    """The function (code, end of code, slots) that runs a program once, on slots of so many lanes."""
    slot = ir.VectorType(DOUBLE, lanes)
    kind = ir.FunctionType(ir.VoidType(), [word.as_pointer(), word.as_pointer(), slot.as_pointer()])
    function = ir.Function(module, kind, f"run_{word.width}_{lanes}")
    function.linkage = "internal"
    code, end, slots = function.args
    b: Builder = ir.IRBuilder(function.append_basic_block("entry"))
    place = variable(b, word.as_pointer())
    b.store(code, place)
    head, body, done = (b.append_basic_block(name) for name in ("next", "run", "end"))
    b.branch(head)
    b.position_at_end(head)
    b.cbranch(b.icmp_unsigned("<", b.load(place), end), body, done)
    b.position_at_end(done)
    b.ret_void()
    b.position_at_end(body)

    operation, count = _take(b, place), _take(b, place)
    unknown = b.append_basic_block("unknown")
    switch = b.switch(operation, unknown)
    b.position_at_end(unknown)
    b.unreachable()
    for op in Op:
        if op < 0:
            continue
        block = b.append_basic_block(op.name)
        switch.add_case(LONG(int(op)), block)
        b.position_at_end(block)
        if op == Op.SKIP:
            _skip(b, count, slots, place)
        else:
            _one_kind(b, op, count, slots, place)
        b.branch(head)
    return function


def _take(b: Builder, place: Value) -> Value:
    """The next word of the code."""
    here = b.load(place)
    b.store(b.gep(here, [LONG(1)]), place)
    return b.zext(b.load(here), LONG)


def _skip(b: Builder, low: Value, slots: Value, place: Value) -> None:
    """Leave out the next words of the code unless a number is not zero in one of the lanes."""
    words = b.add(low, b.shl(_take(b, place), LONG(16)))
    condition = b.load(b.gep(slots, [_take(b, place)], inbounds=True))
    lanes = condition.type.count
    holds = b.fcmp_unordered("!=", condition, ir.Constant(condition.type, [0.0] * lanes))
    one = ir.IntType(lanes)
    nowhere = b.icmp_unsigned("==", b.bitcast(holds, one), one(0))
    here = b.load(place)
    b.store(b.gep(here, [b.select(nowhere, words, LONG(0))]), place)


def _one_kind(b: Builder, op: Op, count: Value, slots: Value, place: Value) -> None:
    """A run of `count` operations of one kind, whose code begins at `place`."""

    def slot() -> Value:
        return b.gep(slots, [_take(b, place)], inbounds=True)

    def read() -> Value:
        return b.load(slot(), align=8 * vector.count)

    vector = slots.type.pointee
    terms = _take(b, place) if op in DOTS or op == Op.LOOKUP else None
    totals = [variable(b, vector) for _ in range(DOTS.get(op, 0))]
    with loop(b, count):
        into = [slot() for _ in totals or [None]]
        if op in DOTS:
            results = _sums(b, terms, totals, read)
        elif op == Op.LOOKUP:
            results = [_look_up(b, read(), slots, terms, place)]
        else:
            results = [_result(b, op, [read() for _ in range(_arity(op))])]
        for result, where in zip(results, into, strict=True):
            b.store(result, where, align=8 * vector.count)


def _sums(b: Builder, terms: Value, totals: list[Value], read: Callable[[], Value]) -> list[Value]:
    """Sums of products, whose first factors are the same: of each term that one, then the others."""
    x = read()
    for total in totals:
        b.store(b.fmul(x, read()), total)
    with loop(b, b.sub(terms, LONG(1))):
        x = read()
        for total in totals:
            b.store(_multiply_add(b, x, read(), b.load(total)), total)
    return [b.load(total) for total in totals]


def _look_up(b: Builder, index: Value, slots: Value, size: Value, place: Value) -> Value:
    """Each lane's own choice of the `size` slots that the code names next."""
    lanes = index.type.count
    table, numbers = b.load(place), b.bitcast(slots, DOUBLE.as_pointer())
    b.store(b.gep(table, [size]), place)
    zero, last = ir.Constant(DOUBLE, 0.0), b.uitofp(b.sub(size, LONG(1)), DOUBLE)
    result = ir.Constant(index.type, ir.Undefined)
    for lane in range(lanes):
        where = b.extract_element(index, WORD(lane))
        where = b.select(b.fcmp_ordered(">", where, zero), where, zero)  # what is not a number: 0
        where = b.select(b.fcmp_ordered("<", where, last), where, last)
        slot = b.zext(b.load(b.gep(table, [b.fptosi(where, LONG)])), LONG)
        value = b.load(b.gep(numbers, [b.add(b.mul(slot, LONG(lanes)), LONG(lane))]))
        result = b.insert_element(result, value, WORD(lane))
    return result


def _arity(op: Op) -> int:
    if op == Op.DIFFERENCE:
        return 4
    if op in (Op.SELECT, Op.MULTIPLY_ADD, Op.NEGATIVE_MULTIPLY_ADD):
        return 3
    one = op in LIBRARY and op not in (Op.POW, Op.ATAN2)
    return 1 if one or op in (Op.NEG, Op.NOT, *INTRINSIC) else 2


def _multiply_add(b: Builder, x: Value, y: Value, z: Value) -> Value:
    """x y + z, in one rounding where the processor has it."""
    return _call(b, f"llvm.fmuladd.v{x.type.count}f64", [x, y, z])


def _result(b: Builder, op: Op, x: list[Value]) -> Value:
    """One operation on vectors."""
    vector, lanes = x[0].type, x[0].type.count
    zero, one = ir.Constant(vector, [0.0] * lanes), ir.Constant(vector, [1.0] * lanes)
    plain = {Op.ADD: b.fadd, Op.SUB: b.fsub, Op.MUL: b.fmul, Op.DIV: b.fdiv, Op.NEG: b.fneg}
    if op in plain:
        return plain[op](*x)
    if op in COMPARE:
        return b.uitofp(
            b.fcmp_unordered("!=", *x) if op == Op.NE else b.fcmp_ordered(COMPARE[op], *x), vector
        )
    if op in (Op.MAX, Op.MIN):
        # An unordered comparison: a first argument that is not a number stays so.
        return b.select(b.fcmp_unordered(">" if op == Op.MAX else "<", *x), *x)
    if op == Op.SELECT:
        return b.select(b.fcmp_unordered("!=", x[0], zero), x[1], x[2])
    if op == Op.NOT:
        return b.uitofp(b.fcmp_ordered("==", x[0], zero), vector)
    if op in (Op.AND, Op.OR):
        combine = b.and_ if op == Op.AND else b.or_
        return b.select(combine(*(b.fcmp_unordered("!=", value, zero) for value in x)), one, zero)
    if op == Op.MULTIPLY_ADD:
        return _multiply_add(b, *x)
    if op == Op.NEGATIVE_MULTIPLY_ADD:
        return _multiply_add(b, b.fneg(x[0]), x[1], x[2])
    if op == Op.DIFFERENCE:
        return _multiply_add(b, b.fneg(x[2]), x[3], b.fmul(x[0], x[1]))
    if op in INTRINSIC:
        return _call(b, f"llvm.{INTRINSIC[op]}.v{lanes}f64", x)
    result = ir.Constant(vector, ir.Undefined)
    for lane in range(lanes):  # the C library has no vectors
        value = _call(b, LIBRARY[op], [b.extract_element(part, WORD(lane)) for part in x])
        result = b.insert_element(result, value, WORD(lane))
    return result


def _call(b: Builder, name: str, x: list[Value]) -> Value:
    """A function of the C library or an intrinsic, whose result is of the type of its arguments."""
    function = b.module.globals.get(name)
    if function is None:
        kind = ir.FunctionType(x[0].type, [value.type for value in x])
        function = ir.Function(b.module, kind, name)
    return b.call(function, x)


def memory(slots: int) -> int:
    """Numbers of memory that a program of so many slots needs, with those before the first one."""
    return (slots + 1) * LANES
