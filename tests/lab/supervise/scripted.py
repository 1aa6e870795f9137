"""A walker that does as scripted."""

from __future__ import annotations

from stadera.trunk import TrunkModel


class ScriptedWalker:
    """Stops when it is told to, unless told not to; remembers what it was made to believe."""

    def __init__(self, *, stops: bool = True, takes: bool = True) -> None:
        self.stops, self.takes = stops, takes
        self.walking, self.fault = True, ""
        self.models: list[TrunkModel] = []

    @property
    def stopped(self) -> bool:
        return not self.walking

    def request_stop(self) -> None:
        self.walking = self.walking and not self.stops

    def resume(self) -> None:
        self.walking = True

    def update_trunk(self, trunk: TrunkModel) -> bool:
        if self.takes:
            self.models.append(trunk)
        return self.takes
