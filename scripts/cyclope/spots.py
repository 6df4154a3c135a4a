"""``cyclope spots``: the spots of any images, without a calibration."""

import os
from collections import Counter
from pathlib import Path

from model.errors import UserError
from scripts.cyclope.extras import require

__all__ = ["add_arguments", "main"]

#: Octets of a picture's name at the most: file systems take 255, and some are added while it is
#: written.
_LONGEST = 200


def add_arguments(parser):
    """Declare what ``cyclope spots`` takes."""
    parser.description = (
        "Find the spots of images as the chip does, without a calibration: the first thing to do "
        "with images of one's own. OUT gets spots.csv (file,u_px,v_px,area_px,weight,peak,"
        "saturated,status,border) and a picture of each image with its spots.")
    parser.epilog = (
        "weight is the sum of what the spot's pixels exceed the level by, plus 1 each; peak is its "
        "brightest grey value; saturated is 1 if a pixel has the grey value 255; border is 1 if "
        "the spot touches the border of the image: a part of it may be missing, and its centre is "
        "then off. The status is ok, or rejected if the area is out of range. The noise is learnt "
        "on each image itself. Rings are green, orange where pixels are saturated, and red for "
        "rejected spots.")
    parser.add_argument(
        "images", nargs="+", type=Path, metavar="IMAGE|FOLDER",
        help="grey 8-bit images of up to 1024 x 1024 pixels, or folders of them; of a capture the "
             "frames are taken, of frames the pattern images")
    parser.add_argument(
        "-o", "--output", required=True, type=Path, metavar="OUT",
        help="folder to create; it must not hold anything yet")
    parser.add_argument(
        "--engine", choices=("model", "rtl"), default="model",
        help="the numpy model (default), or the RTL, Verilated for each size of images; both give "
             "the same spots, unless an image has more than the chip's buffers hold")
    parser.add_argument(
        "--sheet", action="store_true", help="also all pictures on one, sheet.png")


def _find(targets):
    """Paths of all images, and notes."""
    from scripts.results.frames import find_frames
    paths, notes = [], []
    for target in targets:
        found = find_frames([target])
        paths += [entry.path for entry in found.entries]
        if target.is_dir():
            notes += [note for note in found.notes if not note.startswith("frames are numbered")]
    return list(dict.fromkeys(paths)), notes


def _names(paths):
    """What each image is called in the table, and in the folder of pictures."""
    many = Counter(path.name for path in paths)
    names = [path.name if many[path.name] == 1 else str(path) for path in paths]
    stems = Counter(path.stem.casefold() for path in paths)
    pictures = [f"{path.stem}.png" if stems[path.stem.casefold()] == 1
                else f"{path.stem}-{number}.png" for number, path in enumerate(paths)]
    alike = len({name.casefold() for name in pictures}) < len(pictures)
    if alike or any(len(os.fsencode(name)) > _LONGEST for name in pictures):
        pictures = [f"{number:04}.png" for number in range(len(paths))]
    return names, pictures


class _Finder:
    """Spots of images; for the RTL, a chip of the size of the last image."""

    def __init__(self, engine):
        self.engine, self._chip, self._size = engine, None, None

    def __call__(self, image):
        """Spots, and how many were dropped."""
        from scripts.results.spot_rows import is_too_small, spots_of
        if self.engine == "model" or is_too_small(image):
            return spots_of(image), 0
        from scripts.simulation.spot_engine import SpotEngine
        if image.shape != self._size:
            self._chip, self._size = SpotEngine(*image.shape[::-1]), image.shape
        return self._chip(image)


def _note(image, spots, dropped):
    """What there is to say of an image without spots, or of which spots are missing."""
    from model.preprocessing.area import LARGEST_AREA
    from scripts.results.spot_rows import count_too_large, is_too_small
    from scripts.results.summary import plural
    if is_too_small(image):
        return "smaller than the window that the chip looks through: no spots"
    notes = []
    if large := count_too_large(image):
        notes.append(f"{plural(large, 'spot')} of more than {LARGEST_AREA:,} pixels: no row")
    if dropped:
        notes.append(f"{dropped} spots dropped: buffer full")
    if not notes and not len(spots):
        return "all pixels alike: no spots" if image.min() == image.max() else "no spots"
    return "; ".join(notes)


def main(arguments):
    """Find spots with parsed arguments; gives the exit status."""
    require("calibration", "`cyclope spots`")
    if arguments.engine == "rtl":
        require("rtl", "`cyclope spots --engine rtl`", ", or use --engine model")
    from rich.console import Console
    from rich.progress import track

    from calibration.image import read_image
    from scripts.results.outputs import check_folder, new_folder
    from scripts.results.overlay import write_picture
    from scripts.results.spot_pictures import MOST_ON_SHEET, draw_sheet, draw_spots
    from scripts.results.spot_rows import write_spots
    from scripts.results.summary import plural

    check_folder(arguments.output)
    paths, notes = _find(arguments.images)
    for path in paths:  # a bad image is refused before any work is done
        read_image(path)
    names, pictures = _names(paths)
    find, rows, on_sheet = _Finder(arguments.engine), [], []
    errors = Console(stderr=True)
    with new_folder(arguments.output) as folder:
        (folder / "pictures").mkdir()
        for path, name, picture_name in track(
                list(zip(paths, names, pictures, strict=True)), "finding spots", console=errors,
                transient=True, disable=not errors.is_terminal):
            image = read_image(path)
            spots, dropped = find(image)
            rows.append((name, spots))
            picture = draw_spots(image, spots)
            write_picture(folder / "pictures" / picture_name, picture)
            if arguments.sheet and len(on_sheet) < MOST_ON_SHEET:
                on_sheet.append((f"{name}: {plural(len(spots), 'spot')}", picture))
            if note := _note(image, spots, dropped):
                notes.append(f"{name}: {note}")
        if on_sheet:
            write_picture(folder / "sheet.png", draw_sheet(on_sheet))
        if arguments.sheet and len(paths) > MOST_ON_SHEET:
            notes.append(f"sheet.png has the first {MOST_ON_SHEET} pictures")
        try:
            write_spots(folder / "spots.csv", rows)
        except OSError as error:
            raise UserError(f"{arguments.output} cannot be written: {error.strerror}.") from error
    for note in notes[:24]:
        print(f"! {note}")
    if len(notes) > 24:
        print(f"! {len(notes) - 24} more notes")
    rejected = sum(int(spots["status"].sum()) for _, spots in rows)
    total = sum(len(spots) for _, spots in rows)
    print(f"{plural(total, 'spot')} in {plural(len(paths), 'image')}"
          + (f", {rejected} of them rejected" if rejected else "") + f", in {arguments.output}")
    return 0
