"""Who may talk to the studio: whoever has its token, from this computer, and from no page of another site.

A page of any site can make a browser send requests to loopback (and, by a name that it lets point there, read the
answers). So the token, which only the printed address holds, is asked of every request; the Host must be our own, which
defeats such names; and so must the Origin, where a browser says one.
"""

from __future__ import annotations

import secrets
from collections.abc import Awaitable, Callable, MutableMapping
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

TOKEN_BYTES = 24
LOOPBACK = ("127.0.0.1", "localhost")


def new_token() -> str:
    """One that nobody guesses; good in an address as it is."""
    return secrets.token_urlsafe(TOKEN_BYTES)


class Guard:
    """An ASGI application before another one.

    `/?token=...` is answered with a cookie and the way to `/`, so that the token does not stay in the address bar; the
    cookie is for this port alone, and is neither sent along from other sites nor seen by scripts.
    """

    def __init__(self, app: App, token: str, port: int) -> None:
        self._app, self._token = app, token
        self._hosts = {f"{name}:{port}" for name in LOOPBACK}
        self._origins = {f"http://{host}" for host in self._hosts}
        self._cookie = f"retrue_studio_{port}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        headers = {name.decode("latin-1").lower(): value.decode("latin-1") for name, value in scope["headers"]}
        if headers.get("host", "").lower() not in self._hosts:
            await _refuse(scope, send, 403, "this is no name of the studio: use the address that it printed")
        elif headers.get("origin", next(iter(self._origins))).lower() not in self._origins:
            await _refuse(scope, send, 403, "pages of other sites may not talk to the studio")
        elif scope["type"] == "http" and self._is_token(_from_query(scope)):  # also of whoever has the cookie
            await self._welcome(send)
        elif self._is_token(self._from_cookie(headers.get("cookie", ""))):
            await self._app(scope, receive, send)
        else:
            await _refuse(scope, send, 401, "open the whole address that the studio printed, its token too")

    def _is_token(self, token: str) -> bool:
        return secrets.compare_digest(token.encode(), self._token.encode())

    def _from_cookie(self, header: str) -> str:
        try:
            found = SimpleCookie(header).get(self._cookie)
        except CookieError:
            return ""
        return "" if found is None else found.value

    async def _welcome(self, send: Send) -> None:
        cookie = f"{self._cookie}={self._token}; Path=/; HttpOnly; SameSite=Strict"
        headers = [(b"location", b"/"), (b"set-cookie", cookie.encode()), (b"cache-control", b"no-store")]
        await send({"type": "http.response.start", "status": 303, "headers": headers})
        await send({"type": "http.response.body", "body": b""})


def _from_query(scope: Scope) -> str:
    return parse_qs(scope.get("query_string", b"").decode("latin-1")).get("token", [""])[0]


async def _refuse(scope: Scope, send: Send, status: int, why: str) -> None:
    if scope["type"] == "websocket":
        await send({"type": "websocket.close", "code": 1008})
        return
    headers = [(b"content-type", b"text/plain; charset=utf-8"), (b"cache-control", b"no-store")]
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": f"retrue studio: {why}\n".encode()})
