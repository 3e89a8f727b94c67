"""The services of the loop, each of which writes down at its end how much it has published."""

from __future__ import annotations

import os
from collections import Counter
from pathlib import Path
from typing import Any

import msgspec
from mecazen.bus import Bus, Publisher
from mecazen.config import Scenario
from mecazen.keys import Topic
from mecazen.service import Service
from mecazen.wire import Stamp
from mecazen_controller.service import ControllerService
from mecazen_follower.service import FollowerService
from mecazen_physics.service import PhysicsService
from mecazen_target.service import TargetService

FOLDER = "MECAZEN_TEST_COUNTS"
"""The variable of the environment that says where to."""


class _Counted(Publisher[Any]):
    def __init__(self, publisher: Publisher[Any], key: str, counts: Counter[str]) -> None:
        self._publisher, self._key, self._counts = publisher, key, counts

    def put(self, message: Any, stamp: Stamp) -> None:
        self._publisher.put(message, stamp)
        self._counts[self._key] += 1


class _Counting(Service):
    def __init__(self, bus: Bus, scenario: Scenario) -> None:
        self.counts: Counter[str] = Counter()
        publisher = bus.publisher

        def counted(topic: Topic[Any]) -> Publisher[Any]:
            return _Counted(publisher(topic), topic.key, self.counts)

        bus.publisher = counted  # type: ignore[method-assign]
        super().__init__(bus, scenario)

    def close(self) -> None:
        super().close()
        (Path(os.environ[FOLDER]) / self.NAME).write_bytes(msgspec.json.encode(self.counts))


class Physics(_Counting, PhysicsService): ...


class Controller(_Counting, ControllerService): ...


class Target(_Counting, TargetService): ...


class Follower(_Counting, FollowerService): ...
