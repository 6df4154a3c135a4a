"""Data of the replies to IDENTIFY, STATUS and READ, octet by octet."""

from amaranth import *
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from ..protocol import (
    DISPLAY_FAULTS,
    GUARD_CAUSES,
    IDENTITY_FIELDS,
    PRESET_NAMES,
    PROTOCOL_VERSION,
    STATUS_FIELDS,
    TABLE_VERSION,
)

__all__ = ["ReplyFields", "status_ports"]

_FLAGS = {"guard_causes": len(GUARD_CAUSES), "display": len(DISPLAY_FAULTS)}


def status_ports(*left_out):
    """Inputs for the fields of :data:`hdl.protocol.STATUS_FIELDS`, by name, but for some."""
    return {field.name: In(_FLAGS.get(field.name, field.bits)) for field in STATUS_FIELDS
            if field.name not in left_out}


class ReplyFields(wiring.Component):
    """Gives the octets of a reply's fields, one after the other.

    A reply begins with a start. In the clocks after it ``octet`` is its first octet, until
    ``step`` asks for the next one, which is there in the clock after. Numbers of 16 bits are
    sampled as a whole: the upper octet is kept when the lower one is stepped over. After the
    step over the last octet all octets are zero until a start. Reset ends a reply.

    Parameters
    ----------
    width, height, beams, lanes, preset, clock_hz
        What IDENTIFY reports, see :class:`.commands.Commands`.

    Members
    -------
    start_identity, start_status, start_register : :py:`In(1)`
        Start in this clock; one at a time, and none during a reply.
    step : :py:`In(1)`
        Go on to the next octet.
    octet : :py:`Out(8)`
        The octet.
    last : :py:`Out(1)`
        It is the reply's last one.
    register_value : :py:`In(32)`
        Value for READ; stays during the reply.
    state, guard_causes, and so on : :py:`In`
        Values for STATUS, see :data:`hdl.protocol.STATUS_FIELDS`.

    Attributes
    ----------
    latency : :class:`int`
        Clocks from a start to the first octet.
    """

    latency = 1

    def __init__(self, width=352, height=288, beams=49, lanes=2, preset="capsule",
                 clock_hz=16_000_000):
        self.identity = {
            "protocol": PROTOCOL_VERSION, "tables": TABLE_VERSION, "width": width,
            "height": height, "beams": beams, "lanes": lanes,
            "preset": PRESET_NAMES.index(preset), "clock_khz": clock_hz // 1000,
        }
        super().__init__({
            "start_identity": In(1),
            "start_status": In(1),
            "start_register": In(1),
            "step": In(1),
            "octet": Out(8),
            "last": Out(1),
            "register_value": In(32),
            **status_ports(),
        })

    def elaborate(self, platform):
        m = Module()
        # A bit walks along the octets of each kind of reply and selects one after the other, which
        # takes less than multiplexers would.
        upper = Signal(8)
        status, uppers = self._status(upper)
        octets, next_upper, last = C(0, 8), C(0, 8), C(0, 1)
        for name, values in {
                "identity": self._identity(), "status": status,
                "register": [self.register_value.word_select(n, 8) for n in range(4)]}.items():
            selected = Signal(len(values), name=f"selected_{name}")
            with m.If(self.step):
                m.d.sync += selected.eq(selected << 1)
            with m.If(getattr(self, f"start_{name}")):
                m.d.sync += selected.eq(1)
            for n, value in enumerate(values):
                octets |= value & selected[n].replicate(8)
                if name == "status" and n in uppers:
                    next_upper |= uppers[n] & selected[n].replicate(8)
            last |= selected[-1]
        with m.If(self.step):
            m.d.sync += upper.eq(next_upper)
        m.d.comb += [self.octet.eq(octets), self.last.eq(last)]
        return m

    def _identity(self):
        """Octets of the identity."""
        return [C(self.identity[field.name] >> 8 * n & 0xFF, 8)
                for field in IDENTITY_FIELDS for n in range(field.bits // 8)]

    def _status(self, upper):
        """Octets of the status, and by the index of each lower one the upper octet to keep."""
        octets, uppers = [], {}
        for field in STATUS_FIELDS:
            value = getattr(self, field.name)
            if field.bits == 16:
                uppers[len(octets)] = value[8:]
                octets += [value[:8], upper]
            else:
                octets.append(value)
        return octets, uppers
