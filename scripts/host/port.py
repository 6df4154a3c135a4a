"""The serial port, with every failure as one sentence."""

import errno
import os
import stat
import termios

from model.errors import UserError

__all__ = ["BAUD", "Port", "VanishedError", "add_port_arguments", "open_port"]

BAUD = 115_200
#: Seconds that a read waits for the first octet.
_PATIENCE = 0.05


class VanishedError(UserError):
    """The device is no longer there."""


def add_port_arguments(parser):
    """Declare how a port is opened."""
    parser.add_argument("--baud", type=int, default=BAUD, metavar="N",
                        help=f"bits per second (default {BAUD})")
    parser.add_argument("--rtscts", action="store_true",
                        help="RTS and CTS are wired: hold the chip back while this side is busy")


class Port:
    """An open serial device; also a context manager.

    Parameters
    ----------
    device : :class:`serial.SerialBase`
        Open, with a timeout.
    name : :class:`str`
        For messages.
    """

    def __init__(self, device, name):
        self._device, self.name = device, name

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._device.close()

    def read(self):
        """Octets that came, none if none came for a short while."""
        return self._guarded(lambda: self._device.read(max(1, self._device.in_waiting)))

    def write(self, octets):
        """Send octets."""
        self._guarded(lambda: self._device.write(octets))

    def _guarded(self, work):
        import serial
        try:
            return work()
        except serial.SerialTimeoutException as error:
            hint = (": is CTS wired?" if getattr(self._device, "rtscts", False)
                    else ": does anything read at its other end?")
            raise UserError(f"{self.name} takes no octets{hint}") from error
        except (OSError, TypeError, termios.error) as error:
            # pyserial raises TypeError when another thread closed the device under a read.
            raise VanishedError(f"{self.name} is gone.") from error


def _reason(error, name):
    if error.errno == errno.ENOENT:
        return f"There is no port {name}: is the device plugged in?"
    if error.errno in (errno.EACCES, errno.EPERM):
        return (f"{name} may not be opened by this user: join the group that owns it "
                "(Debian: adduser USER dialout) and log in again.")
    if error.errno in (errno.EBUSY, errno.EAGAIN):
        return f"{name} is in use by another program: close that first."
    if isinstance(error.__context__, termios.error):
        return f"{name} is not a serial device."
    return f"{name} cannot be opened: {os.strerror(error.errno) if error.errno else error}."


def open_port(name, baud=BAUD, rtscts=False):
    """A :class:`Port` on a serial device, a pseudo-terminal or a URL that pyserial knows.

    Parameters
    ----------
    name : :class:`str`
        Such as ``/dev/ttyUSB0``.
    baud : :class:`int`
        Bits per second.
    rtscts : :class:`bool`
        Handshake in hardware.

    Raises
    ------
    UserError
        If it cannot be opened.
    """
    import serial
    name = str(name)
    if baud < 1:
        raise UserError(f"--baud must be 1 or more, not {baud}.")
    if "://" not in name and os.name == "posix" and os.path.exists(name) and not stat.S_ISCHR(
            os.stat(name).st_mode):
        raise UserError(f"{name} is not a serial device.")
    try:
        device = serial.serial_for_url(
            name, baud, timeout=_PATIENCE, write_timeout=5, rtscts=rtscts, do_not_open=True)
        if isinstance(device, serial.Serial):
            device.exclusive = True
        device.open()
    except (ValueError, OverflowError) as error:
        raise UserError(f"{name} cannot be opened at {baud} baud: {error}.") from error
    except OSError as error:
        raise UserError(_reason(error, name)) from error
    except Exception as error:  # pyserial does not say what its URLs raise
        if "://" not in name:
            raise
        raise UserError(f"{name} cannot be opened: {error}.") from error
    return Port(device, name)
