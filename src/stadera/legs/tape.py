"""Records arithmetic on components and repeats it on short pieces of the samples, compiled (`stadera.compiled`).

The algebra of `stadera.legs.components` allocates an array for each operation, and arrays of a whole chunk do not fit
into the processor's first cache. A `Traced` component records the operations instead: constants that are zero or one
drop out as they do there, operations that occur twice are recorded once, those that no result needs are left out, and
products that are added once are one operation. `Tape.run` then performs all of them on 128 samples at a time. Results
are the same up to the rounding of sines and cosines: operations and their order are unchanged, and products are rounded
before they are added.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import TYPE_CHECKING, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from stadera.types import Array

if TYPE_CHECKING:
    from stadera.legs.components import Component


class _Step(NamedTuple):
    """An operation: its kind, the steps of its operands, and its constant; an input has the kind "input"."""

    kind: str
    of: tuple[int, ...] = ()
    constant: float = 0.0


_COMMUTES = ("ADD", "TIMES")


class Recorder:
    """Records steps, each once.

    Args:
        inputs: number of components given.

    Attributes:
        inputs: these components, `Traced` in place of arrays.
    """

    def __init__(self, inputs: int) -> None:
        self.steps = [_Step("input", (k,)) for k in range(inputs)]
        self._known: dict[_Step, int] = {}
        self.inputs = cast(tuple[Array, ...], tuple(Traced(self, k) for k in range(inputs)))

    def step(self, kind: str, *of: int, constant: float = 0.0) -> Traced:
        """The result of a step."""
        key = _Step(kind, tuple(sorted(of)) if kind in _COMMUTES else of, constant)
        if key not in self._known:
            self._known[key] = len(self.steps)
            self.steps.append(_Step(kind, of, constant))
        return Traced(self, self._known[key])

    def cosine_and_sine(self, angle: Component) -> tuple[Array, Array]:
        """Cosine and sine of an input."""
        place = cast(Traced, angle).place
        return cast(Array, self.step("COSINE", place)), cast(Array, self.step("SINE", place))

    def tape(self, results: Sequence[Component | None], kernel: ModuleType) -> Tape:
        """The steps that these results need, for the module `stadera.legs.kernels.tape`; None leaves a row alone."""
        places = [_place(result) for result in results]
        ends = [place for place in places if place is not None]
        steps = _fused(self.steps, ends)
        needed = _needed(steps, ends)
        register, code, constants = _registers(steps, needed, ends, len(self.inputs)), [], []
        for k in needed:
            if (step := steps[k]).kind != "input":
                operands = [register[j] for j in step.of]
                code.append([getattr(kernel, step.kind), register[k], *operands, *operands[-1:] * (3 - len(operands))])
                constants.append(step.constant)
        stores = [-1 if place is None else register[place] for place in places]
        given = {k: float(r) for k, r in enumerate(results) if isinstance(r, float)}
        return Tape(
            kernel,
            np.array(code, dtype=np.int64).reshape(-1, 5),
            np.array(constants),
            1 + max(register.values(), default=0),
            np.array(stores, dtype=np.int64),
            given,
        )


@dataclass(frozen=True)
class Traced:
    """A component that records what is done with it; in place of an array."""

    recorder: Recorder
    place: int

    def __add__(self, other: Traced | float) -> Traced:
        if isinstance(other, Traced):
            return self.recorder.step("ADD", self.place, other.place)
        return self.recorder.step("PLUS_CONSTANT", self.place, constant=other)

    __radd__ = __add__

    def __sub__(self, other: Traced | float) -> Traced:
        if isinstance(other, Traced):
            return self.recorder.step("SUBTRACT", self.place, other.place)
        return self.recorder.step("PLUS_CONSTANT", self.place, constant=-other)

    def __rsub__(self, other: float) -> Traced:
        return self.recorder.step("MINUS_FROM", self.place, constant=other)

    def __mul__(self, other: Traced | float) -> Traced:
        if isinstance(other, Traced):
            return self.recorder.step("TIMES", self.place, other.place)
        return self.recorder.step("TIMES_CONSTANT", self.place, constant=other)

    __rmul__ = __mul__

    def __neg__(self) -> Traced:
        return self.recorder.step("TIMES_CONSTANT", self.place, constant=-1.0)


@dataclass(frozen=True, eq=False)
class Tape:
    """Recorded operations: see `stadera.legs.kernels.tape.run`.

    Attributes:
        given: by row, results that are constant.
    """

    kernel: ModuleType
    code: NDArray[np.int64]
    constants: Array
    registers: int
    stores: NDArray[np.int64]
    given: Mapping[int, float]

    def run(self, inputs: Array, out: Array) -> None:
        """Writes the results into out (rows, samples), from inputs (inputs, samples), both contiguous.

        Raises:
            ValueError: another number of rows or samples.
        """
        if out.shape != (len(self.stores), inputs.shape[1]):
            raise ValueError(f"a tape of {len(self.stores)} rows and {inputs.shape[1]} samples, got {out.shape}")
        self.kernel.run(self.code, self.constants, self.registers, inputs, self.stores, out)
        for row, value in self.given.items():
            out[row] = value


def _place(result: object) -> int | None:
    return result.place if isinstance(result, Traced) else None


def _fused(steps: Sequence[_Step], ends: Sequence[int]) -> list[_Step]:
    """The steps with each product that is used once, in a sum or difference, made part of that."""
    uses = Counter(j for k in _needed(steps, ends) for j in steps[k].of if steps[k].kind != "input")
    uses.update(ends)
    found = list(steps)
    for k, step in enumerate(steps):
        if step.kind not in ("ADD", "SUBTRACT"):
            continue
        a, b = step.of
        if _is_single_product(steps[a], uses[a]) and a != b:
            found[k] = _Step("TIMES_ADD" if step.kind == "ADD" else "TIMES_SUBTRACT", (*steps[a].of, b))
        elif _is_single_product(steps[b], uses[b]) and a != b:
            found[k] = _Step("TIMES_ADD" if step.kind == "ADD" else "SUBTRACT_TIMES", (*steps[b].of, a))
    return found


def _is_single_product(step: _Step, uses: int) -> bool:
    return step.kind == "TIMES" and uses == 1


def _needed(steps: Sequence[_Step], ends: Sequence[int]) -> list[int]:
    """The steps that the results depend on, in order."""
    needed, waiting = set(ends), list(ends)
    while waiting:
        step = steps[waiting.pop()]
        more = set(step.of) - needed if step.kind != "input" else set()
        needed |= more
        waiting += more
    return sorted(needed)


def _registers(steps: Sequence[_Step], needed: Sequence[int], ends: Sequence[int], inputs: int) -> dict[int, int]:
    """A register for each step, used again after the last use of its value, but never for an operand's result."""
    last = {j: k for k in needed for j in steps[k].of if steps[k].kind != "input"}
    last.update(dict.fromkeys(ends, len(steps)))
    register = {k: k for k in range(inputs)}
    free: list[int] = []
    highest = inputs
    for k in needed:
        if steps[k].kind == "input":
            continue
        if free:
            register[k] = free.pop()
        else:
            register[k], highest = highest, highest + 1
        free += [register[j] for j in set(steps[k].of) if last.get(j) == k]
    return register
