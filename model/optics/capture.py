"""Writes capture folders of a simulated rig, in the form that the README describes."""

import csv
from functools import cache

import cv2
import numpy as np

from . import render, scenes
from .rigs import Rig, nominal

__all__ = ["chessboard", "texture_frame", "write"]

_PHOTOGRAPHS = 16
_PLANES = 12
_FINE = 4  # samples along a side of a pixel of the photographs
_DARK, _LIGHT = 40.0, 200.0


@cache
def _rays(camera):
    """Directions (samples, 3) in which the samples of all pixels look."""
    v, u = (np.mgrid[:camera.height * _FINE, :camera.width * _FINE] + 0.5) / _FINE - 0.5
    ray = camera.normalise(np.stack([u, v], axis=-1).reshape(-1, 2))
    return np.concatenate([ray, np.ones((len(ray), 1))], axis=1)


def chessboard(rig: Rig, rng: np.random.Generator) -> np.ndarray:
    """A photograph (uint8, height x width) of the rig's chessboard in a random pose.

    The pose is drawn until the whole board, with half a square around it, is in the picture. Every
    pixel is the mean of 4 x 4 rays through the lens.
    """
    camera, board = rig.camera, rig.board
    corners = np.array([board.columns + 2, board.rows + 2]) * board.square_mm
    outline = np.array([[x, y, 0] for x in (0, 1) for y in (0, 1)]) * [*corners, 1]
    outline -= [*corners / 2, 0]
    # From this distance the board fills the picture.
    nearest = camera.focal_px * max(corners / (camera.width, camera.height))
    for _ in range(10_000):
        turn, _ = cv2.Rodrigues(np.append(rng.uniform(-0.55, 0.55, 2), rng.uniform(-0.3, 0.3)))
        distance = nearest * rng.uniform(0.95, 1.6)
        aside = rng.uniform(-0.5, 0.5, 2) * (camera.width, camera.height) / camera.focal_px
        shift = distance * np.array([*aside, 1.0])
        if camera.inside(camera.project(outline @ turn.T + shift), 1.0).all():
            break
    else:
        raise RuntimeError(f"the chessboard of the rig {rig.name} never fits into its picture")

    ray = _rays(camera)
    reach = (shift @ turn[:, 2]) / (ray @ turn[:, 2])
    place = ((ray * reach[:, None] - shift) @ turn[:, :2] + corners / 2) / board.square_mm
    square = np.floor(place - 0.5).astype(int)
    printed = ((square >= 0) & (square < [board.columns + 1, board.rows + 1])).all(axis=1)
    levels = np.where(printed & (square.sum(axis=1) % 2 == 0), _DARK, _LIGHT)
    levels = levels.reshape(camera.height, _FINE, camera.width, _FINE).mean(axis=(1, 3))
    levels = cv2.GaussianBlur(levels, (0, 0), 0.6) * render.vignette(rig)
    return render.expose(rig, levels, rng)


def texture_frame(rig: Rig, rng: np.random.Generator) -> np.ndarray:
    """A texture frame (uint8, height x width): the tissue in visible light, without laser."""
    tissue = render.background(rig, rng)
    return render.expose(rig, tissue * (130 / max(tissue.mean(), 1e-9)), rng)


def _toml(rig, values):
    base = ", ".join(map(str, values.base_mm))
    return (
        f"# Simulated rig '{rig.name}'. The nominal values are off, as a real drawing's are.\n"
        f"[sensor]\nwidth = {rig.camera.width}\nheight = {rig.camera.height}\n"
        f"focal_px = {values.focal_px}\n\n"
        f"[projector]\nrows = {rig.projector.rows}\ncolumns = {rig.projector.columns}\n"
        f"pitch_deg = {values.pitch_deg}\nrotation_deg = {values.rotation_deg}\n"
        f"toe_in_deg = {values.toe_in_deg}\nbase_mm = [{base}]\n\n"
        f"[lens]\nboard_columns = {rig.board.columns}\nboard_rows = {rig.board.rows}\n"
        f"square_mm = {rig.board.square_mm}\n")


def _save(path, image):
    if not cv2.imwrite(str(path), image):
        raise OSError(f"{path} could not be written")


def write(rig: Rig, kind: str, folder, frames: int, seed: int, progress=None) -> None:
    """Write a capture into an empty folder; the same seed gives the same bytes.

    Parameters
    ----------
    kind : :class:`str`
        One of `scenes.KINDS`.
    folder : :class:`pathlib.Path`
        An existing, empty folder.
    frames : :class:`int`
        Pattern frames to be measured, with texture frames and truth.
    progress : callable, optional
        Called with the pictures written and their number.
    """
    # A generator for each part: more frames do not change the chessboards.
    lens, planes, poses, measured, off = (
        np.random.default_rng([seed, part]) for part in range(5))
    sequence = scenes.sequence(kind, rig, frames, poses)
    total = _PHOTOGRAPHS + _PLANES + frames
    done = 0

    def step():
        nonlocal done
        done += 1
        if progress:
            progress(done, total)

    (folder / "capture.toml").write_text(_toml(rig, nominal(rig, off)))
    (folder / "lens").mkdir()
    for number in range(_PHOTOGRAPHS):
        _save(folder / "lens" / f"{number:02}.png", chessboard(rig, lens))
        step()

    (folder / "planes").mkdir()
    with open(folder / "planes" / "planes.csv", "w", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["file", "z_mm"])
        for number, z_mm in enumerate(rig.calibration_planes(_PLANES)):
            image, _ = render.pattern_frame(rig, scenes.Plane(float(z_mm)), planes)
            _save(folder / "planes" / f"{number:02}.png", image)
            table.writerow([f"{number:02}.png", z_mm])
            step()

    (folder / "frames").mkdir()
    with open(folder / "truth.csv", "w", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["frame", "beam", "u_px", "v_px", "x_mm", "y_mm", "z_mm", "inside"])
        for number, scene in enumerate(sequence):
            image, truth = render.pattern_frame(rig, scene, measured)
            _save(folder / "frames" / f"{number:04}_ir.png", image)
            _save(folder / "frames" / f"{number:04}_texture.png", texture_frame(rig, measured))
            for row in truth:
                places = ("" if np.isnan(row[name]) else f"{row[name]:.6f}"
                          for name in ("u_px", "v_px", "x_mm", "y_mm", "z_mm"))
                table.writerow([number, row["beam"], *places, int(row["inside"])])
            step()
