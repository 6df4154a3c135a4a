"""Capture folders of simulated rigs, with the truth of every frame."""

from pathlib import Path

import cv2
import numpy as np

from model.errors import UserError

from . import board, render, rigs, scenes
from .conditions import PLAIN, Conditions

#: Numbers of photographs of the chessboard and of the flat target in a capture.
PHOTOGRAPHS = 15
PLANES = 12

TRUTH_HEADER = "frame,beam,u_px,v_px,x_mm,y_mm,z_mm,inside"
#: Under conditions the table says also which spots can be seen in the picture, which beams are
#: dead, and the factor on their light.
CONDITIONS_HEADER = TRUTH_HEADER + ",visible,dead,light"

# Streams of random numbers of one seed: each image has its own, so that the number of frames
# does not change the images for the calibration.
_SCENES, _NOMINAL, _LENS, _PLANES, _FRAMES, _TEXTURES = range(6)


def image_count(frames: int) -> int:
    """Number of images that `write` writes."""
    return PHOTOGRAPHS + PLANES + 2 * frames


def most_octets(rig: rigs.Rig, frames: int) -> int:
    """Number of octets of a capture at the most; the images' noise hardly lets them shrink."""
    rows = (frames * rig.projector.rows * rig.projector.columns) * 120
    return image_count(frames) * (rig.camera.width * rig.camera.height + 4096) + rows


def toml(rig: rigs.Rig, nominal: rigs.Nominal) -> str:
    """Text of ``capture.toml``."""
    camera, projector, chessboard = rig.camera, rig.projector, rig.board
    return (
        f"# Simulated rig '{rig.name}': nominal values, not quite its true ones.\n"
        "[sensor]\n"
        f"width = {camera.width}\nheight = {camera.height}\nfocal_px = {nominal.focal_px}\n"
        + (f'bayer = "{camera.bayer}"\n' if camera.bayer else "") +
        "\n[projector]\n"
        f"rows = {projector.rows}\ncolumns = {projector.columns}\n"
        f"pitch_deg = {nominal.pitch_deg}\nrotation_deg = {nominal.rotation_deg}\n"
        f"toe_in_deg = {nominal.toe_in_deg}\n"
        f"base_mm = [{', '.join(map(str, nominal.base_mm))}]\n"
        "\n[lens]\n"
        f"board_columns = {chessboard.columns}\nboard_rows = {chessboard.rows}\n"
        f"square_mm = {chessboard.square_mm}\n"
    )


def truth_header(conditions: Conditions) -> str:
    """First line of ``truth.csv``."""
    return TRUTH_HEADER if conditions.plain else CONDITIONS_HEADER


def truth_rows(frame: int, truth: np.ndarray, conditions: Conditions = PLAIN) -> list[str]:
    """Lines of ``truth.csv`` of one frame; fields without a value are empty."""
    rows = []
    for beam in truth:
        values = [beam[name] for name in ("u_px", "v_px", "x_mm", "y_mm", "z_mm")]
        texts = ["" if np.isnan(value) else f"{value:.7f}" for value in values]
        more = [] if conditions.plain else [
            str(int(beam["visible"])), str(int(beam["light"] == 0)), f"{beam['light']:.4g}"]
        rows.append(",".join(
            [str(frame), str(beam["beam"]), *texts, str(int(beam["inside"])), *more]))
    return rows


def _save(path: Path, image: np.ndarray) -> None:
    _, data = cv2.imencode(".png", image)
    _write(path, data.tobytes())


def _write(path: Path, data: bytes) -> None:
    try:
        path.write_bytes(data)
    except OSError as error:
        raise UserError(f"{path} cannot be written: {error.strerror}.") from error


def _write_lines(path: Path, lines: list[str]) -> None:
    _write(path, ("\n".join(lines) + "\n").encode())


def write(
    folder, kind: str, rig: rigs.Rig, seed: int = 0, frames: int = 10, error: float = 1.0,
    progress=None, conditions: Conditions = PLAIN,
) -> None:
    """Fill an existing, empty folder with a whole capture; the same arguments give the same bytes.

    Parameters
    ----------
    folder : path
        The folder to fill.
    kind : :class:`str`
        One of `scenes.KINDS`.
    rig : :class:`rigs.Rig`
        The true rig.
    seed : :class:`int`
        Seed of all random numbers, 0 or more.
    frames : :class:`int`
        Pattern frames to measure, each with a texture frame.
    error : :class:`float`
        Scale of the errors of the nominal values; 1 is the default, 0 writes the true ones.
    progress : callable or None
        Called with the name of the folder after each image.
    conditions : :class:`.conditions.Conditions`
        Of the frames; the plane frames have those that belong to the rig.

    Raises
    ------
    UserError
        If a file cannot be written.
    """
    folder = Path(folder)

    def random(*stream):
        return np.random.default_rng([seed, *stream])

    def save(path, image):
        _save(path, image)
        if progress:
            progress(path.parent.name)

    sequence = scenes.sequence(kind, rig, frames, random(_SCENES))
    nominal = rigs.nominal(rig, random(_NOMINAL), error)
    _write(folder / "capture.toml", toml(rig, nominal).encode())
    for name in ("lens", "planes", "frames"):
        (folder / name).mkdir()
    for number in range(PHOTOGRAPHS):
        image, _ = board.photograph(rig, number, random(_LENS, number), conditions)
        save(folder / "lens" / f"{number:02}.png", image)
    rows = ["file,z_mm"]
    for number, z_mm in enumerate(rig.calibration_planes(PLANES)):
        image, _ = render.pattern_frame(
            rig, scenes.Plane(z_mm), random(_PLANES, number), conditions.of_rig(), number)
        save(folder / "planes" / f"{number:02}.png", image)
        rows.append(f"{number:02}.png,{z_mm:.2f}")
    _write_lines(folder / "planes" / "planes.csv", rows)
    rows = [truth_header(conditions)]
    for number, scene in enumerate(sequence):
        image, truth = render.pattern_frame(
            rig, scene, random(_FRAMES, number), conditions, number)
        save(folder / "frames" / f"{number:04}_ir.png", image)
        rows += truth_rows(number, truth, conditions)
        image = render.texture_frame(rig, scene, random(_TEXTURES, number), conditions)
        save(folder / "frames" / f"{number:04}_texture.png", image)
    _write_lines(folder / "truth.csv", rows)
