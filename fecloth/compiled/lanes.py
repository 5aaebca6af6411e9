"""Four numbers that the processor loads, multiplies and adds at once, for kernels only.

The compiler finds such groups by itself in long loops over one index, but not in loops over
blocks of three numbers. There the functions of this module name them: the numbers of a block of
three, and a fourth one that counts nothing.
"""

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.datamodel import models
from numba.extending import intrinsic, register_model

WIDTH = 4


def in_kernels(generator: Callable[..., Any]) -> Any:
    """Make a function for kernels of one that generates its code."""
    return intrinsic(generator)


class Lanes(types.Type):
    """The type of four numbers of the type `number`."""

    def __init__(self, number: Any):
        self.number = number
        super().__init__(f"Lanes({number})")


@register_model(Lanes)
class _LanesModel(models.PrimitiveModel):
    """Four numbers in a register."""

    def __init__(self, manager: Any, kind: Lanes):
        number = manager.lookup(kind.number).get_value_type()
        super().__init__(manager, kind, ir.VectorType(number, WIDTH))


def _address(
    context: Any, builder: Any, kind: Any, array: Any, index_types: Any, index: Any
) -> Any:
    """Pointer to four numbers in an array of the type `kind`, from an index on."""
    numbers = zip(cgutils.unpack_tuple(builder, index), index_types, strict=True)
    indices = [context.cast(builder, number, of, types.intp) for number, of in numbers]
    indices += [context.get_constant(types.intp, 0)] * (kind.ndim - len(indices))
    view = context.make_array(kind)(context, builder, array)
    first = cgutils.get_item_pointer(context, builder, kind, view, indices, wraparound=False)
    numbers_at_once = ir.VectorType(context.get_data_type(kind.dtype), WIDTH)
    return builder.bitcast(first, numbers_at_once.as_pointer())


@in_kernels
def load(typing: Any, array: Any, index: Any) -> Any:
    """The four numbers of an array from an index on, a tuple; missing indices are 0.

    They lie one after another in memory, also across the end of a row.
    """

    def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        address = _address(context, builder, array, given[0], index, given[1])
        return builder.load(address, align=array.dtype.bitwidth // 8)

    return Lanes(array.dtype)(array, index), generate


@in_kernels
def repeat(typing: Any, number: Any) -> Any:
    """Four times the same number."""

    def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        undefined = ir.Constant(ir.VectorType(given[0].type, WIDTH), ir.Undefined)
        first = builder.insert_element(undefined, given[0], ir.Constant(ir.IntType(32), 0))
        return builder.shuffle_vector(first, undefined, _order(0, 0, 0, 0))

    return Lanes(number)(number), generate


@in_kernels
def multiply_add(typing: Any, a: Any, b: Any, c: Any) -> Any:
    """a b + c of each of the four numbers, rounded once where the processor can."""

    def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        product = builder.fmul(given[0], given[1], flags=("contract",))
        return builder.fadd(product, given[2], flags=("contract",))

    return a(a, b, c), generate


@in_kernels
def rotate(typing: Any, lanes: Any) -> Any:
    """The last number, and then the first three."""

    def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        undefined = ir.Constant(given[0].type, ir.Undefined)
        return builder.shuffle_vector(given[0], undefined, _order(3, 0, 1, 2))

    return lanes(lanes), generate


@in_kernels
def sum_of(typing: Any, a: Any, b: Any) -> Any:
    """The sum of the four numbers of a and the four of b."""

    def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        sums = builder.fadd(*given)
        lane = [builder.extract_element(sums, ir.Constant(ir.IntType(32), k)) for k in range(WIDTH)]
        return builder.fadd(builder.fadd(lane[0], lane[1]), builder.fadd(lane[2], lane[3]))

    return a.number(a, b), generate


def _order(*lanes: int) -> Any:
    """A constant that says from which lanes a group is taken."""
    return ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), list(lanes))
