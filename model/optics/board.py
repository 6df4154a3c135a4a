"""Photographs of the chessboard, in poses that fill the image together."""

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from .conditions import PLAIN, Conditions
from .exposure import expose, vignette
from .rigs import Rig

__all__ = ["BoardPose", "photograph"]

@lru_cache(maxsize=2)
def _rays(camera, fine: int) -> np.ndarray:
    """Normalised coordinates (float32) of fine x fine samples in each pixel."""
    v = (np.arange(camera.height * fine) + 0.5) / fine - 0.5
    u = (np.arange(camera.width * fine) + 0.5) / fine - 0.5
    return camera.normalise(np.stack(np.meshgrid(u, v), axis=-1)).astype(np.float32)


@dataclass(frozen=True)
class BoardPose:
    """The board's first outer corner (mm, camera coordinates) and its directions (columns of a
    rotation matrix): along the columns' index, along the rows' index, away from the camera."""

    corner_mm: np.ndarray
    rotation: np.ndarray

    def points(self, board, squares: np.ndarray) -> np.ndarray:
        """Positions in space of points (..., 2) of the board, in squares from its outer corner."""
        return self.corner_mm + board.square_mm * (
            np.asarray(squares, dtype=float) @ self.rotation[:, :2].T)

    def corners(self, rig: Rig) -> np.ndarray:
        """Image coordinates of the inner corners (rows * columns, 2), row by row."""
        row, column = np.divmod(np.arange(rig.board.rows * rig.board.columns), rig.board.columns)
        squares = np.stack([column + 1, row + 1], axis=-1)
        return rig.camera.project(self.points(rig.board, squares))


def draw_board(
    rig: Rig, pose: BoardPose, rng: np.random.Generator, fine: int = 4,
    conditions: Conditions = PLAIN,
) -> np.ndarray:
    """Photograph of the chessboard (uint8): fine x fine samples per pixel, blurred by the lens."""
    camera, board = rig.camera, rig.board
    columns, rows = board.columns + 1, board.rows + 1
    # Only the rectangle of pixels that the paper may cover is sampled: the paper, one square more
    # than the board on each side, is convex in space and nearly so in the image.
    side = np.linspace(0, 1, 9)
    outline = np.concatenate([
        np.stack(np.broadcast_arrays(x, y), axis=-1).reshape(-1, 2) for x, y in (
            (side * (columns + 2) - 1, -1), (side * (columns + 2) - 1, rows + 1),
            (-1, side * (rows + 2) - 1), (columns + 1, side * (rows + 2) - 1))])
    image = camera.project(pose.points(board, outline))
    limits = np.array([camera.width, camera.height])
    left, top = np.clip(np.floor(image.min(axis=0)).astype(int) - 2, 0, limits)
    right, bottom = np.clip(np.ceil(image.max(axis=0)).astype(int) + 3, 0, limits)
    rays = _rays(camera, fine)[top * fine:bottom * fine, left * fine:right * fine]
    # The plane's points are corner + R (x, y, 0): the homography's inverse takes rays to squares.
    plane = np.column_stack([pose.rotation[:, :2] * board.square_mm, pose.corner_mm])
    inverse = np.linalg.inv(plane).astype(np.float32)
    x, y = rays[..., 0], rays[..., 1]
    scale = inverse[2, 0] * x + inverse[2, 1] * y + inverse[2, 2]
    column = np.floor((inverse[0, 0] * x + inverse[0, 1] * y + inverse[0, 2]) / scale)
    row = np.floor((inverse[1, 0] * x + inverse[1, 1] * y + inverse[1, 2]) / scale)
    paper = (column >= -1) & (column <= columns) & (row >= -1) & (row <= rows)
    black = (column >= 0) & (column < columns) & (row >= 0) & (row < rows) & (
        (column + row) % 2 == 0)
    part = np.where(paper, np.where(black, np.float32(35), np.float32(205)), np.float32(120))
    levels = np.full((camera.height, camera.width), 120.0)
    levels[top:bottom, left:right] = part.reshape(
        bottom - top, fine, right - left, fine).mean(axis=(1, 3))
    levels = cv2.GaussianBlur(levels, (0, 0), 0.8 * rig.spots.blur_px)
    slope = rng.uniform(-0.15, 0.15, 2)
    u = np.linspace(-1, 1, camera.width)
    v = np.linspace(-1, 1, camera.height)[:, None]
    light = (1 + slope[0] * u + slope[1] * v) * (1 - 0.5 * (1 - vignette(rig)))
    return expose(rig, levels * light, rng, conditions.of_rig())


#: Directions in which the boards are shifted, in turn, so that together they fill the image.
_TOWARDS = ((0, 0), (-1, -1), (1, 1), (1, -1), (-1, 1), (-1, 0), (1, 0), (0, -1), (0, 1))


def board_pose(rig: Rig, number: int, rng: np.random.Generator) -> BoardPose:
    """A pose for photograph `number`: tilted, and shifted to one side up to the border."""
    camera, board = rig.camera, rig.board
    columns, rows = board.columns + 1, board.rows + 1
    outline = np.array([[x, y] for x in (-0.4, columns / 2, columns + 0.4)
                        for y in (-0.4, rows / 2, rows + 0.4)])
    tilt = 0.6 if camera.width > 128 else 0.45
    towards = np.array(_TOWARDS[number % len(_TOWARDS)])
    while True:
        turn, _ = cv2.Rodrigues(np.array([*rng.uniform(-tilt, tilt, 2), rng.uniform(-0.25, 0.25)]))
        share = rng.uniform(0.55, 0.9) if camera.width > 128 else rng.uniform(0.78, 0.95)
        distance = camera.focal_px * board.square_mm * max(
            columns / camera.width, rows / camera.height) / share
        middle = turn[:, :2] @ (np.array([columns, rows]) / 2 * board.square_mm)

        def pose(push, turn=turn, middle=middle, distance=distance):
            aside = np.array([*(push * towards * distance), 0])
            return BoardPose(np.array([0, 0, distance]) + aside - middle, turn)

        def fits(push, pose=pose):
            points = pose(push).points(board, outline)
            return (points[:, 2] > 0.2 * distance).all() and camera.inside(  # noqa: B023
                camera.project(points), 1.5).all()

        if not fits(0.0):
            continue
        low, high = 0.0, 1.0
        for _ in range(12):
            half = (low + high) / 2
            low, high = (half, high) if fits(half) else (low, half)
        return pose(low)


def photograph(
    rig: Rig, number: int, rng: np.random.Generator, conditions: Conditions = PLAIN
) -> tuple[np.ndarray, BoardPose]:
    """A photograph on which OpenCV finds every inner corner, and the board's pose."""
    size = rig.board.columns, rig.board.rows
    while True:
        pose = board_pose(rig, number, rng)
        image = draw_board(rig, pose, rng, conditions=conditions)
        if cv2.findChessboardCorners(image, size)[0]:
            return image, pose
