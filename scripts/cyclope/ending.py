"""When ``cyclope receive`` has what it is to receive."""

import time

from model.errors import UserError
from scripts.host.messages import Frame, TextureFrame

__all__ = ["Ending"]

#: Seconds of octets without a packet after which the line's speed must be wrong, and octets.
_GARBAGE_SECONDS, _GARBAGE_OCTETS = 3.0, 300
#: Octets without a packet after which a file is no recording.
_NO_RECORDING_OCTETS = 1 << 22
#: Seconds without an octet after which a single pair is over, and for which its first frame is
#: waited for.
_PAIR_QUIET, _PAIR_PATIENCE = 1.0, 10.0


class Ending:
    """When a reception ends, by the options of the command line.

    Parameters
    ----------
    options : :class:`argparse.Namespace`
        ``source baud frames images seconds single`` as ``cyclope receive`` takes them.
    source : :class:`scripts.host.owner.PortOwner` or :class:`scripts.host.replay.Replay`
        What is read.
    reception : :class:`scripts.host.reception.Reception`
        What takes it.

    Attributes
    ----------
    why : :class:`str` or None
        The reason, where the options do not say it.
    status_wanted : :class:`bool`
        A frame was dark or the laser guard had tripped: the chip's status says why.
    """

    def __init__(self, options, source, reception):
        self._options, self._source, self._reception = options, source, reception
        self._begin = self._last = time.monotonic()
        self._first_us = self._first_octet = None
        self._pair = False  # the texture frame of a single pair came
        self.why, self.status_wanted = None, False

    def by_packet(self, events):
        """Whether a packet, which completed ``events``, is the last one."""
        options, recorder = self._options, self._reception.recorder
        for event in events:
            if isinstance(event, (Frame, TextureFrame)):
                self.status_wanted |= event.tripped or (
                    isinstance(event, Frame) and not event.laser)
                self._pair |= isinstance(event, TextureFrame) and recorder.frames > 0
                if self._seconds_are_over(event):
                    return True
        return (options.frames is not None and recorder.frames >= options.frames
                or options.images is not None
                and sum(recorder.complete.values()) >= options.images)

    def _seconds_are_over(self, event):
        seconds = self._options.seconds
        if not event.timestamp_us:
            return False
        if self._first_us is None:
            self._first_us = event.timestamp_us
        if self._source.live or seconds is None or (
                event.timestamp_us - self._first_us < seconds * 1e6):
            return False
        self.why = f"{seconds:g} s are over"
        return True

    def by_time(self, octets):
        """Whether nothing more is to be read; ``octets`` came last.

        Raises
        ------
        UserError
            If nothing that comes is a packet.
        """
        options, decoder, now = self._options, self._reception.decoder, time.monotonic()
        if not self._source.live:
            if not decoder.packets and decoder.octets >= _NO_RECORDING_OCTETS:
                raise self.nothing()
            return False
        if octets:
            self._last = now
            self._first_octet = self._first_octet or now
        if not decoder.packets and decoder.octets >= _GARBAGE_OCTETS and (
                now - self._first_octet > _GARBAGE_SECONDS):
            raise UserError(f"What comes from {options.source} is no packet: is --baud "
                            f"{options.baud} right, and is this the chip's port?")
        if options.seconds is not None and now - self._begin >= options.seconds:
            self.why = f"{options.seconds:g} s are over"
        elif options.single and now - self._last > _PAIR_QUIET and (
                self._pair or now - self._begin > _PAIR_PATIENCE):
            self.why = "the pair is over" if self._pair else "no pair came"
        return self.why is not None

    def nothing(self):
        """The error if no packet came."""
        name, decoder = self._options.source, self._reception.decoder
        if not self._source.live:
            return UserError(f"{name} holds no packet of the chip: name a link.raw of `cyclope "
                             "receive`.")
        if decoder.octets:
            return UserError(f"What came from {name} is no packet: is --baud right, and is this "
                             "the chip's port?")
        return UserError(f"Nothing came from {name}: is the chip powered and running (`cyclope "
                         f"load {name} --start`), and is this its port?")
