"""Time since the first frame, by the chip's clock."""

__all__ = ["ChipClock"]


class ChipClock:
    """Called with pattern and texture frames in their order, gives their seconds.

    The first frame that has a time is at 0. A frame whose time was lost, or that comes late, has
    that of the latest one.
    """

    def __init__(self):
        self._begin_us, self._seconds = None, 0.0

    def __call__(self, frame):
        if frame.timestamp_us:
            if self._begin_us is None:
                self._begin_us = frame.timestamp_us
            self._seconds = max(self._seconds, (frame.timestamp_us - self._begin_us) / 1e6)
        return self._seconds
