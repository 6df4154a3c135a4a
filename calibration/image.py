"""Images of a sensor: 8 bits, whole and of its size, or refused in one sentence."""

import io
import os
import warnings
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import simplejpeg
from PIL import Image

from calibration.files import read_octets
from hdl.protocol import SENSOR_PIXELS
from model.errors import UserError

__all__ = ["LARGEST", "SUFFIXES", "image_size", "read_image"]

#: Names of images end so.
SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm")
#: Pixels of a sensor's side at the most.
LARGEST = SENSOR_PIXELS[1]
_FORMATS = ("PNG", "JPEG", "BMP", "TIFF", "PPM")
#: Octets of the largest image as a TIFF without compression, and as much again for what a camera
#: adds.
_MOST = 16 * LARGEST * LARGEST
#: Scans of a progressive JPEG at the most; each takes as long as a whole image.
_SCANS = 100
_PNG_END = b"IEND\xaeB`\x82"
_AGAIN = "copy or record it again"


def _header(path, data):
    """The image, of which only the header has been read, and whether it is one of several."""
    try:
        image = Image.open(io.BytesIO(data), formats=_FORMATS)
        return image, getattr(image, "is_animated", False)
    except Image.DecompressionBombError:
        raise UserError(f"{path} has far more pixels than a sensor: record it with that sensor."
                        ) from None
    except Exception as error:  # Pillow's readers raise whatever a hostile header leads to
        if data.startswith((b"\x89PNG\r\n", b"\xff\xd8\xff", b"BM", b"II*\0", b"MM\0*", b"P5")):
            raise UserError(f"{path} is truncated or damaged: {_AGAIN}.") from error
        raise UserError(f"{path} cannot be read as an image: save it as an 8-bit grey PNG."
                        ) from error


def _check_kind(path, image, several, colour):
    """Refuse all but 8-bit grey, and 8-bit colour unless ``colour``."""
    grey = "save it as 8-bit grey"
    if several:
        raise UserError(f"{path} holds several images: save each as a file of its own.")
    if image.mode.startswith(("I", "F")):
        bits = 32 if image.mode == "F" or image.format == "TIFF" and image.mode == "I" else 16
        raise UserError(f"{path} has {bits} bits per pixel: {grey}.")
    if image.mode == "1":
        raise UserError(f"{path} has 1 bit per pixel: {grey}.")
    if image.mode in ("LA", "La", "RGBA", "RGBa", "PA") or "transparency" in image.info:
        raise UserError(f"{path} has transparent pixels: {grey}, without transparency.")
    if image.mode != "L" and not (colour and image.mode in ("RGB", "P")):
        raise UserError(f"{path} is a colour image: {grey}.")


@contextmanager
def _silent():
    """Keep a library's own remarks from the terminal; the exception that follows says it all."""
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)


def _pixels(path, data, image):
    """All pixels; an image that is not whole is refused."""
    try:
        if image.format == "JPEG":
            if data.count(b"\xff\xda") > _SCANS:
                raise ValueError("too many scans")
            # Strict: what libjpeg would only warn of is refused.
            if simplejpeg.decode_jpeg_header(data)[:2] != image.size[::-1]:
                raise ValueError("two sizes")
            return simplejpeg.decode_jpeg(data, colorspace="GRAY")[:, :, 0]
        if image.format == "TIFF":
            with _silent():  # libtiff prints
                return np.array(image.convert("L"))
        if image.format == "PNG":
            if _PNG_END not in data:
                raise ValueError("no end")
            Image.open(io.BytesIO(data), formats=("PNG",)).verify()  # all check sums
        return np.array(image.convert("L"))
    except Exception as error:  # Pillow's readers raise whatever hostile data lead to
        raise UserError(f"{path} is truncated or damaged: {_AGAIN}.") from error


def image_size(path):
    """Columns and rows by an image's header; None if it has none that can be read."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return _header(path, read_octets(path, "name an image", _MOST))[0].size
    except UserError:
        return None


def read_image(path, width=None, height=None, colour=False) -> np.ndarray:
    """An 8-bit image of the sensor's size in grey, as a 2-D ``uint8`` array.

    Raises :class:`model.errors.UserError` if the file is missing, empty, truncated, damaged or
    unreadable, no regular file, in colour, of another depth than 8 bits, or of another size.

    Parameters
    ----------
    path : path
        PNG, JPEG, BMP, TIFF or PGM, whatever the name's ending.
    width, height : :class:`int` or None
        The size it must have; any up to :data:`LARGEST` if None.
    colour : :class:`bool`
        Whether colours are taken, as their luma (ITU-R BT.601), instead of refused.
    """
    path = Path(path)
    data = read_octets(path, "name an 8-bit grey image", _MOST)
    if not data:
        raise UserError(f"{path} is empty: {_AGAIN}.")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        image, several = _header(path, data)
        size = image.size
        if width is not None and size != (width, height):
            raise UserError(
                f"{path} has {size[0]} x {size[1]} pixels instead of the sensor's "
                f"{width} x {height}: record it with that sensor, neither scaled nor cropped.")
        if not (0 < size[0] <= LARGEST and 0 < size[1] <= LARGEST):
            raise UserError(f"{path} has {size[0]} x {size[1]} pixels: a sensor has at most "
                            f"{LARGEST} x {LARGEST}.")
        _check_kind(path, image, several, colour)
        return _pixels(path, data, image)
