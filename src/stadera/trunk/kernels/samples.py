"""One sample into a table, compiled: what `SampleBuffer.gather` does at every call."""

from stadera.compiled import compiled, part
from stadera.types import Array


@part
def put(row: Array, at: int, values: Array) -> float:
    """Writes values into a row. Returns their sum of squares, which is not finite if one of them is not."""
    square = 0.0
    for k in range(len(values)):
        row[at + k] = values[k]
        square += values[k] * values[k]
    return square


@compiled(
    "boolean(float64[:,::1], int64, float64, float64[::1], float64[::1], float64[::1], float64[::1], float64[::1], "
    "float64[::1])"
)
def store(
    table: Array,
    k: int,
    time: float,
    position: Array,
    velocity: Array,
    effort: Array,
    omega: Array,
    force: Array,
    extra: Array,
) -> bool:
    """Writes a sample into row k of a table, see `Samples.table`. Returns whether all values are finite.

    Raises:
        ValueError: the channels do not fill the row.
    """
    row, n = table[k], len(position)
    if len(velocity) != n or len(effort) != n or len(omega) + len(force) != 6 or 7 + 3 * n + len(extra) != len(row):
        raise ValueError("the sample's channels do not fill the table's row")
    row[0] = time
    square = time * time + put(row, 1, position) + put(row, 1 + n, velocity) + put(row, 1 + 2 * n, effort)
    square += put(row, 1 + 3 * n, omega) + put(row, 4 + 3 * n, force) + put(row, 7 + 3 * n, extra)
    return square - square == 0.0
