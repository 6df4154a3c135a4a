"""Which pixels of passing texture frames are sent, and in what packets."""

from dataclasses import dataclass

import numpy as np

from model.link.framer import CONTENT_LIMIT
from model.link.points import flags

__all__ = ["TEXTURE", "TEXTURE_FRAME", "Texture", "TextureFrame"]

TEXTURE, TEXTURE_FRAME = 0x58, 0x59

_CAPTURED = 1023
_PIXELS = CONTENT_LIMIT - 4 - 2 - 5


@dataclass(frozen=True)
class TextureFrame:
    """What the chip reports of a texture frame; fields as in
    :class:`model.link.points.PatternFrame`."""

    number: int = 0
    skipped: int = 0
    exposure_us: int = 0
    timestamp_us: int = 0
    broken: bool = False
    laser: bool = False
    capture: bool = False
    tripped: bool = False
    tables_valid: bool = False

    def content(self, bad_sync=0, overrun=0):
        """Content of its packet, with the camera's counters."""
        fields = (self.number | self.skipped << 16 | self.exposure_us << 24
                  | self.timestamp_us << 40 | bad_sync << 64 | overrun << 72)
        return (bytes([TEXTURE_FRAME, self.number & 0xFF]) + fields.to_bytes(10, "little")
                + bytes([flags(broken=self.broken, laser=self.laser, capture=self.capture,
                               tripped=self.tripped, tables_valid=self.tables_valid,
                               texture=True)]))


class Texture:
    """Sends an image in raster order, from whichever frame has last come whole.

    Frames come one at a time between packets: :meth:`frame` and :meth:`packet` are called in the
    order in which a frame ends and the first octet of a packet is taken.

    Parameters
    ----------
    width, height : :class:`int`
        Frame size in pixels.
    """

    def __init__(self, width, height):
        self.width, self.height = width, height
        self.stands = 0  # the next pixel to be sent, in raster order
        self._pixels, self._number, self._end = None, 0, 0
        self._due = None
        self._offered = None

    def takes(self):
        """Whether a frame that begins now is taken."""
        return self._due is None

    def frame(self, image, info):
        """A frame has passed.

        Parameters
        ----------
        image : array (height, width) of uint8
            Its pixels; not used if it is broken.
        info : :class:`TextureFrame`
            What is reported of it.
        """
        self._due = info
        if not info.broken:
            self._pixels, self._number = np.asarray(image).ravel(), info.number & 0xFF
            self._end = min(self.stands + _CAPTURED, self.width * self.height)
        self._offer()

    def _offer(self):
        """A packet that is offered stays, whatever comes; its contents are still open."""
        if self._offered is None:
            if self._due is not None:
                self._offered = TEXTURE_FRAME
            elif self.stands != self._end:
                self._offered = TEXTURE

    def packet(self, bad_sync=0, overrun=0):
        """Content of the next packet, kind and body; None if there is none."""
        offered, self._offered = self._offered, None
        content = None
        if offered == TEXTURE_FRAME:
            content, self._due = self._due.content(bad_sync, overrun), None
        elif offered == TEXTURE:
            row, column = divmod(self.stands, self.width)
            count = min(_PIXELS, self.width - column, self._end - self.stands)
            content = (bytes([TEXTURE, self._number]) + row.to_bytes(2, "little")
                       + column.to_bytes(2, "little")
                       + self._pixels[self.stands:self.stands + count].tobytes())
            self.stands += count
            if self.stands == self.width * self.height:
                self.stands = self._end = 0
        self._offer()
        return content
