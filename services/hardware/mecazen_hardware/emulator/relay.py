"""Publishes the emulated world's persons and sensor data, as a robot's sensor drivers would.

The samples carry no stamp of a node: the robot's services treat them as external. Their headers
have the time of the driver's `clock`, like those of sensor drivers that use this clock.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping
from typing import Any

import msgspec
from mecazen import keys
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.config import BusConfig
from mecazen.errors import BusError
from mecazen.keys import Topic
from mecazen.messages import Clock, Header, Message, Time
from mecazen.wire import Stamp

RETRY_S = 1.0


class Relay:
    """A client of the robot's bus; a separate thread waits for the router.

    Args:
        config: The bus.
    """

    def __init__(self, config: BusConfig) -> None:
        self._config = config
        self._bus: ZenohBus | None = None
        self._clock_ns: int | None = None
        self._is_closing = threading.Event()
        self._thread = threading.Thread(target=self._connect, name="relay", daemon=True)
        self._thread.start()

    def publish(self, messages: Mapping[Topic[Any], Message], now_ns: int) -> None:
        """Publish messages of the emulated world, whose time is `now_ns`."""
        bus = self._bus
        if bus is None:
            return
        while bus.spin_once(0.0):
            pass
        if self._clock_ns is None:
            return
        for topic, message in messages.items():
            bus.publisher(topic).put(self._stamped(message, now_ns), None)

    def close(self) -> None:
        """Leave the bus."""
        self._is_closing.set()
        self._thread.join()
        if self._bus is not None:
            self._bus.close()

    def _stamped(self, message: Message, now_ns: int) -> Message:
        header = getattr(message, "header", None)
        if not isinstance(header, Header):
            return message
        assert self._clock_ns is not None  # `publish` waits for the clock
        stamp_ns = max(self._clock_ns - now_ns + header.stamp.ns, 1)  # 0 would be no stamp
        stamped = msgspec.structs.replace(header, stamp=Time.from_ns(stamp_ns))
        return msgspec.structs.replace(message, header=stamped)

    def _connect(self) -> None:
        while not self._is_closing.is_set():
            try:
                bus = ZenohBus(self._config, "client", name="emulator")
            except BusError:
                time.sleep(RETRY_S)
                continue
            bus.subscribe(keys.CLOCK, self._on_clock)
            self._bus = bus
            return

    def _on_clock(self, clock: Clock, stamp: Stamp | None) -> None:
        del stamp
        self._clock_ns = clock.clock.ns
