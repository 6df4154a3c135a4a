"""PLY, GLB and PCD of a surface, read back by other programs' rules."""

import json
import struct

import cv2
import numpy as np
import pytest

from model.optics.scenes import Plane
from scripts.measure.formats import glb, pcd, ply
from scripts.measure.surface import Surface
from tb.view.bench import history_of


@pytest.fixture(scope="module")
def frame():
    history = history_of([Plane(60, 20, 20)], side=7)[1]
    moment = history.moment(0)
    grey, when = history.texture(0)
    return Surface(moment.points, history.calibration), grey, np.isfinite(when), 1.25


def test_ply(frame):
    surface = frame[0]
    head, _, body = ply(*frame).decode().partition("end_header\n")
    lines = body.splitlines()
    count = len(surface.xyz)
    assert f"element vertex {count}\n" in head and f"element face {len(surface.triangle)}\n" in head
    assert head.count("property") == 12
    vertices = np.array([line.split() for line in lines[:count]], float)
    faces = np.array([line.split() for line in lines[count:]], int)
    assert np.allclose(vertices[:, :3], surface.xyz, atol=1e-4)
    assert np.allclose(np.linalg.norm(vertices[:, 3:6], axis=1), 1, atol=1e-3)
    # The plane's normal, towards the camera.
    assert np.allclose(vertices[:, 3:6], -Plane(60, 20, 20).normal, atol=0.05)
    assert set(vertices[:, 6]) <= {90.0, 160.0} and (vertices[:, 6] == vertices[:, 8]).all()
    assert (vertices[:, 9] == surface.points["beam"]).all() and (vertices[:, 10] == 1.25).all()
    assert (faces[:, 0] == 3).all() and np.array_equal(faces[:, 1:], surface.triangle)


def test_pcd(frame):
    lines = pcd(*frame).decode().splitlines()
    head = dict(line.split(" ", 1) for line in lines[1:11])
    assert head["POINTS"] == head["WIDTH"] == str(len(frame[0].xyz)) and head["DATA"] == "ascii"
    rows = np.array([line.split() for line in lines[11:]], float)
    assert rows.shape == (len(frame[0].xyz), len(head["FIELDS"].split()))
    assert np.allclose(rows[:, :3], frame[0].xyz, atol=1e-4)


def parts(octets):
    """Chunks of a GLB by their kinds."""
    magic, version, length = struct.unpack_from("<4sII", octets)
    assert (magic, version, length) == (b"glTF", 2, len(octets))
    found, at = {}, 12
    while at < len(octets):
        size, kind = struct.unpack_from("<I4s", octets, at)
        assert size % 4 == 0
        found[kind] = octets[at + 8:at + 8 + size]
        at += 8 + size
    return json.loads(found[b"JSON"]), found.get(b"BIN\0")


def test_glb(frame):
    surface, grey, *_ = frame
    content, binary = parts(glb(*frame))
    assert content["buffers"][0]["byteLength"] == len(binary)

    def array(number, kind, columns):
        accessor = content["accessors"][number]
        view = content["bufferViews"][accessor["bufferView"]]
        assert view["byteOffset"] % 4 == 0
        size = {"SCALAR": 1, "VEC2": 2, "VEC3": 3}[accessor["type"]]
        return np.frombuffer(binary, kind, accessor["count"] * size,
                             view["byteOffset"]).reshape(-1, columns)

    primitive, = content["meshes"][0]["primitives"]
    place = array(primitive["attributes"]["POSITION"], np.float32, 3)
    assert np.allclose(place, surface.xyz, atol=1e-4)
    accessor = content["accessors"][primitive["attributes"]["POSITION"]]
    assert np.allclose([accessor["min"], accessor["max"]], [place.min(axis=0), place.max(axis=0)])
    assert np.array_equal(array(primitive["indices"], np.uint32, 3), surface.triangle)
    uv = array(primitive["attributes"]["TEXCOORD_0"], np.float32, 2)
    assert (uv > 0).all() and (uv < 1).all()
    view = content["bufferViews"][content["images"][0]["bufferView"]]
    image = cv2.imdecode(np.frombuffer(
        binary, np.uint8, view["byteLength"], view["byteOffset"]), cv2.IMREAD_UNCHANGED)
    assert np.array_equal(image, grey)


def test_a_frame_without_surface_is_a_file_too(frame):
    surface, grey, came, seconds = frame
    empty = Surface(surface.points[:0], surface.calibration)
    assert b"element vertex 0\n" in ply(empty, grey, came, seconds)
    assert b"POINTS 0\n" in pcd(empty, grey, came, seconds)
    assert "meshes" not in parts(glb(empty, grey, came, seconds))[0]
    nothing = np.zeros_like(came)
    assert b" 128 128 128 " in ply(surface, grey, nothing, seconds)
