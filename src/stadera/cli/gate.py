"""Guards a command's outputs: none may overwrite an input, and each is reported at the end."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from typer.core import TyperCommand

OUTPUTS = frozenset(
    {"memory", "json", "report", "export", "out", "model", "latex", "figure", "keep", "merge", "record", "rrd"}
)
"""Parameters that name outputs. All other parameters that name files are inputs."""

REPLAY = "replay:"
"""Prefix of the path of a log that is replayed in place of a running robot."""


class GatedCommand(TyperCommand):
    """A command whose inputs are derived from its parameters, so that none can be forgotten."""

    def invoke(self, ctx: Any) -> Any:
        """Runs the command within the gate, and reports the files written."""
        from stadera.files import output_gate

        with output_gate(inputs_of(ctx.params)) as gate:
            value = super().invoke(ctx)
        if gate.written:
            from stadera.cli.terminal import show

            written: dict[Path, bool] = {}
            for path, replaced in gate.written:  # files written repeatedly are reported once
                written.setdefault(path, replaced)
            show(*(f"wrote {path}{' in place of the one before' * replaced}" for path, replaced in written.items()))
        return value


def inputs_of(parameters: Mapping[str, Any]) -> Iterator[Path]:
    """The files that parameters name, including those of a named robot and files included by a model."""
    for name, value in parameters.items():
        if name in OUTPUTS:
            continue
        for text in value if isinstance(value, list | tuple) else [value]:
            if isinstance(text, Path | str) and text:
                yield from _files(str(text), name)


def _files(text: str, parameter: str) -> Iterator[Path]:
    path = _robot(text) if parameter in ("robot", "target") else Path(text.removeprefix(REPLAY))
    yield path
    if path.suffix.lower() in (".xml", ".mjcf", ".urdf") and path.is_file():
        import re

        found = re.findall(r'<(?:include|compiler)[^>]*?(?:file|filename)="([^"]+)"', path.read_text(errors="replace"))
        yield from (path.parent / name for name in found)


def _robot(text: str) -> Path:
    from stadera.errors import StaderaError
    from stadera.robot.catalog import resolve

    try:
        return resolve(text)[1]
    except StaderaError:
        return Path(text)
