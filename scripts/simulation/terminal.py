"""A pseudo-terminal in front of something that sends and takes octets, such as the Verilated chip.

``cyclope load`` and ``cyclope receive`` open it as they would open a serial device.
"""

import os
import select
import threading
import time
import tty

__all__ = ["Terminal"]

#: Octets that may wait for a reader; beyond that time stands still, as nobody reads.
_OUTPUT_LIMIT = 1 << 16
#: Octets from the host that may wait for the line; beyond that the host has to wait.
_INPUT_LIMIT = 1 << 12


class Terminal:
    """Joins an instrument to a new pseudo-terminal.

    Parameters
    ----------
    instrument : object
        ``send(octets)`` takes octets from the host, ``run(microseconds)`` lets time pass,
        ``receive()`` gives the octets for the host; ``unsent``, if it has that, is the number of
        octets from the host that still wait for the line.
    step_us : :class:`int`
        Microseconds that pass at a time.
    speed : :class:`float` or None
        Passing time over the host's, at most; None for as fast as it goes.
    drop : :class:`bool`
        While nobody reads, output is lost and time goes on, as on a real line.

    Attributes
    ----------
    path : :class:`str`
        The device to open.
    """

    def __init__(self, instrument, step_us=1000, speed=1.0, drop=False):
        self.instrument, self._step, self._speed, self._drop = instrument, step_us, speed, drop
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.path = os.ttyname(self._slave)
        self._ended = threading.Event()
        self._thread = self._error = None

    def __enter__(self):
        self._thread = threading.Thread(target=self._serve_aside, daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_):
        self.close()

    def close(self):
        """End, and take the device away."""
        self._ended.set()
        if self._thread is not None:
            self._thread.join()
            self._thread = None
        for handle in (self._master, self._slave):
            if handle is not None:
                os.close(handle)
        self._master = self._slave = None
        if self._error is not None:
            error, self._error = self._error, None
            raise error

    def _serve_aside(self):
        try:
            self.serve()
        except BaseException as error:  # raised by `close`, in the thread that wants to know
            self._error = error

    def serve(self):
        """Let time pass until :meth:`close`, or an interrupt."""
        waiting, passed, begin = bytearray(), 0, time.monotonic()
        while not self._ended.is_set():
            full = len(waiting) >= _OUTPUT_LIMIT
            if full and self._drop:
                waiting.clear()
                full = False
            ahead = 0.0 if self._speed is None else (
                passed / 1e6 / self._speed - (time.monotonic() - begin))
            accepts = getattr(self.instrument, "unsent", 0) < _INPUT_LIMIT
            readable, writable, _ = select.select(
                [self._master] if accepts else [], [self._master] if waiting else [], [],
                0.02 if full else max(0.0, min(ahead, 0.02)))
            if readable:
                self.instrument.send(os.read(self._master, 4096))
            if writable:
                del waiting[:os.write(self._master, waiting)]
            if not full and ahead <= 0:
                if ahead < -1:  # too slow for its speed, or nobody read: do not catch up
                    begin, passed = time.monotonic(), 0
                self.instrument.run(self._step)
                passed += self._step
                waiting += self.instrument.receive()
