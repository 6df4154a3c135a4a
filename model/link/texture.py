"""Which pixels of passing texture frames are sent, and in what packets."""

from dataclasses import dataclass

from model.link.points import flags
from model.link.texture_code import pack, quantise

__all__ = ["TEXTURE", "TEXTURE_FRAME", "Texture", "TextureFrame"]

TEXTURE, TEXTURE_FRAME = 0x58, 0x59

_PLACES = 16  # packets that wait


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
    """Sends an image in passes, packet by packet, from the frames that come whole.

    Frames come one at a time between packets: :meth:`frame` and :meth:`packet` are called in the
    order in which a frame ends and the first octet of a packet is taken.

    Parameters
    ----------
    width, height : :class:`int`
        Frame size in pixels.

    Attributes
    ----------
    stands : tuple of two :class:`int`
        Row and column of the next pixel to be packed.
    """

    def __init__(self, width, height):
        self.width, self.height = width, height
        self.stands = (0, 0)
        self._waiting = []
        self._due = None
        self._offered = None

    @property
    def waiting(self):
        """Packets of pixels that have not been sent."""
        return len(self._waiting)

    def takes(self):
        """Whether a frame that begins now is taken."""
        return self._due is None

    def frame(self, image, info, bound=0, mosaic=False):
        """A frame has passed.

        Parameters
        ----------
        image : array (height, width) of uint8
            Its pixels; not used if it is broken.
        info : :class:`TextureFrame`
            What is reported of it.
        bound : :class:`int`
            Largest error of a pixel in grey values, one of
            :data:`model.link.texture_code.BOUNDS`.
        mosaic : :class:`bool`
            See :func:`model.link.texture_code.pack`.
        """
        self._due = info
        over = info.broken
        quantised = {}

        def rows(row):
            if row not in quantised:
                quantised[row] = quantise(image[row], bound).tolist()
            return quantised[row]

        while len(self._waiting) < _PLACES and not over:
            body, self.stands, over = pack(
                rows, self.height, *self.stands, info.number, bound, mosaic)
            self._waiting.append(bytes([TEXTURE]) + body)
        self._offer()

    def _offer(self):
        """A packet that is offered stays, whatever comes."""
        if self._offered is None:
            if self._due is not None:
                self._offered = TEXTURE_FRAME
            elif self._waiting:
                self._offered = TEXTURE

    def packet(self, bad_sync=0, overrun=0):
        """Content of the next packet, kind and body; None if there is none."""
        offered, self._offered = self._offered, None
        content = None
        if offered == TEXTURE_FRAME:
            content, self._due = self._due.content(bad_sync, overrun), None
        elif offered == TEXTURE:
            content = self._waiting.pop(0)
        self._offer()
        return content
