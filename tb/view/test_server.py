"""The page's server: its files, who may connect, the messages, and what is downloaded."""

import http.client
import json
from contextlib import contextmanager
from urllib.parse import urlsplit

import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from calibration import file
from model.optics.scenes import Plane
from scripts.cyclope import cli
from scripts.results.outputs import write_csv
from scripts.view.guard import Doorman
from tb.view.bench import ask, history_of, replay, serving


@pytest.fixture(scope="module")
def history():
    return history_of([Plane(60, 15, 20), Plane(62, 15, 20), Plane(64, 15, 20)])[1]


@pytest.fixture
def server(history, tmp_path):
    with serving(replay(history, tmp_path / "measurements.csv")) as served:
        yield served


def get(server, path, **headers):
    """Status, headers and content."""
    place = urlsplit(server.address)
    connection = http.client.HTTPConnection(place.hostname, place.port, timeout=10)
    try:
        connection.request("GET", path, headers=headers)
        answer = connection.getresponse()
        return answer.status, answer.headers, answer.read()
    finally:
        connection.close()


@contextmanager
def socket(server, origin="own", path="/socket", **more):
    place = urlsplit(server.address)
    own = f"http://{place.netloc}"
    with connect(f"ws://{place.netloc}{path}", origin=own if origin == "own" else origin,
                 max_size=None, compression=None, **more) as opened:
        yield opened


def test_files_and_their_headers(server):
    for path, kind in (("/", "text/html"), ("/main.js", "text/javascript"),
                       ("/three.js", "text/javascript"), ("/style.css", "text/css"),
                       ("/three-license.txt", "text/plain")):
        status, headers, content = get(server, path)
        assert status == 200 and headers["Content-Type"].startswith(kind) and len(content) > 500
        assert "default-src 'self'" in headers["Content-Security-Policy"]
        assert headers["X-Content-Type-Options"] == "nosniff"
    for path in ("/../setup.py", "/__init__.py", "/page/main.js", "/nothing"):
        assert get(server, path)[0] == 404, path


@pytest.mark.parametrize("host, origin", [
    ("evil.example:80", None), ("127.0.0.1", None), ("127.0.0.1:1", None), ("", None),
    (None, "http://evil.example"), (None, "null"), (None, "http://127.0.0.1:1")])
def test_foreign_pages_get_nothing(server, host, origin):
    headers = {} if host is None else {"Host": host}
    if origin is not None:
        headers["Origin"] = origin
    assert get(server, "/", **headers)[0] == 403
    assert get(server, "/measurements.csv", **headers)[0] == 403
    with pytest.raises(InvalidStatus) as refused, socket(server, origin or "http://x"):
        pass
    assert refused.value.response.status_code == 403


def test_a_socket_without_an_origin_is_refused(server):
    with pytest.raises(InvalidStatus) as refused, socket(server, None):
        pass
    assert refused.value.response.status_code == 403


def test_other_addresses_need_the_token():
    door = Doorman("0.0.0.0", 8000)
    own = {"host": "10.1.2.3:8000", "origin": "http://10.1.2.3:8000"}
    good = f"/socket?token={door.token}"
    assert door.refuse(good, **own, guarded=True, socket=True) is None
    for path in ("/socket", "/socket?token=", "/socket?token=x", f"/socket?tokens={door.token}"):
        assert "token" in door.refuse(path, **own, guarded=True, socket=True)
    assert "Another page" in door.refuse(good, "10.1.2.3:8000", "http://evil.example", True, True)
    assert door.refuse("/main.js", own["host"], None, guarded=False) is None
    assert len(door.token) > 15 and door.token != Doorman("0.0.0.0", 8000).token
    assert Doorman("127.0.0.1", 8000).token is None


def test_the_page_of_another_address_is_served_with_its_token(history):
    with serving(replay(history), host="0.0.0.0") as server:
        path = server.address.partition(":")[2].partition(":")[2].partition("/")[2]
        assert get(server, "/")[0] == 403
        assert get(server, "/" + path)[0] == 200
        assert get(server, "/measurements.csv")[0] == 403
        assert get(server, "/measurements.csv" + path)[0] == 200


@pytest.mark.parametrize("garbage", [
    "", "{", "[]", "7", "null", '{"do": 1}', '{"do": "fly"}', '{"do": "frame"}', "\x00" * 50,
    '{"do": "frame", "position": "x"}', '{"do": "measure", "kind": "x", "points": []}',
    '{"do": "measure", "kind": "ruler", "points": [[1]], "position": 0}',
    '{"do": "measure", "kind": "ruler", "points": 5, "position": 0}',
    '{"do": "chip", "action": "explode"}', '{"do": "remove", "number": "y"}',
    '{"do": "frame", "position": 1e999}', "[" * 5000])
