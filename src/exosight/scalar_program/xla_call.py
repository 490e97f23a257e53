"""The function by which XLA calls the interpreter: its buffers, and how numbers get into slots and out again.

Structures of XLA's foreign function interface: xla/ffi/api/c_api.h, version 0.3.
"""

from collections.abc import Callable

from llvmlite import ir

from exosight.scalar_program.machine_code import (
    DOUBLE,
    LONG,
    POINTER,
    WORD,
    Builder,
    Value,
    loop,
    spread,
    variable,
)

# Places in these structures [bytes].
EXTENSION, ARGUMENTS, RESULTS = 8, 56, 96  # of a call: extensions, number of arguments, of results
METADATA = 24  # of the extension by which a handler is asked for its version
MAJOR, MINOR = 24, 28  # of the metadata
DATA, RANK, SIZES = 24, 32, 40  # of a buffer
VERSION = 0, 3


def _field(b: Builder, base: Value, offset: int, kind: ir.Type) -> Value:
    return b.load(_at(b, base, offset, kind))


def _at(b: Builder, base: Value, offset: int, kind: ir.Type) -> Value:
    return b.bitcast(b.gep(b.bitcast(base, POINTER), [LONG(offset)]), kind.as_pointer())


def define_call(module: ir.Module, name: str, alone: Value, together: Value) -> None:
    """The function that XLA calls: (code, output slots, constants, slots to take over, the memory of the
    program run before, which has them, arguments) -> (results, memory).

    Arguments and memory have shape (…, values) of any leading sizes, or one sample for all. Memory begins
    with the place of its first slot, aligned for vectors; each block of samples has slots of its own.

    alone, together   functions that run a program once, (code, end of code, slots): on one sample, on several
    """
    function = ir.Function(module, ir.FunctionType(POINTER, [POINTER]), name)
    frame = function.args[0]
    b: Builder = ir.IRBuilder(function.append_basic_block("entry"))
    null = ir.Constant(POINTER, None)
    extension = _field(b, frame, EXTENSION, POINTER)
    asked, work = b.append_basic_block("asked"), b.append_basic_block("work")
    b.cbranch(b.icmp_unsigned("!=", extension, null), asked, work)
    b.position_at_end(asked)
    metadata = _field(b, extension, METADATA, POINTER)
    b.store(WORD(VERSION[0]), _at(b, metadata, MAJOR, WORD))
    b.store(WORD(VERSION[1]), _at(b, metadata, MINOR, WORD))
    b.ret(null)

    b.position_at_end(work)
    samples = _buffer(b, frame, RESULTS, 0)[1]
    one, several = b.append_basic_block("one"), b.append_basic_block("several")
    b.cbranch(b.icmp_signed("<=", samples, LONG(1)), one, several)
    for block, run in ((one, alone), (several, together)):
        b.position_at_end(block)
        _blocks(b, frame, run)
        b.ret(null)


def _blocks(b: Builder, frame: Value, run: Value) -> None:
    """Run the program on all samples, as many at a time as its slots have lanes."""
    code, outputs, constants, taken, before, given = (_buffer(b, frame, ARGUMENTS, i) for i in range(6))
    result, memory = (_buffer(b, frame, RESULTS, i) for i in range(2))
    words, slot = (run.args[i].type for i in (0, 2))
    lanes = slot.pointee.count
    code_start, code_size = b.bitcast(code[0], words), b.mul(code[1], code[2])
    start = b.ptrtoint(memory[0], LONG)
    aligned = b.and_(b.add(start, LONG(8 + 8 * lanes - 1)), LONG(-8 * lanes))
    most = b.sub(result[1], LONG(1))
    with loop(b, b.sdiv(b.add(result[1], LONG(lanes - 1)), LONG(lanes))) as block:
        b.store(b.sdiv(b.sub(aligned, start), LONG(8)), b.bitcast(memory[0], LONG.as_pointer()))
        first = b.mul(block, LONG(lanes))
        slots = b.inttoptr(b.add(aligned, b.mul(b.mul(first, memory[2]), LONG(8))), slot)
        rows = []  # the last block is filled up with its last sample
        for lane in range(lanes):
            row = b.add(first, LONG(lane))
            rows.append(b.select(b.icmp_signed("<", row, most), row, most))
        _load_constants(b, constants, slots)
        _take_over(b, taken, before, first, b.gep(slots, [constants[2]]))
        _load_arguments(b, given, b.gep(slots, [b.add(constants[2], taken[2])]), rows)
        b.call(run, [code_start, b.gep(code_start, [code_size]), slots])
        _store_results(b, outputs, slots, result, rows)


