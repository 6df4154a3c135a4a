"""When the laser may be lit, from the times of what happened, clock by clock."""

__all__ = ["CAUSES", "LaserGuard", "worst_window"]

CAUSES = ("pulse", "repetition", "duty", "not_armed", "heartbeat", "upset")


class LaserGuard:
    """The guard after a reset. All times are in clocks; ceilings of light are even.

    Parameters
    ----------
    pulse, repetition, window, window_on, pause : :class:`int`
        Longest pulse, least time from first edge to first edge, length of a window, most light in
        it, longest time between two changes of the heartbeat.
    """

    def __init__(self, pulse, repetition, window, window_on, pause):
        self.pulse, self.repetition, self.pause = pulse, repetition, pause
        self.window, self.window_on = window, window_on
        self.time = 0
        self.pulses = []  # [clock of the first edge, edges]
        self.changes = []  # clocks in which the heartbeat was another one
        self.token = 0
        self.laser = self.lit = 0
        self.wanted = False  # the last edge was asked for
        self.dark = False  # until the request has gone low
        self.causes = set()

    def _beats(self):
        """Whether two changes came within the time allowed, and how long ago the second was."""
        if len(self.changes) < 2 or self.changes[-1] - self.changes[-2] > self.pause:
            return False, None
        return True, self.time - self.changes[-1]

    def _obstacle(self, tables_valid, capture):
        """Causes for which an edge in the next clock must not be."""
        twice, ago = self._beats()
        causes = set()
        if not (tables_valid or capture) or self.time <= self.window:
            causes.add("not_armed")
        if not twice or ago > self.pause:
            causes.add("heartbeat")
        if causes:
            return causes
        following = self.time + 1
        rise = self.pulses[-1][0] if self.pulses else None
        if self.wanted:
            if self.pulses[-1][1] >= self.pulse:
                return {"pulse"}
            earlier = self.pulses[-2] if len(self.pulses) > 1 else None
            extent = self.pulses[-1][1]
        else:
            if rise is not None and following - rise < self.repetition:
                return {"repetition"}
            earlier, extent, rise = self.pulses[-1] if self.pulses else None, 0, following
        if earlier is not None and rise - earlier[0] < self.window:
            extent += earlier[1]
        return {"duty"} if extent >= self.window_on else set()

    def step(self, request, tables_valid, capture, heartbeat, clear):
        """One clock: take the inputs; return laser, lit, armed and causes as they are in it."""
        twice, ago = self._beats()
        armed = bool((tables_valid or capture) and twice and ago <= self.pause
                     and self.time > self.window)
        seen = (self.laser, self.lit, int(armed),
                sum(1 << n for n, name in enumerate(CAUSES) if name in self.causes))

        causes = self._obstacle(tables_valid, capture)
        light = bool(request and not self.dark and not causes)
        if clear:
            self.causes = set()
        if request and not self.dark:
            self.causes |= causes
        if twice and ago == self.pause + 1:
            self.causes.add("heartbeat")
        self.dark = bool(request and not light)

        edge = light or self.laser
        if light and not self.wanted:
            self.pulses.append([self.time + 1, 0])
        if edge:
            self.pulses[-1][1] += 1
        self.laser, self.lit, self.wanted = int(light and not self.laser), int(edge), light
        if heartbeat != self.token:
            self.changes.append(self.time)
            self.token = heartbeat
        self.time += 1
        return seen

    def upset(self, clear):
        """One clock in which a bit of the registers has flipped, instead of a :meth:`step`.

        Nothing is known of it but that the pin has no edge that it would not have had. After it
        the guard is as after a reset, but for its causes.
        """
        causes = set() if clear else self.causes
        self.__init__(self.pulse, self.repetition, self.window, self.window_on, self.pause)
        self.causes = causes | {"upset"}


def worst_window(pulses, window):
    """Most light that any ``window`` clocks hold, of pulses [first edge, edges] in their order."""
    worst = 0
    for start in {rise for rise, _ in pulses} | {rise + edges - window for rise, edges in pulses}:
        worst = max(worst, sum(
            max(0, min(rise + edges, start + window) - max(rise, start))
            for rise, edges in pulses))
    return worst
