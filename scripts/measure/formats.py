"""A frame's surface as PLY, GLB and PCD; the same frame gives the same octets."""

import json
import struct

import numpy as np

from scripts.results.cloud import (
    UNKNOWN,
    colours_at,
    pcd_head,
    pcd_lines,
    ply_head,
    ply_lines,
    vertices,
)
from scripts.results.colour import to_file
from scripts.results.mesh import vertex_normals

__all__ = ["FORMATS", "glb", "pcd", "ply"]


def _rows(surface, texture, came, seconds):
    return vertices(surface.points, surface.triangle, colours_at(surface.points, texture, came),
                    seconds)


def ply(surface, texture, came, seconds):
    """The points as in points.ply, and the triangles between them, as text.

    Parameters
    ----------
    surface : :class:`scripts.measure.surface.Surface`
        Of a frame.
    texture : array (height, width) or (height, width, 3) of uint8
        The picture, grey or in red, green, blue.
    came : array (height, width) of :class:`bool`
        Where there is one.
    seconds : :class:`float`
        The frame's time.
    """
    rows = _rows(surface, texture, came, seconds)
    faces = "".join(f"3 {a} {b} {c}\n" for a, b, c in surface.triangle)
    return (ply_head(len(rows), f"frame {surface.frame}", len(surface.triangle))
            + ply_lines(rows) + faces).encode()


def pcd(surface, texture, came, seconds):
    """The points as PCD, the same fields as in the PLY; arguments as for :func:`ply`."""
    rows = _rows(surface, texture, came, seconds)
    return (pcd_head(len(rows), f"frame {surface.frame}") + pcd_lines(rows)).encode()


class _Buffer:
    """The binary part of a GLB, and what describes it."""

    def __init__(self):
        self.octets, self.views, self.accessors = b"", [], []

    def add(self, octets, **more):
        self.octets += b"\0" * (-len(self.octets) % 4)
        self.views.append({"buffer": 0, "byteOffset": len(self.octets),
                           "byteLength": len(octets), **more})
        self.octets += octets
        return len(self.views) - 1

    def accessor(self, array, kind, target, **more):
        code = {np.dtype(np.float32): 5126, np.dtype(np.uint32): 5125}[array.dtype]
        self.accessors.append({
            "bufferView": self.add(array.tobytes(), target=target), "componentType": code,
            "count": array.size if kind == "SCALAR" else len(array), "type": kind, **more})
        return len(self.accessors) - 1


def glb(surface, texture, came, seconds):
    """The textured surface as binary glTF 2.0, in metres and upright; arguments as for
    :func:`ply`."""
    import cv2
    buffer, content = _Buffer(), {}
    if len(surface.triangle):
        points = surface.points
        height, width = came.shape
        uv = np.stack([(points["u"] + 0.5) / width, (points["v"] + 0.5) / height], axis=-1)
        xyz = surface.xyz.astype(np.float32)
        normals = vertex_normals(surface.xyz, surface.triangle)
        normals[~normals.any(axis=1)] = [0, 0, -1]
        primitive = {
            "attributes": {
                "POSITION": buffer.accessor(xyz, "VEC3", 34962, min=xyz.min(axis=0).tolist(),
                                            max=xyz.max(axis=0).tolist()),
                "NORMAL": buffer.accessor(normals.astype(np.float32), "VEC3", 34962),
                "TEXCOORD_0": buffer.accessor(uv.astype(np.float32), "VEC2", 34962)},
            "indices": buffer.accessor(surface.triangle.astype(np.uint32).ravel(), "SCALAR",
                                       34963),
            "material": 0}
        shown = to_file(texture.copy())
        shown[~came] = UNKNOWN
        done, data = cv2.imencode(".png", shown, [cv2.IMWRITE_PNG_COMPRESSION, 6])
        assert done
        picture = buffer.add(data.tobytes())
        content = {
            "meshes": [{"primitives": [primitive]}],
            "materials": [{"doubleSided": True, "pbrMetallicRoughness": {
                "baseColorTexture": {"index": 0}, "metallicFactor": 0, "roughnessFactor": 1}}],
            "textures": [{"source": 0}],
            "images": [{"bufferView": picture, "mimeType": "image/png"}],
            "accessors": buffer.accessors, "bufferViews": buffer.views,
            "buffers": [{"byteLength": len(buffer.octets) + -len(buffer.octets) % 4}]}
    node = {"name": f"frame {surface.frame}", "scale": [0.001, 0.001, 0.001],
            "rotation": [1, 0, 0, 0], "extras": {"seconds": round(seconds, 6)}}
    text = json.dumps({
        "asset": {"version": "2.0", "generator": "cyclope"}, "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{**node, **({"mesh": 0} if content else {})}], **content}).encode()
    parts = [(b"JSON", text + b" " * (-len(text) % 4))]
    if content:
        parts.append((b"BIN\0", buffer.octets + b"\0" * (-len(buffer.octets) % 4)))
    body = b"".join(struct.pack("<I4s", len(octets), kind) + octets for kind, octets in parts)
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


#: Writers by the endings of their files, and the types of those.
FORMATS = {"ply": (ply, "application/octet-stream"), "glb": (glb, "model/gltf-binary"),
           "pcd": (pcd, "application/octet-stream")}