def _buffer(b: Builder, frame: Value, where: int, number: int) -> tuple[Value, ...]:
    """Data, samples and values a sample of a buffer."""
    buffers = _field(b, frame, where + 16, POINTER.as_pointer())
    buffer = b.load(b.gep(buffers, [LONG(number)]))
    sizes = _field(b, buffer, SIZES, LONG.as_pointer())
    leading = b.sub(_field(b, buffer, RANK, LONG), LONG(1))
    total = variable(b, LONG)
    b.store(LONG(1), total)
    with loop(b, leading) as axis:
        b.store(b.mul(b.load(total), b.load(b.gep(sizes, [axis]))), total)
    return _field(b, buffer, DATA, POINTER), b.load(total), b.load(b.gep(sizes, [leading]))


def _load_constants(b: Builder, constants: tuple[Value, ...], slots: Value) -> None:
    numbers = b.bitcast(constants[0], DOUBLE.as_pointer())
    vector = slots.type.pointee
    with loop(b, constants[2]) as i:
        b.store(spread(b, b.load(b.gep(numbers, [i])), vector), b.gep(slots, [i]), align=8 * vector.count)


def _take_over(
    b: Builder, taken: tuple[Value, ...], before: tuple[Value, ...], first: Value, slots: Value
) -> None:
    """What another program left in its memory, of the samples from `first` on or of one for all."""
    vector = slots.type.pointee
    places = b.bitcast(taken[0], WORD.as_pointer())
    numbers = b.bitcast(before[0], DOUBLE.as_pointer())
    start = b.gep(numbers, [b.load(b.bitcast(before[0], LONG.as_pointer()))])

    def copy(read: Callable[[Value], Value]) -> None:
        with loop(b, taken[2]) as i:
            value = read(b.zext(b.load(b.gep(places, [i])), LONG))
            b.store(value, b.gep(slots, [i]), align=8 * vector.count)

    with b.if_else(b.icmp_signed("<=", before[1], LONG(1))) as (one, several):
        with one:
            copy(lambda slot: spread(b, b.load(b.gep(start, [slot])), vector))
        with several:
            own = b.bitcast(b.gep(start, [b.mul(first, before[2])]), vector.as_pointer())
            # XLA may have moved the memory to where its slots are not aligned.
            copy(lambda slot: b.load(b.gep(own, [slot]), align=8))


def _load_arguments(b: Builder, given: tuple[Value, ...], slots: Value, rows: list[Value]) -> None:
    """The arguments of each sample, or those of one for all."""
    data, samples, values = given
    stride = b.select(b.icmp_signed("<=", samples, LONG(1)), LONG(0), values)
    numbers = b.bitcast(data, DOUBLE.as_pointer())
    starts = [b.gep(numbers, [b.mul(row, stride)]) for row in rows]
    with loop(b, values) as i:
        vector = ir.Constant(slots.type.pointee, ir.Undefined)
        for lane, start in enumerate(starts):
            vector = b.insert_element(vector, b.load(b.gep(start, [i])), WORD(lane))
        b.store(vector, b.gep(slots, [i]), align=8 * len(rows))


def _store_results(
    b: Builder,
    outputs: tuple[Value, ...],
    slots: Value,
    result: tuple[Value, ...],
    rows: list[Value],
) -> None:
    places = b.bitcast(outputs[0], WORD.as_pointer())
    numbers = b.bitcast(result[0], DOUBLE.as_pointer())
    starts = [b.gep(numbers, [b.mul(row, result[2])]) for row in rows]
    with loop(b, result[2]) as i:
        slot = b.zext(b.load(b.gep(places, [i])), LONG)
        vector = b.load(b.gep(slots, [slot]), align=8 * len(rows))
        for lane, start in enumerate(starts):
            b.store(b.extract_element(vector, WORD(lane)), b.gep(start, [i]))
