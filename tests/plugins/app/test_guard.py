"""Access to the server: token, origin, host, size of an upload, names and paths of files."""

from __future__ import annotations

import asyncio
import http.client
import importlib.util
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import pytest

from commonrail.plugins.app.guard import Guard
from commonrail.plugins.app.project import Project, safe_name
from commonrail.plugins.app.server import listen
from tests.plugins.app.server import Served, serving

pytestmark = [
    pytest.mark.process,
    pytest.mark.skipif(importlib.util.find_spec("nicegui") is None, reason="nicegui is not installed"),
]


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with serving(tmp_path_factory.mktemp("guard") / "project") as served:
        yield served


def ask(server: Served, path: str = "/", **headers: str) -> http.client.HTTPResponse:
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=60)
    connection.request("GET", path, headers=headers)
    return connection.getresponse()


def cookie(server: Served) -> str:
    answer = ask(server, f"/?token={server.token}")
    assert answer.status == 303
    assert server.token not in (answer.getheader("location") or "")
    text = answer.getheader("set-cookie") or ""
    assert {"HttpOnly", "SameSite=Strict"} <= set(text.split("; "))
    return text.partition(";")[0]


def test_a_request_needs_the_token(server: Served) -> None:
    assert ask(server).status == 403
    assert ask(server, "/?token=wrong").status == 403
    assert ask(server, "/file/app.json").status == 403
    assert ask(server, Cookie=f"commonrail_app_{server.port}=wrong").status == 403
    assert ask(server, Cookie=cookie(server)).status == 200


@pytest.mark.parametrize(
    "headers",
    [{"Origin": "http://evil.example"}, {"Origin": "null"}, {"Host": "evil.example"}, {"Origin": "http://127.0.0.1:1"}],
)
def test_other_origins_and_hosts_are_refused(server: Served, headers: dict[str, str]) -> None:
    assert ask(server, Cookie=cookie(server), **headers).status == 403


@pytest.mark.parametrize(
    ("with_cookie", "origin", "status"), [(True, "own", 101), (True, "evil", 403), (False, "own", 403)]
)
def test_a_websocket_needs_cookie_and_origin(server: Served, with_cookie: bool, origin: str, status: int) -> None:
    headers = {
        "Connection": "Upgrade", "Upgrade": "websocket", "Sec-WebSocket-Version": "13",
        "Sec-WebSocket-Key": "MDEyMzQ1Njc4OWFiY2RlZg==",
        "Origin": f"http://127.0.0.1:{server.port}" if origin == "own" else "http://evil.example",
    } | ({"Cookie": cookie(server)} if with_cookie else {})  # fmt: skip
    answer = ask(
        server, "/_nicegui_ws/socket.io/?EIO=4&transport=websocket&client_id=x&implicit_handshake=true", **headers
    )
    assert answer.status == status


def test_it_listens_on_the_loopback_interface_alone() -> None:
    with listen(0) as listener:
        assert listener.getsockname()[0] == "127.0.0.1"


def test_a_large_upload_is_refused_and_not_read(server: Served) -> None:
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=60)
    connection.putrequest("POST", "/_nicegui/client/none/upload/1")
    connection.putheader("Cookie", cookie(server))
    connection.putheader("Content-Length", str(300_000_000))
    connection.endheaders(b"0" * 100_000)
    assert connection.getresponse().status == 413
    assert ask(server, Cookie=cookie(server)).status == 200


def test_an_upload_of_unstated_size_is_counted_while_it_arrives() -> None:
    arrived, answers = [], []

    async def application(scope: Any, receive: Any, send: Any) -> None:
        while (await receive())["more_body"]:
            pass

    async def receive() -> dict[str, Any]:
        arrived.append(100)
        return {"type": "http.request", "body": b"0" * 100, "more_body": True}

    async def send(message: Any) -> None:
        answers.append(message)

    headers = [(b"host", b"127.0.0.1:80"), (b"cookie", b"commonrail_app_80=secret"), (b"transfer-encoding", b"chunked")]
    scope = {"type": "http", "method": "POST", "path": "/", "query_string": b"", "headers": headers}
    asyncio.run(Guard(application, "secret", 80, 1000)(scope, receive, send))
    assert answers[0]["status"] == 413
    assert sum(arrived) == 1100


@pytest.mark.parametrize(
    "path", ["../secret.txt", "%2e%2e/secret.txt", "..%2fsecret.txt", "/etc/passwd", "link.txt", "files", "none.csv"]
)
def test_no_path_leads_out_of_the_folder(tmp_path: Path, path: str) -> None:
    (tmp_path / "secret.txt").write_text("secret")
    project = Project(tmp_path / "project")
    (project.folder / "link.txt").symlink_to(tmp_path / "secret.txt")
    assert project.inside(unquote(path)) is None


@pytest.mark.parametrize(
    "name",
    ["../../evil.csv", "..\\..\\evil.csv", "/etc/cron.d/x", ".bashrc", "a\nb\0c.csv", "", "..", "CON.csv",
     "x" * 300 + ".csv", "<script>alert(1)</script>.csv", "; rm -rf $HOME.csv", "--out=x.csv", "\u202ecsv.exe"],
)  # fmt: skip
def test_a_hostile_name_stays_in_its_folder(tmp_path: Path, name: str) -> None:
    project = Project(tmp_path / "project")

    async def chunks():  # type: ignore[no-untyped-def]
        yield b"1"

    async def add() -> list[str]:
        return [await project.add_file(name, chunks()) for _ in range(2)]

    first, second = asyncio.run(add())
    assert first != second
    assert sorted(p.name for p in (project.folder / "files").iterdir()) == sorted((first, second))
    assert len(list(tmp_path.iterdir())) == 1
    assert not safe_name(name).startswith(("-", "."))
    assert not set(safe_name(name)) & set("<>$;/\\\n\0")
