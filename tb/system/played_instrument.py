"""The Verilated instrument for tests of the reader: its imager plays images, its line has faults.

It has the members of :class:`tb.system.fake_instrument.FakeInstrument` that such tests use.
"""

import numpy as np

from hdl.config import Config
from scripts.simulation.instrument import Instrument

__all__ = ["SMALL", "PlayedInstrument"]

#: A chip that is quick to simulate, with a line that holds nothing back.
SMALL = Config(width=64, height=64, beams=16, lanes=2, spot_depth=512, baud=2_000_000)
#: No pattern is exposed for longer, and every texture is.
_PATTERN_US = 3000


class PlayedInstrument:
    """The RTL between an imager that plays images and a line that loses and damages.

    Parameters
    ----------
    shown : list of array (height, width) of uint8
        Pattern frames, over and over.
    texture : array (height, width) of uint8
        What texture frames show.
    config : :class:`hdl.config.Config`
        Constructor choices of the RTL.

    Attributes
    ----------
    noise : :class:`float`
        Probability that a bit to the host is turned over.
    deaf, damaging : :class:`int`
        So many of the next packets from the host are lost, or damaged.
    mute : :class:`int`
        So many of the next packets to the host are lost.
    """

    def __init__(self, shown, texture, config=SMALL):
        self.shown, self.texture = shown, texture
        self.instrument = Instrument(config, self._picture)
        self.run = self.instrument.run
        self.noise, self.deaf, self.damaging, self.mute = 0.0, 0, 0, 0
        self._played = []  # of every frame: the number of the pattern, None for a texture
        self._patterns = 0
        self._incoming, self._outgoing, self._rng = b"", b"", np.random.default_rng(1)

    def pattern(self, number):
        """Which of the images frame ``number`` is; the chip counts all that the imager sent."""
        return self._played[number]

    def send(self, octets):
        """Octets from the host."""
        *pieces, self._incoming = (self._incoming + octets).split(b"\0")
        for piece in filter(None, pieces):
            self._take(piece)

    def receive(self):
        """Octets for the host."""
        octets = self.instrument.receive()
        if self.mute:
            octets = self._without_some(octets)
        if self.noise and octets:
            flips = self._rng.random(8 * len(octets)) < self.noise
            octets = (np.frombuffer(octets, np.uint8) ^ np.packbits(flips)).tobytes()
        return octets

    def _picture(self, integrated_us, _):
        if integrated_us > _PATTERN_US:
            self._played.append(None)
            return self.texture
        self._played.append(self._patterns % len(self.shown))
        self._patterns += 1
        return self.shown[self._played[-1]]

    def _take(self, piece):
        """A packet from the host, without its delimiters."""
        if self.deaf:
            self.deaf -= 1
            return
        if self.damaging:
            self.damaging -= 1
            piece = bytes([*piece[:-1], piece[-1] ^ 0x80])
        self.instrument.send(b"\0" + piece + b"\0")

    def _without_some(self, octets):
        *pieces, self._outgoing = (self._outgoing + octets).split(b"\0")
        kept = b""
        for piece in filter(None, pieces):
            if self.mute:
                self.mute -= 1
            else:
                kept += b"\0" + piece + b"\0"
        if not self.mute:
            kept, self._outgoing = kept + self._outgoing, b""
        return kept