def test_garbage_is_answered_and_nothing_is_lost(server, garbage):
    with socket(server) as opened:
        opened.send(garbage)
        while True:
            message = opened.recv(timeout=10)
            if isinstance(message, str) and json.loads(message)["type"] == "reply":
                break
        assert json.loads(message) == {
            "type": "reply", "id": None, "ok": False,
            "error": "This is no message of the page."}
        assert ask(opened, do="frame", position=1)["ok"]


def test_octets_and_long_messages_do_not_hurt_others(server):
    with socket(server) as other:
        for message in (b"\x00\xff" * 9, "x" * 100_000):
            with socket(server) as opened:
                opened.send(message)
        assert ask(other, do="frame", position=0)["ok"]


def test_what_cannot_be_done_is_said(server):
    with socket(server) as opened:
        for wish, sentence in (
                ({"do": "chip", "action": "start"}, "there is no chip to command"),
                ({"do": "chip", "action": "set", "registers": {"divisor": 3}}, "does not write"),
                ({"do": "chip", "action": "set", "registers": {"lit_gain": 640}},
                 "lit_gain must be 1 to 63, not 640."),
                ({"do": "remove", "number": 99}, "There is no measurement 99."),
                ({"do": "position", "frame": 11}, "There is no frame 11"),
                ({"do": "measure", "kind": "ruler", "position": 0, "points": [[1, 1], [2, 2]]},
                 "no measured surface at 1.0,1.0 in frame 10")):
            answer = ask(opened, **wish)
            assert not answer["ok"] and sentence in answer["error"], answer


def test_frames_are_what_was_measured(server, history):
    with socket(server) as opened:
        hello = json.loads(opened.recv(timeout=10))
        assert hello["type"] == "hello" and not hello["live"] and hello["rig"]["beams"] == 121
        opened.send('{"do": "frame", "position": 1}')
        while True:
            message = opened.recv(timeout=10)
            if isinstance(message, str) and (frame := json.loads(message))["type"] == "frame" and (
                    frame["position"] == 1):
                break
        points = history.moment(1).points
        assert frame["frame"] == 12 and len(frame["points"]) == len(points)
        assert [row[0] for row in frame["points"]] == points["beam"].tolist()
        assert max(abs(row[5] - z) for row, z in zip(frame["points"], points["z"],
                                                     strict=True)) < 1e-3
        assert len(frame["triangles"]) % 3 == 0 and len(frame["triangles"]) > 400
        assert frame["strip"]["ok"] == len(points) and frame["strip"]["lit"]


def test_the_page_measures_as_the_command_does(server, history, tmp_path, capsys):
    marks = [[120.0, 90.0], [200.25, 160.5]]
    with socket(server) as one, socket(server) as two:
        found = ask(one, do="measure", kind="ruler", position=2, points=marks)["result"]
        lists = []
        while not lists:
            message = two.recv(timeout=10)
            if isinstance(message, str) and json.loads(message)["type"] == "measurements":
                lists = json.loads(message)["list"]
        assert lists == [found]
    write_csv(tmp_path / "points.csv", history.moment(2).points)
    file.save(history.calibration, tmp_path / "calibration.json")
    assert cli.main(["measure", str(tmp_path), "--calibration", str(tmp_path / "calibration.json"),
                     "--frame", "14", "--points", "120,90", "200.25,160.5", "--format",
                     "json"]) == 0
    plain = json.loads(capsys.readouterr().out)
    assert abs(plain["length_mm"] - found["length_mm"]) < 2e-3
    assert abs(plain["uncertainty_mm"] - found["uncertainty_mm"]) < 2e-3
    # What is saved beside the recording is what is exported, and is there again the next time.
    saved = (tmp_path / "measurements.csv").read_bytes()
    assert saved == get(server, "/measurements.csv")[2] and saved.count(b"\n") == 2
    with serving(replay(history, tmp_path / "measurements.csv")) as again, socket(again) as opened:
        assert ask(opened, do="remove", number=1)["ok"]
    assert (tmp_path / "measurements.csv").read_bytes().count(b"\n") == 1


def test_exports_are_the_same_each_time(server):
    for kind in ("ply", "glb", "pcd"):
        status, headers, content = get(server, f"/frame.{kind}?frame=12")
        assert status == 200 and f'filename="frame-0012.{kind}"' in headers["Content-Disposition"]
        assert content == get(server, f"/frame.{kind}?frame=12")[2]
        assert content != get(server, f"/frame.{kind}?frame=14")[2]
        for wrong in ("", "?frame=x", "?frame=13", "?frame=-1"):
            assert get(server, f"/frame.{kind}{wrong}")[0] == 409
