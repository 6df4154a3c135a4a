"""The sequencer with the laser guard behind it, and a clock enable that may be stuck."""

from amaranth.hdl import EnableInserter, Module
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from hdl.acquisition.laser_guard import LaserGuard
from hdl.acquisition.sequencer import Sequencer
from hdl.protocol import GUARD_CAUSES

__all__ = ["Guarded"]

_INPUTS = ("mode", "period_us", "pattern_reset_us", "pattern_us", "texture_reset_us",
           "texture_us", "frame_begun", "frame_ended", "frame_broken", "sending")
_OUTPUTS = ("sensor_reset", "sensor_integrate", "sensor_read", "laser_request", "frame_start",
            "pattern_start", "tag", "heartbeat", "running", "pairs", "timeouts", "late", "silent")


class Guarded(wiring.Component):
    """Ports of both; ``enable`` low stops the sequencer's clock, not the guard's."""

    def __init__(self, clock_hz):
        self.sequencer, self.guard = Sequencer(clock_hz), LaserGuard(clock_hz)
        members = self.sequencer.signature.members
        super().__init__({
            "enable": In(1),
            "tables_valid": In(1),
            "clear": In(1),
            **{name: members[name] for name in (*_INPUTS, *_OUTPUTS)},
            "laser": Out(1),
            "lit": Out(1),
            "armed": Out(1),
            "causes": Out(len(GUARD_CAUSES)),
        })

    def elaborate(self, platform):
        m = Module()
        sequencer, m.submodules.guard = self.sequencer, self.guard
        m.submodules.sequencer = EnableInserter(self.enable)(sequencer)
        m.d.comb += [
            *(getattr(sequencer, name).eq(getattr(self, name)) for name in _INPUTS),
            *(getattr(self, name).eq(getattr(sequencer, name)) for name in _OUTPUTS),
            sequencer.laser_armed.eq(self.guard.armed),
            sequencer.lit.eq(self.guard.lit),
            self.guard.request.eq(sequencer.laser_request),
            self.guard.heartbeat.eq(sequencer.heartbeat),
            self.guard.tables_valid.eq(self.tables_valid),
            self.guard.clear.eq(self.clear),
            *(getattr(self, name).eq(getattr(self.guard, name))
              for name in ("laser", "lit", "armed", "causes")),
        ]
        return m
