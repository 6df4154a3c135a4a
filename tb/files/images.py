"""Images that cannot be measured, each as octets, and the words that refuse it."""

import io
import struct
import zlib

import numpy as np
from PIL import Image

__all__ = ["ACCEPTED", "GREY", "REFUSED"]

#: A frame of the sensor's size, and its noise hides nothing from a check.
GREY = np.random.default_rng(1).integers(0, 256, (288, 352), np.uint8)
_HEIGHT, _WIDTH = GREY.shape
_IMAGE = Image.fromarray(GREY)
_DAMAGED, _COLOUR, _CLEAR = "is truncated or damaged", "is a colour image", "transparent pixels"


def _file(form, image=_IMAGE, **options):
    """An image in a format."""
    file = io.BytesIO()
    image.save(file, form, **options)
    return file.getvalue()


def _as(mode, form="PNG"):
    return _file(form, _IMAGE.convert("RGB").convert(mode))


def _flipped(data, at):
    """One bit is wrong in that octet."""
    data = bytearray(data)
    data[at] ^= 1
    return bytes(data)


def _chunk(kind, data):
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def _png(*chunks, width=_WIDTH, height=_HEIGHT):
    """A PNG of a size, of the given chunks."""
    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    return b"".join([b"\x89PNG\r\n\x1a\n", _chunk(b"IHDR", header), *chunks, _chunk(b"IEND", b"")])


_ROWS = _chunk(b"IDAT", zlib.compress(bytes((_WIDTH + 1) * _HEIGHT)))
_MUCH = zlib.compress(bytes(1 << 28))
_JPEG = _file("JPEG", quality=90)
_FRAME = _JPEG.index(b"\xff\xc0")
_SCAN = _JPEG.index(b"\xff\xda") + 500

#: Octets, and words of the sentence.
REFUSED = {
    "empty": (b"", "is empty"),
    "text": (b"this is no image", "cannot be read as an image"),
    "web page": (b"<html><body>404</body></html>", "cannot be read as an image"),
    "zeros": (bytes(100_000), "cannot be read as an image"),
    "gif": (_file("GIF"), "cannot be read as an image"),
    "webp": (_file("WEBP"), "cannot be read as an image"),
    "png half": (_file("PNG")[:50_000], _DAMAGED),
    "png header": (_file("PNG")[:33], _DAMAGED),
    "png magic": (_file("PNG")[:8], _DAMAGED),
    "png without its last octet": (_file("PNG")[:-1], _DAMAGED),
    "png wrong bit": (_flipped(_file("PNG"), 50_000), _DAMAGED),
    "png wrong check": (_flipped(_file("PNG"), -14), _DAMAGED),
    "png without data": (_png(), _DAMAGED),
    "png too little data": (_png(_chunk(b"IDAT", zlib.compress(bytes(100)))), _DAMAGED),
    "png 100000 x 100000": (_png(_ROWS, width=100_000, height=100_000), "far more pixels"),
    "png 600 x 600": (_png(_ROWS, width=600, height=600), "has 600 x 600 pixels instead"),
    "png 0 x 0": (_png(_ROWS, width=0, height=0), _DAMAGED),
    "png text bomb": (_png(_chunk(b"zTXt", b"a\0\0" + _MUCH), _ROWS), _DAMAGED),
    "png colour": (_as("RGB"), _COLOUR),
    "png palette": (_as("P"), _COLOUR),
    "png alpha": (_as("LA"), _CLEAR),
    "png colour and alpha": (_as("RGBA"), _CLEAR),
    "png transparent grey": (_file("PNG", transparency=3), _CLEAR),
    "png 1 bit": (_as("1"), "has 1 bit per pixel"),
    "png 16 bits": (_file("PNG", Image.fromarray(GREY.astype(np.uint16) * 257)), "has 16 bits"),
    "png animated": (_file("PNG", save_all=True, append_images=[_IMAGE.rotate(180)]), "several"),
    "png smaller": (_file("PNG", _IMAGE.crop((0, 0, 320, 240))), "has 320 x 240 pixels instead"),
    "jpeg half": (_JPEG[:len(_JPEG) // 2], _DAMAGED),
    "jpeg header": (_JPEG[:200], _DAMAGED),
    "jpeg without its end": (_JPEG[:-2], _DAMAGED),
    "jpeg damaged": (_JPEG[:_SCAN] + b"\xff" * 30 + _JPEG[_SCAN + 30:], _DAMAGED),
    "jpeg colour": (_as("RGB", "JPEG"), _COLOUR),
    "jpeg for print": (_as("CMYK", "JPEG"), _COLOUR),
    "jpeg 65535 x 65535": (_JPEG[:_FRAME + 5] + b"\xff" * 4 + _JPEG[_FRAME + 9:],
                           "far more pixels"),
    "jpeg two sizes": (_JPEG[:_FRAME] + _JPEG[_FRAME:_FRAME + 5] + b"\2\0\2\0"
                       + _JPEG[_FRAME + 9:_FRAME + 13] + _JPEG[_FRAME:], _DAMAGED),
    "tiff half": (_file("TIFF")[:50_000], _DAMAGED),
    "tiff header": (_file("TIFF")[:9], _DAMAGED),
    "tiff deflated, wrong bit": (_flipped(_file("TIFF", compression="tiff_deflate"), 50_000),
                                 _DAMAGED),
    "tiff packed, half": (_file("TIFF", compression="tiff_lzw")[:-60_000], _DAMAGED),
    "tiff 16 bits": (_file("TIFF", Image.fromarray(GREY.astype(np.uint16))), "has 16 bits"),
    "tiff of floats": (_file("TIFF", Image.fromarray(GREY.astype(np.float32))), "has 32 bits"),
    "tiff of two pages": (_file("TIFF", save_all=True, append_images=[_IMAGE]), "several images"),
    "bmp half": (_file("BMP")[:50_000], _DAMAGED),
    "pgm half": (_file("PPM")[:50_000], _DAMAGED),
    "pgm negative": (b"P5\n-352 288\n255\n", _DAMAGED),
    "pgm many digits": (b"P5\n" + b"9" * 5000 + b" 288\n255\n", _DAMAGED),
    "pgm 100000 x 100000": (b"P5\n100000 100000\n255\n", "far more pixels"),
    "pgm 16 bits": (b"P5\n352 288\n65535\n" + bytes(2 * 352 * 288), "has 16 bits"),
    "large": (_file("PNG") + bytes(17_000_000), "octets, more than the"),
}
#: Octets of images that are good, however they look.
ACCEPTED = {
    "png": _file("PNG"), "png and more": _file("PNG") + b"more",
    "png with too much data": _png(_chunk(b"IDAT", _MUCH)),
    "png with a profile": _png(_chunk(b"iCCP", b"a\0\0" + zlib.compress(b"no profile")), _ROWS),
    "jpeg": _JPEG, "jpeg and more": _JPEG + b"more" * 1000,
    "jpeg progressive": _file("JPEG", progressive=True),
    "bmp": _file("BMP"), "pgm": _file("PPM"), "tiff": _file("TIFF"),
    "tiff packed": _file("TIFF", compression="tiff_lzw"),
}
