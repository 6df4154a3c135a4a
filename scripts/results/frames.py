"""Which frames were named on the command line, and which number each has."""

import re
from dataclasses import dataclass
from pathlib import Path

from model.errors import UserError

__all__ = ["SUFFIXES", "Entry", "check_images", "find_frames"]

SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm")
_NUMBERED = re.compile(r"(\d+)(_ir)?")


@dataclass(frozen=True)
class Entry:
    """A frame to measure: its number, its pattern image and, maybe, its texture image."""

    index: int
    path: Path
    texture: Path | None = None


def _images(folder):
    try:
        paths = [path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES]
    except OSError as error:
        raise UserError(f"{folder} cannot be read: {error.strerror}.") from error
    return [path for path in paths
            if not path.stem.endswith("_texture") and not path.name.startswith(".")]


def _number(paths):
    """Numbers of the frames, if the files' names are numbers and no two are the same."""
    found = [_NUMBERED.fullmatch(path.stem) for path in paths]
    numbers = [int(match[1]) for match in found if match]
    distinct = len(numbers) == len(paths) and len(set(numbers)) == len(numbers)
    return numbers if distinct and max(numbers, default=0) < 2**31 else None


def find_frames(targets):
    """Frames named on the command line, in order, and the table of truth beside them.

    Parameters
    ----------
    targets : list of path
        One capture folder or one folder of images, or any number of images.

    Returns
    -------
    (list of :class:`Entry`, path or None)
    """
    targets = [Path(target) for target in targets]
    folders = [target for target in targets if target.is_dir()]
    for target in targets:
        if not target.exists():
            raise UserError(f"{target} does not exist.")
    if folders and len(targets) > 1:
        raise UserError(f"{folders[0]} is a folder: name one folder, or image files only.")
    truth = None
    if folders:
        folder, = folders
        if (folder / "capture.toml").exists() or (folder / "frames").is_dir():
            folder = folder / "frames"
            if not folder.is_dir():
                raise UserError(f"{folder} does not exist: a capture holds its frames there.")
        home = folder.parent if folder.resolve().name == "frames" else folder
        truth = home / "truth.csv" if (home / "truth.csv").exists() else None
        paths = _images(folder)
        pattern = [path for path in paths if path.stem.endswith("_ir")]
        paths = pattern or paths
        if not paths:
            raise UserError(f"{folder} holds no images ({' '.join(SUFFIXES)}).")
    else:
        paths = list(dict.fromkeys(targets))
    numbers = _number(paths)
    order = sorted(paths) if numbers is None else [
        path for _, path in sorted(zip(numbers, paths, strict=True))]
    numbers = range(len(paths)) if numbers is None else sorted(numbers)
    return [Entry(number, path, _texture_of(path))
            for number, path in zip(numbers, order, strict=True)], truth


def _texture_of(path):
    if not path.stem.endswith("_ir"):
        return None
    for suffix in SUFFIXES:
        texture = path.with_name(path.stem[:-3] + "_texture" + suffix)
        if texture.exists():
            return texture
    return None


def check_images(entries, width, height):
    """Read every image once, so that a bad one is refused before any work is done."""
    from calibration.capture import read_image
    for entry in entries:
        for path in filter(None, (entry.path, entry.texture)):
            read_image(path, width, height)
