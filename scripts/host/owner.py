"""The one object that has the port: whoever reads or asks, what comes is recorded first."""

from scripts.host.commands import Commands

__all__ = ["PortOwner"]


class PortOwner:
    """Has a port, from entering to leaving; a context manager.

    :class:`scripts.host.commands.Commands` asks the chip through it: what comes while they wait
    for a reply is taken like the rest.

    Parameters
    ----------
    open_port : callable
        Opens the port; see :func:`scripts.host.port.open_port`.
    take : callable
        Given what came at each read, nothing if nothing came for a short while. What it raises
        ends the read, and whatever was asked.

    Attributes
    ----------
    name : :class:`str`
        Of the port.
    """

    live = True

    def __init__(self, open_port, take=lambda octets: None):
        self._open, self._take, self._port = open_port, take, None
        self.name = "the chip"

    def __enter__(self):
        self.open()
        return self

    def __exit__(self, *_):
        self.close()

    def open(self):
        """Open the port if it is not."""
        if self._port is None:
            self._port = self._open()
            self.name = self._port.name

    def close(self):
        """Give the port back; it can be opened again."""
        port, self._port = self._port, None
        if port is not None:
            port.__exit__()

    def read(self):
        """Octets that came, after they were taken."""
        octets = self._port.read()
        self._take(octets)
        return octets

    def write(self, octets):
        """Send octets."""
        self._port.write(octets)

    def commands(self, **choices):
        """:class:`scripts.host.commands.Commands` to the chip."""
        return Commands(self, **choices)
