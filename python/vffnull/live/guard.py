"""Who may talk to the page: this machine, from the page itself, and whoever was allowed by name.

A browser sends along with every request which host it believes to talk to, and with a websocket which page
has asked for it. Without a look at both, any page that somebody visits could turn the knobs of this one:
directly, or by a name of its own that it lets point at this machine.
"""

from __future__ import annotations

import http
import logging
import threading
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager
from typing import Any
from urllib.parse import urlsplit

import websockets.asyncio.server
from websockets.asyncio.server import ServerConnection
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from vffnull._support.errors import InputError
from vffnull.live.client import prepared

LOOPBACK = ("127.0.0.1", "localhost", "[::1]")
_STARTING = threading.Lock()
_SILENT = logging.getLogger(f"{__name__}.silent")
"""Of connections: what others send that cannot be read ends theirs, and is no news for the terminal."""
_SILENT.setLevel(logging.CRITICAL + 1)
_CLOSES = 0.05  # s


def origins(given: Iterable[str]) -> frozenset[str]:
    """Origins that are allowed besides the page's own, as browsers write them.

    Raises
    ------
    vffnull.errors.InputError
        If one is not of the form ``https://host`` or ``http://host:port``.
    """
    if isinstance(given, str):
        given = (given,)
    found = set()
    for origin in given:
        try:
            parts = urlsplit(origin)
            fine = parts.scheme in ("http", "https") and parts.hostname and parts.port != 0
            fine = fine and f"{parts.scheme}://{parts.netloc}" == origin and "@" not in origin
        except (ValueError, TypeError, AttributeError):
            fine = False
        if not fine:
            raise InputError(f"allow_origins: expected an origin such as https://host:8080, got {origin!r}")
        found.add(origin.lower())
    return frozenset(found)


def refusal(headers: Headers, port: int, allowed: Collection[str]) -> str | None:
    """Why a request is refused, or None if it is not.

    Programs that are no browsers send no origin; they must at least ask for a host that this one is.
    """
    own = {f"http://{host}:{port}" for host in LOOPBACK}
    known = own | set(allowed)
    hosts = {urlsplit(each).netloc for each in known}
    given = [each.lower() for each in headers.get_all("Host")]
    if len(given) != 1 or given[0] not in hosts:
        return f"the host {', '.join(given) or 'without a name'} is not this page's"
    for origin in headers.get_all("Origin"):
        if origin.lower() not in known:
            return f"pages of {origin} may not use this one"
    return None


@contextmanager
def guarding(allowed: Collection[str]) -> Iterator[None]:
    """Let the server that viser starts inside ask `refusal` before it answers anything, and send its page
    `prepared`.

    viser has no place for such a check. What it starts is replaced while it starts; servers that others
    start at the same moment in this process are left alone.

    Raises
    ------
    RuntimeError
        If viser has started its server in a way that leaves nobody to ask.
    """
    plain = websockets.asyncio.server.serve
    guarded: list[bool] = []

    def serve(handler: Any, *arguments: Any, **how: Any) -> Any:
        if not getattr(handler, "__module__", "").startswith("viser."):
            return plain(handler, *arguments, **how)
        answer = how.get("process_request")
        # Whoever does not read would be waited for when the page ends.
        more = {"close_timeout": _CLOSES, "logger": _SILENT}
        guarded.append(True)

        def process(connection: ServerConnection, request: Request) -> Any:
            port = connection.local_address[1]
            fault = refusal(request.headers, port, allowed)
            if fault is not None:
                hint = "vff.live(allow_origins=...) and vffnull live --allow-origin allow more"
                body = f"Refused: {fault}. {hint}.\n".encode("utf-8", "replace")
                about = Headers(
                    {"Content-Type": "text/plain; charset=utf-8", "Content-Length": str(len(body))}
                )
                return Response(http.HTTPStatus.FORBIDDEN, "Forbidden", about, body)
            if answer is None:
                return None
            if "Accept-Encoding" in request.headers:  # packing takes longer than sending on one machine
                del request.headers["Accept-Encoding"]
            found = answer(connection, request)
            return None if found is None else prepared(found)

        return plain(handler, *arguments, **(how | more | {"process_request": process}))

    with _STARTING:
        websockets.asyncio.server.serve = serve  # type: ignore[assignment, misc]
        try:
            yield
        finally:
            websockets.asyncio.server.serve = plain  # type: ignore[misc]
    if not guarded:
        raise RuntimeError("this version of viser starts its server in another way; the page is not safe")
