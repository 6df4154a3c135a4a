"""A line that adds octets, turns bits over, and loses both, in both directions."""

import numpy as np

__all__ = ["BadLine"]


class BadLine:
    """Between a host and an instrument. Where there are strays, each direction begins with some.

    Parameters
    ----------
    instrument : object
        ``send``, ``run`` and ``receive``, as for :class:`scripts.simulation.terminal.Terminal`.
    seed : :class:`int`
        Of the noise.
    flips : :class:`float`
        Probability that a bit is turned over.
    strays : :class:`float`
        Probability that octets appear before one that is sent.

    Attributes
    ----------
    added : list of two :class:`int`
        Stray octets to the instrument, and from it.
    """

    def __init__(self, instrument, seed, flips=0.0, strays=0.0):
        self.instrument, self.flips, self.strays = instrument, flips, strays
        self.added = [0, 0]
        self._rng = np.random.default_rng(seed)

    def __getattr__(self, name):
        return getattr(self.instrument, name)

    def send(self, octets):
        """Octets from the host."""
        self.instrument.send(self._disturbed(octets, 0))

    def receive(self):
        """Octets for the host."""
        return self._disturbed(self.instrument.receive(), 1)

    def _disturbed(self, octets, direction):
        octets = np.frombuffer(octets, np.uint8)
        flips = self._rng.random((len(octets), 8)) < self.flips
        octets = (octets ^ np.packbits(flips)).tobytes() if len(octets) else b""
        out, done = b"", 0
        drawn = self._rng.random(len(octets)) < self.strays
        drawn[:1] |= self.strays > 0 and not self.added[direction]
        for at in np.flatnonzero(drawn):
            # Zeros among them make whole packets of the rest.
            stray = self._rng.integers(0, 256, self._rng.integers(1, 40), np.uint8)
            stray[self._rng.random(len(stray)) < 0.5] = 0
            self.added[direction] += len(stray)
            out += octets[done:at] + stray.tobytes()
            done = at
        return out + octets[done:]
