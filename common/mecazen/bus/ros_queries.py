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
from mecazen.messages import Message
from mecazen.ros import cdr
from mecazen.ros.parameters import NodeParameters, ParameterService
from mecazen.ros.protocol import Attachment
from mecazen.ros.services import FAILED, UNSUPPORTED, Service
from mecazen.wire import RefusedError


class Response:
    """Answers one request.

    Raises:
        RefusedError: It did not come as rmw_zenoh's do.
    """

    def __init__(self, query: zenoh.Query, key: str) -> None:
        self._sequence, _, self._gid = attached(query)
        self._query, self._key = query, key

    def give(self, message: Message) -> None:
        """Send the response."""
        attachment = attachment_of(self._sequence, self._gid)
        with self._query as query:
            query.reply(self._key, cdr.encode(message), attachment=attachment)


Respond = Callable[[bytes, Response], None]
"""Answers a request, which is in CDR, at once or later."""


class _QueryReply(Reply[Any]):
    """Answers a request by what a query is answered."""

    def __init__(self, response: Response, service: Service) -> None:
        self._response, self._service = response, service

    def answer(self, message: Message) -> None:
        """Respond that it was done."""
        self._response.give(self._service.tell(message))

    def refuse(self, reason: str) -> None:
        """Respond that it failed: to an error of Zenoh a ROS client does not react."""
        self._response.give(self._service.refuse(reason, FAILED))


def by_query(service: Service, bus: ZenohBus) -> Respond:
    """Return what answers a service by a query that this process answers."""

    def respond(payload: bytes, response: Response) -> None:
        try:
            call, request = service.ask(cdr.decode(payload, service.request))
        except RefusedError as refusal:
            response.give(service.refuse(str(refusal), UNSUPPORTED))
        else:
            bus.server(call)(request, _QueryReply(response, service))

    return respond


def by_parameters(service: ParameterService, parameters: NodeParameters) -> Respond:
    """Return what answers a service for the parameters of a node."""

    def respond(payload: bytes, response: Response) -> None:
        try:
            request = cdr.decode(payload, service.request, finite=False)  # a limit may be infinite
        except RefusedError:
            response.give(service.response())
        else:
            response.give(service.answer(parameters, request))

    return respond


def serve(
    session: zenoh.Session, bus: ZenohBus, key: str, source: str, respond: Respond
) -> zenoh.Queryable[None]:
    """Answer requests on a key, on the thread of `bus`; refusals are counted under `source`."""
    refusals = Refusals(bus.queue, bus.refuse)

    def take(query: zenoh.Query) -> None:
        try:
            response = Response(query, key)
        except RefusedError as refusal:
            bus.refuse(source, str(refusal))
            query.drop()  # type: ignore[no-untyped-call]
        else:
            respond(b"" if query.payload is None else query.payload.to_bytes(), response)

    def refuse(query: zenoh.Query, reason: str) -> None:
        refusals.add(source, reason)
        query.drop()  # type: ignore[no-untyped-call]

    inbox = QueryInbox(bus.queue, key, take, refuse)
    return session.declare_queryable(key, direct(inbox.receive), complete=True)


def attached(came: zenoh.Sample | zenoh.Query) -> Attachment:
    """Return what is attached to a sample or a request.

    Raises:
        RefusedError: It is not what rmw_zenoh attaches.
    """
    return Attachment.unpack(b"" if came.attachment is None else came.attachment.to_bytes())


def attachment_of(sequence: int, gid: bytes) -> bytes:
    """Return what goes with what is sent now."""
    return Attachment(sequence, time.time_ns(), gid).pack()
