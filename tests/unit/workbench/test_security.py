"""What keeps others out of the workbench, and what a file or a name cannot do to it."""

from __future__ import annotations

import asyncio
import os
import re
from pathlib import Path
from typing import Any

import pytest

from pmsm_ctrl.workbench.guard import Guard
from pmsm_ctrl.workbench.server import opened_by
from tests.unit.workbench.harness import DESIGN, TOKEN, Bench, Page


def test_the_token_is_needed(bench: Bench) -> None:
    client = bench.client()
    for path in ("/", "/s/abcdefghjkmn/", "/wrong/", f"/{TOKEN}x/", "/static/workbench.js"):
        assert client.get(path).status_code == 404
    assert client.get(f"/{TOKEN}/static/workbench.js").status_code == 200


@pytest.mark.parametrize("host", ["evil.example", "evil.example:8720", "127.0.0.1:80", "127.0.0.1.evil.example:8720"])
def test_another_name_is_refused(bench: Bench, host: str) -> None:
    """An address that an attacker's name server points to this machine (DNS rebinding)."""
    assert bench.client().get(f"/{TOKEN}/", headers={"host": host}).status_code == 421


@pytest.mark.parametrize(("host", "status"), [("192.168.1.5:8720", 200), ("192.168.1.6:8720", 421), ("axis:8720", 421)])
def test_a_server_for_all_addresses_answers_at_the_number_that_was_called(host: str, status: int) -> None:
    """``--host 0.0.0.0`` cannot list the numbers of every network card; a rebound name is none of them."""
    sent: list[dict[str, Any]] = []

    async def app(scope: Any, receive: Any, send: Any) -> None:
        await send({"type": "http.response.start", "status": 200, "headers": []})

    async def send(message: Any) -> None:
        sent.append(message)

    headers = [(b"host", host.encode()), (b"origin", f"http://{host}".encode())]
    scope = {"type": "http", "method": "GET", "path": f"/{TOKEN}/", "headers": headers, "server": ("192.168.1.5", 8720)}
    asyncio.run(Guard(app, TOKEN, frozenset({"localhost:8720"}), 100)(scope, None, send))
    assert sent[0]["status"] == status


def test_the_address_without_its_last_slash_leads_to_the_one_with_it(bench: Bench) -> None:
    answer = bench.client().get(f"/{TOKEN}", follow_redirects=False)
    assert (answer.status_code, answer.headers["location"]) == (308, f"/{TOKEN}/")


def test_the_browser_is_not_started_with_the_token(tmp_path: Path) -> None:
    """Every user sees the words that a program was started with; a page for this user alone tells the address."""
    page = opened_by(tmp_path, f"http://127.0.0.1:8720/{TOKEN}/")
    assert TOKEN not in page.as_uri()
    assert f"url=http://127.0.0.1:8720/{TOKEN}/" in page.read_text(encoding="utf-8")
    if os.name == "posix":
        assert page.stat().st_mode & 0o077 == 0


def test_a_page_is_visited_from_anywhere_and_nothing_else_is(page: Page) -> None:
    visit = {"sec-fetch-site": "cross-site", "sec-fetch-mode": "navigate", "sec-fetch-dest": "document"}
    assert page.get("", headers=visit).status_code == 200
    assert page.get("", headers=visit | {"sec-fetch-dest": "iframe"}).status_code == 403
    assert page.get("state", headers={"sec-fetch-site": "cross-site", "sec-fetch-mode": "cors"}).status_code == 403
    assert page.client.post(f"{page.base}/design", json={}, headers=visit).status_code == 403


@pytest.mark.parametrize(
    "headers",
    [{"origin": "http://evil.example"}, {"origin": "null"}, {"origin": "https://127.0.0.1:8720"},
     {"origin": "http://127.0.0.1:9999"}, {"sec-fetch-site": "cross-site"}, {"sec-fetch-site": "same-site"}],
)  # fmt: skip
def test_another_origin_is_refused(page: Page, headers: dict[str, str]) -> None:
    for answer in (
        page.client.post(f"{page.base}/design", json={"example": "seed_motor"}, headers=headers),
        page.get("state", headers=headers),
    ):
        assert answer.status_code == 403
    assert page.get("state").json()["design"] is None
    assert page.get("state", headers={"origin": "http://localhost:8720"}).status_code == 200


def test_every_answer_carries_the_headers(page: Page) -> None:
    for path in ("", "state", "nothing", "view/nothing"):
        headers = page.get(path).headers
        policy = headers["content-security-policy"]
        assert "script-src 'self';" in policy
        assert "unsafe-eval" not in policy
        assert "frame-ancestors 'none'" in policy
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["referrer-policy"] == "no-referrer"
        assert "access-control-allow-origin" not in headers


def test_the_page_has_no_inline_script_or_handler(page: Page) -> None:
    text = page.get("").text
    assert "<script>" not in text
    assert not re.search(r"\son\w+=|javascript:|https?://", text)


