"""Nobody talks to the studio without its token, by another name, or from another site."""

from __future__ import annotations

import asyncio
import logging
from typing import Any

import pytest

from retrue.studio.app import worth_saying
from retrue.studio.guard import Guard, new_token

TOKEN = new_token()
HOST = "127.0.0.1:8123"


def asked(kind: str = "http", query: str = "", **headers: str) -> tuple[int, dict[str, str]]:
    """Status and headers; 200 where the application was reached, 1008 where a socket was closed."""
    sent: list[Any] = []

    async def app(_scope: Any, _receive: Any, send: Any) -> None:
        await send({"type": "reached", "status": 200, "headers": []})

    async def receive() -> dict[str, Any]:
        return {}

    async def send(message: Any) -> None:
        sent.append(message)

    lines = [(name.encode(), value.encode("latin-1")) for name, value in {"host": HOST, **headers}.items()]
    scope = {"type": kind, "headers": lines, "query_string": query.encode(), "path": "/"}
    asyncio.run(Guard(app, TOKEN, 8123)(scope, receive, send))
    first = sent[0]
    return first.get("status", first.get("code")), {k.decode(): v.decode() for k, v in first.get("headers", [])}


COOKIE = f"other=1; retrue_studio_8123={TOKEN}"


def test_the_printed_address_becomes_a_cookie_of_this_port_alone():
    status, headers = asked(query=f"token={TOKEN}")
    assert (status, headers["location"]) == (303, "/")
    assert headers["set-cookie"] == f"retrue_studio_8123={TOKEN}; Path=/; HttpOnly; SameSite=Strict"


def test_the_printed_address_does_not_stay_in_the_address_bar_the_second_time_either():
    status, headers = asked(query=f"token={TOKEN}", cookie=COOKIE)
    assert (status, headers["location"]) == (303, "/")
    assert asked("websocket", query=f"token={TOKEN}")[0] == 1008


@pytest.mark.parametrize("kind", ["http", "websocket"])
def test_whoever_has_it_is_let_in(kind: str):
    assert asked(kind, cookie=COOKIE)[0] == 200
    assert asked(kind, cookie=COOKIE, origin="http://127.0.0.1:8123")[0] == 200
    assert asked(kind, cookie=COOKIE, host="LOCALHOST:8123", origin="http://localhost:8123")[0] == 200


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({}, 401),
        ({"cookie": "retrue_studio_8123=guess"}, 401),
        ({"cookie": f"retrue_studio_8124={TOKEN}"}, 401),
        ({"cookie": "\x00=;;=\xff"}, 401),
        ({"cookie": COOKIE, "host": "evil.example:8123"}, 403),  # a name that is made to point to loopback
        ({"cookie": COOKIE, "host": "127.0.0.1"}, 403),
        ({"cookie": COOKIE, "host": ""}, 403),
        ({"cookie": COOKIE, "origin": "http://evil.example"}, 403),
        ({"cookie": COOKIE, "origin": "null"}, 403),
        ({"cookie": COOKIE, "origin": "http://127.0.0.1:9999"}, 403),
    ],
)
def test_everybody_else_is_not(headers: dict[str, str], status: int):
    assert asked("http", **headers)[0] == status
    assert asked("websocket", **headers)[0] == 1008


def test_tokens_are_long_and_never_the_same():
    assert len({new_token() for _ in range(100)}) == 100
    assert len(TOKEN) >= 32
    assert asked(query="token=")[0] == asked(query=f"token={TOKEN}x")[0] == 401


def test_a_request_that_is_broken_off_is_not_said_and_what_else_goes_wrong_is():
    """As Starlette raises it, where nobody waits for the answer any more."""
    from starlette.middleware.base import BaseHTTPMiddleware

    async def nothing(_scope: Any, _receive: Any, _send: Any) -> None: ...

    async def passed_on(request: Any, call_next: Any) -> Any:
        return await call_next(request)

    async def broken_off() -> None:
        scope = {"type": "http", "method": "GET", "path": "/", "query_string": b"", "headers": []}
        await BaseHTTPMiddleware(nothing, passed_on)(scope, asyncio.Queue().get, nothing)  # type: ignore[arg-type]

    with pytest.raises(RuntimeError) as raised:
        asyncio.run(broken_off())
    for error, said in ((raised.value, False), (RuntimeError("anything else"), True)):
        info = (type(error), error, None)
        assert worth_saying(logging.LogRecord("uvicorn.error", logging.ERROR, "", 0, "", None, info)) == said
    assert worth_saying(logging.LogRecord("uvicorn.error", logging.ERROR, "", 0, "a line", None, None))


def test_tasks_that_ended_late_are_not_worth_saying(caplog: pytest.LogCaptureFixture) -> None:
    from nicegui import background_tasks

    async def slow_to_end() -> None:
        try:
            await asyncio.sleep(60)
        except asyncio.CancelledError:
            await asyncio.sleep(60)

    async def ended() -> None:
        task = asyncio.create_task(slow_to_end())
        background_tasks.running_tasks.add(task)
        task.add_done_callback(background_tasks.running_tasks.discard)
        await asyncio.sleep(0)
        await background_tasks.teardown()

    asyncio.run(ended())
    said = [record for record in caplog.records if record.name == "nicegui"]
    assert [worth_saying(record) for record in said] == [False]
    left = logging.LogRecord("nicegui", logging.ERROR, "", 0, said[0].msg, (1, "decode"), None)
    assert worth_saying(left)
