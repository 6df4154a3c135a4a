"""PLY, GLB and PCD of a surface, read back by other programs' rules."""

import json
import struct

import cv2
import numpy as np
import pytest

from model.optics.scenes import Plane
from scripts.measure.formats import glb, pcd, ply
from scripts.measure.surface import Surface
from scripts.results.cloud import (
    CloudFiles,
    colours_at,
    ply_head,
    ply_lines,
    surface_triangles,
    vertices,
)
from scripts.results.points import DOUBTFUL, OK
from tb.host.clouds import read_pcd, read_ply
from tb.view.bench import history_of


@pytest.fixture(scope="module")
def frame():
    history = history_of([Plane(60, 20, 20)], side=7)[1]
    moment = history.moment(0)
    grey, when = history.texture(0)
    return Surface(moment.points, history.calibration), grey, np.isfinite(when), 1.25


def test_ply(frame):
    surface, grey, *_ = frame
    found, faces = read_ply(ply(*frame))
    assert list(found) == ["x", "y", "z", "nx", "ny", "nz", "red", "green", "blue", "beam",
                           "frame", "status", "time"]
    assert np.allclose(np.stack([found[name] for name in "xyz"], axis=1), surface.xyz, atol=1e-4)
    normals = np.stack([found[name] for name in ("nx", "ny", "nz")], axis=1)
    assert np.allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-3)
    # The plane's normal, towards the camera.
    assert np.allclose(normals, -Plane(60, 20, 20).normal, atol=0.05)
    seen = grey[np.rint(surface.points["v"]).astype(int), np.rint(surface.points["u"]).astype(int)]
    assert set(seen) == {90, 160}
    for name in ("red", "green", "blue"):
        assert (found[name] == seen).all()
    assert (found["beam"] == surface.points["beam"]).all()
    assert (found["frame"] == 10).all() and (found["status"] == OK).all()
    assert (found["time"] == 1.25).all() and np.array_equal(faces, surface.triangle)


def test_pcd_has_the_same_fields(frame):
    (wanted, _), found = read_ply(ply(*frame)), read_pcd(pcd(*frame))
    assert list(found) == list(wanted)
    for name, column in wanted.items():
        assert np.array_equal(found[name], column) and found[name].itemsize == column.itemsize


def test_points_beside_the_surface_have_no_normal(frame):
    """Neither doubtful ones nor those without neighbours; all that is written is finite."""
    surface, grey, came, _ = frame
    beam = surface.points["beam"]
    points = surface.points[np.isin(beam, (0, 16)) | (beam > 27)]
    points["status"][9] = DOUBTFUL
    rows = vertices(points, surface_triangles(points, surface.calibration.columns),
                    colours_at(points, grey, came))
    bare = (rows["nx"] == 0) & (rows["ny"] == 0) & (rows["nz"] == 0)
    assert np.flatnonzero(bare).tolist() == [0, 1, 9] and rows["status"][9] == DOUBTFUL
    found, _ = read_ply((ply_head(len(rows), "test") + ply_lines(rows)).encode())
    assert np.allclose(found["nz"], rows["nz"], atol=1e-4)


def test_a_frame_gets_the_picture_that_comes_after_it(frame, tmp_path):
    """Until the next frame comes: as with a single pair, whose texture is second."""
    surface, grey, came, _ = frame
    later, nothing = surface.points.copy(), np.zeros_like(came)
    later["frame"] += 2
    clouds = CloudFiles(tmp_path)
    for points in (surface.points, later):
        clouds.add(points, surface.calibration.columns, 0.0, grey, nothing)
    clouds.finish(grey, came)
    clouds.close()
    found, _ = read_ply((tmp_path / "points.ply").read_bytes())
    assert set(found["red"][found["frame"] == 10]) == {128}
    assert set(found["red"][found["frame"] == 12]) == {90, 160}


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
    columns, faces = read_ply(ply(empty, grey, came, seconds))
    assert not len(columns["x"]) and not len(faces)
    assert not len(read_pcd(pcd(empty, grey, came, seconds))["x"])
    assert "meshes" not in parts(glb(empty, grey, came, seconds))[0]
    nothing = np.zeros_like(came)
    assert set(read_ply(ply(surface, grey, nothing, seconds))[0]["green"]) == {128}