@pytest.mark.parametrize("path", ["../session.json", "..%2f..%2fetc%2fpasswd", "live.py", "%2e%2e/app.py", "bokeh.js"])
def test_static_files_are_those_of_a_list(page: Page, path: str) -> None:
    assert page.client.get(f"/{TOKEN}/static/{path}").status_code == 404


def test_no_name_from_the_browser_reaches_the_disk(bench: Bench, page: Page, files: dict[str, bytes]) -> None:
    page.post("design", {"toml": DESIGN, "name": "../../d.toml"})
    for name in ("../../../evil.csv", "/etc/passwd", "a\x00b.csv", "..\\..\\x.py", "<script>alert(1)</script>.csv"):
        assert page.put(name, files["a.csv"]).status_code == 200
    state = page.idle()
    assert state["logs"][0]["name"] == "../../../evil.csv"  # shown as text, and only shown
    kept = {path.name for path in bench.folder.rglob("*") if path.is_file() and "curves" not in path.parent.name}
    assert kept == {"session.json", "log1.csv", "log2", "log3.csv", "log4.py", "log5.csv"}
    outside = [path for path in bench.folder.parent.iterdir() if path != bench.folder]
    assert not outside


def test_an_answer_does_not_wait_for_an_acknowledgement() -> None:
    """What asyncio asks a socket for before it switches Nagle's algorithm off; a zoom took 40 ms longer without."""
    import socket

    from pmsm_ctrl.workbench.server import listening

    with listening("127.0.0.1", 0) as found:
        assert found.proto == socket.IPPROTO_TCP
        assert found.getsockname()[0] == "127.0.0.1"


@pytest.mark.parametrize("session", ["..", "../x", "ABCDEFGHJKMN", "short", "%2e%2e%2f%2e%2e%2fx", "abcdefghjkmn.."])
def test_a_session_is_twelve_letters(bench: Bench, session: str) -> None:
    assert bench.client().get(f"/{TOKEN}/s/{session}/state").status_code in (400, 404)
    assert not list(bench.folder.glob("*"))


def test_an_upload_has_a_bound(tmp_path, files: dict[str, bytes]) -> None:  # type: ignore[no-untyped-def]
    bench = Bench(tmp_path / "s", limit=150_000)
    with bench.client() as client:
        page = Page(client, f"/{TOKEN}/s/abcdefghjkmn")
        page.post("design", {"toml": DESIGN})
        assert page.put("a.csv", files["a.csv"]).status_code == 413  # as announced

        def pieces():  # type: ignore[no-untyped-def]
            yield from (b"0,1,2,3\n" * 1000 for _ in range(100))

        answer = client.put(f"{page.base}/logs", params={"name": "a.csv"}, content=pieces())
        assert answer.status_code == 413  # as counted
        assert page.idle()["logs"] == []
        assert not list(bench.folder.rglob("*.part"))


@pytest.mark.parametrize(
    ("path", "body"),
    [("steps", {"run": "rm -rf"}), ("steps", {"add": "coulomb"}), ("design", {}), ("design", {"toml": "x = 1"}),
     ("design", {"example": "../seed_motor"}), ("logs/log9", {"role": "fit"}), ("design", {"answers": 3})],
)  # fmt: skip
def test_what_makes_no_sense_is_refused_in_words(page: Page, path: str, body: dict[str, object]) -> None:
    answer = page.post(path, body)
    assert answer.status_code in (400, 422)
    assert answer.json()["error"]
    assert "Traceback" not in answer.text


@pytest.mark.parametrize("body", [b"", b"[]", b"{", b"\xff", b"[" * 100_000])
def test_a_body_that_is_no_object_is_refused(page: Page, body: bytes) -> None:
    assert page.client.post(f"{page.base}/design", content=body).status_code == 400


def test_a_server_on_an_ipv6_address_answers_under_it(bench: Bench) -> None:
    from pmsm_ctrl.workbench.server import Settings, guarded

    guard = guarded(bench.desk, Settings(folder=bench.folder, host="2001:db8::1"), 8720)
    assert "[2001:db8::1]:8720" in guard.hosts


@pytest.mark.parametrize("since", ["\u00b2", "9" * 5000, "-1", "x"])
def test_a_revision_that_is_none_does_not_wait(page: Page, since: str) -> None:
    assert page.get("state", params={"since": since}).status_code == 200


def test_what_a_request_lacks_is_named(page: Page) -> None:
    for path, body, said in (
        ("design", {"answers": {}}, "name: missing in the request"),
        ("design", {"name": "a", "machine": "rotary"}, "answers: missing in the request"),
    ):
        answer = page.post(path, body)
        assert (answer.status_code, answer.json()) == (400, {"error": said})
    assert page.get("view/log").json() == {"error": "log: missing in the request"}


def test_a_defect_is_no_fault_of_the_request(
    page: Page, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def broken(*_: object) -> None:
        raise KeyError("torque")

    monkeypatch.setattr("pmsm_ctrl.workbench.desk.Desk.step", broken)
    answer = page.post("steps", {"begin": True})
    assert (answer.status_code, answer.json()) == (500, {"error": "unexpected KeyError: 'torque'. Please report it"})
    assert "Traceback" in capsys.readouterr().err
