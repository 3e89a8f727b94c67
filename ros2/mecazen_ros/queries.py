"""Requests of ROS services, and their responses."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import zenoh
from mecazen.bus.base import Reply
from mecazen.bus.inbox import Refusals
from mecazen.bus.queries import QueryInbox
from mecazen.bus.receiving import direct
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.errors import RefusedError
from mecazen.keys import Call
from mecazen.messages import Message

from mecazen_ros import cdr
from mecazen_ros.parameters import NodeParameters
from mecazen_ros.protocol import Attachment
from mecazen_ros.services import FAILED, OK, UNSUPPORTED, Service

Give = Callable[[Message], None]
"""Sends the response to a request."""
Ask = Callable[[Call[Any, Any], Message, Reply[Any]], None]
"""Makes a query, which is answered now or later."""
Respond = Callable[[bytes, Give], None]
"""Answers a request, which is in CDR, at once or later."""


class _QueryReply(Reply[Any]):
    """Answers a request by the answer to a query."""

    def __init__(self, give: Give, service: Service) -> None:
        self._give, self._service = give, service

    def answer(self, message: Any) -> None:
        """Respond that the request succeeded."""
        self._give(self._service.respond(OK, "", message))

    def refuse(self, reason: str) -> None:
        """Respond that the request failed, since ROS clients do not react to an error of Zenoh."""
        self._give(self._service.respond(FAILED, reason))


def by_query(service: Service, ask: Ask) -> Respond:
    """Return a function that answers requests by a query to a server in this process."""

    def respond(payload: bytes, give: Give) -> None:
        try:
            call, request = service.ask(cdr.decode(payload, service.interface.request))
        except RefusedError as refusal:
            give(service.respond(UNSUPPORTED, str(refusal)))
        else:
            ask(call, request, _QueryReply(give, service))

    return respond


def by_parameters(service: Service, parameters: NodeParameters) -> Respond:
    """Return a function that answers requests for a node's parameters; malformed ones by zeros."""

    def respond(payload: bytes, give: Give) -> None:
        try:
            request = cdr.decode(payload, service.interface.request)
        except RefusedError:
            give(service.interface.response())
        else:
            give(service.interface.response(**service.ask(parameters, request)))

    return respond


def serve(
    session: zenoh.Session, bus: ZenohBus, key: str, source: str, respond: Respond
) -> zenoh.Queryable[None]:
    """Answer requests on a key, on the bus's thread; count refused requests under `source`."""
    refusals = Refusals(bus.queue, bus.refuse)

    def take(query: zenoh.Query) -> None:
        try:
            sequence, _, gid = attached(query)
        except RefusedError as refusal:
            drop(query, str(refusal))
            return

        def give(message: Message) -> None:
            with query:
                query.reply(key, cdr.encode(message), attachment=attachment_of(sequence, gid))

        respond(b"" if query.payload is None else query.payload.to_bytes(), give)

    def drop(query: zenoh.Query, reason: str) -> None:
        refusals.add(source, reason)
        query.drop()  # type: ignore[no-untyped-call]

    inbox = QueryInbox(bus.queue, key, take, drop)
    return session.declare_queryable(key, direct(inbox.receive), complete=True)


def attached(came: zenoh.Sample | zenoh.Query) -> Attachment:
    """Return the attachment of a sample or a request.

    Raises:
        RefusedError: The attachment is not rmw_zenoh's.
    """
    return Attachment.unpack(b"" if came.attachment is None else came.attachment.to_bytes())


def attachment_of(sequence: int, gid: bytes) -> bytes:
    """Return the attachment of a sample or reply that is sent now."""
    return Attachment(sequence, time.time_ns(), gid).pack()
