"""Which frames were named on the command line, and which number each has."""

import re
from dataclasses import dataclass
from pathlib import Path

from calibration.files import list_names, unused_files
from calibration.image import SUFFIXES, read_image
from model.errors import UserError

__all__ = ["Entry", "Found", "check_images", "find_frames"]

_NUMBERED = re.compile(r"(\d+)(_ir)?", re.ASCII)


@dataclass(frozen=True)
class Entry:
    """A frame to measure: its number, its pattern image and, maybe, its texture image."""

    index: int
    path: Path
    texture: Path | None = None


@dataclass(frozen=True)
class Found:
    """The frames that were named.

    Parameters
    ----------
    entries : list of :class:`Entry`
        In order of their numbers.
    truth : :class:`~pathlib.Path` or None
        ``truth.csv`` of their capture.
    notes : list of :class:`str`
        What was named and is not used, and what decides the numbers where names do not.
    """

    entries: list
    truth: Path | None
    notes: list


def _images(folder):
    """Pattern images of a folder: those that end in _ir, if there are any."""
    try:
        paths = [path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES
                 and not path.stem.endswith("_texture") and not path.name.startswith(".")]
    except OSError as error:
        raise UserError(f"{folder} cannot be read: {error.strerror}.") from error
    paths = [path for path in paths if path.stem.endswith("_ir")] or paths
    if not paths:
        raise UserError(f"{folder} holds no images ({' '.join(SUFFIXES)}).")
    return paths


def _texture_of(path):
    if not path.stem.endswith("_ir"):
        return None
    for suffix in SUFFIXES:
        texture = path.with_name(path.stem[:-3] + "_texture" + suffix)
        if texture.exists():
            return texture
    return None


def _numbered(paths):
    """Frames in order, and a note if only some of their names are numbers."""
    matches = [_NUMBERED.fullmatch(path.stem) for path in paths]
    numbers = [int(match[1]) for match in matches if match]
    if len(set(numbers)) == len(paths) and max(numbers) < 2**31:
        order = sorted(zip(numbers, paths, strict=True))
    else:
        order = list(enumerate(sorted(paths)))
    entries = [Entry(number, path, _texture_of(path)) for number, path in order]
    if not numbers or [entry.index for entry in entries] == sorted(numbers):
        return entries, []
    return entries, ["frames are numbered by their position in the sorted list, from 0: not all "
                     "names are numbers, or some have the same"]


def find_frames(targets):
    """Frames named on the command line, and the table of truth of their capture.

    Parameters
    ----------
    targets : list of path
        One capture folder or one folder of images, or any number of images.

    Returns
    -------
    :class:`Found`

    Raises
    ------
    UserError
        If something does not exist, or no image is named.
    """
    targets = [Path(target) for target in targets]
    for target in targets:
        if not target.exists():
            raise UserError(f"{target} does not exist.")
    folders = [target for target in targets if target.is_dir()]
    if folders and len(targets) > 1:
        raise UserError(f"{folders[0]} is a folder: name one folder, or image files only.")
    if not folders:
        paths = list(dict.fromkeys(targets))
        twice = [str(path) for path in paths if targets.count(path) > 1]
        entries, notes = _numbered(paths)
        return Found(entries, None,
                     notes + ([f"named twice: {list_names(twice)}"] if twice else []))
    folder, = folders
    if (folder / "capture.toml").exists() or (folder / "frames").is_dir():
        folder = folder / "frames"
        if not folder.is_dir():
            raise UserError(f"{folder} does not exist: a capture holds its frames there.")
    home = folder.parent if folder.resolve().name == "frames" else folder
    truth = home / "truth.csv"
    entries, notes = _numbered(_images(folder))
    used = {path.name for entry in entries for path in (entry.path, entry.texture) if path}
    return Found(entries, truth if truth.exists() else None,
                 notes + unused_files(folder, used | {"truth.csv"}))


def check_images(entries, width, height):
    """Read every image once, so that a bad one is refused before any work is done."""
    for entry in entries:
        for path in filter(None, (entry.path, entry.texture)):
            read_image(path, width, height)
