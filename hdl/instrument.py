"""The whole instrument: imager, laser and serial line."""

from amaranth.hdl import Module, Mux, Signal
from amaranth.lib import wiring
from amaranth.lib.cdc import FFSynchronizer
from amaranth.lib.wiring import In, Out, connect

from .acquisition.front_end import camera_pins
from .acquisition.laser_guard import LaserGuard
from .acquisition.sequencer import Sequencer
from .capsule import Capsule
from .config import FRAME_US, check_config
from .link.commands import Commands
from .link.receiver import Receiver
from .link.uart_rx import UARTReceiver
from .paper import BOARD, Paper
from .ports import TABLE_PORT, connect_ports
from .protocol import Mode

__all__ = ["Instrument"]


class Instrument(wiring.Component):
    """Exposes an imager, lights the laser, measures and sends, under the control of a host.

    The host loads tables and registers over ``rx`` and starts the sequencer, which takes pattern
    and texture frames in turn. :class:`.capsule.Capsule` or :class:`.paper.Paper` measures them, as
    the preset says. Registers and tables that the host changed begin to act together, with the
    start of a pattern frame at which no spot is on its way, or at once while the sequencer is
    stopped. A stop waits for the frame that is being taken, and for nothing else.

    Parameters
    ----------
    config : :class:`hdl.config.Config`
        Constructor choices.
    clock_gated : :class:`bool`
        Make the clock of the spot side a port, see :class:`.capsule.Capsule`.

    Members
    -------
    sensor_reset, sensor_integrate, sensor_read : :py:`Out(1)`
        To the imager: all pixels dark; the global shutter is open; send the frame.
    laser : :py:`Out(1)`
        To an AC-coupled laser driver: toggles with every clock for light.
    frame_valid, line_valid, data : :py:`In(1)`, :py:`In(1)`, :py:`In(8)`
        From the imager, sampled at each rising edge in the domain ``pixel``.
    row, column, convert, data
        Instead of these if the configuration has a converter, see
        :class:`.acquisition.addressed_camera.AddressedCamera`.
    rx, tx : :py:`In(1)`, :py:`Out(1)`
        Serial line, 8N1.
    cts : :py:`In(1)`
        High while the radio takes octets.
    busy : :py:`Out(1)`
        The spot side needs its clock.
    BOARD
        In the preset ``paper`` only: external memory and screen, see :class:`.paper.Paper`.
    """

    def __init__(self, config, clock_gated=False):
        check_config(config)
        read_us = -(-config.width * config.height * 1_000_000 // config.clock_hz)
        if read_us > FRAME_US:
            raise ValueError(
                f"{config.width} x {config.height} pixels take {read_us} us to read at a pixel a "
                f"clock, and a frame may take {FRAME_US} us: make clock_hz more")
        self.config = config
        self.clock_gated = clock_gated
        super().__init__({
            "sensor_reset": Out(1),
            "sensor_integrate": Out(1),
            "sensor_read": Out(1),
            "laser": Out(1),
            **{name: member for name, member in camera_pins(config).items()
               if name != "sensor_read"},
            "rx": In(1, init=1),
            "tx": Out(1, init=1),
            "cts": In(1),
            "busy": Out(1),
            **(BOARD if config.preset == "paper" else {}),
        })

    def elaborate(self, platform):
        m = Module()
        config = self.config
        m.submodules.uart_rx = uart_rx = UARTReceiver()
        m.submodules.receiver = receiver = Receiver()
        m.submodules.commands = commands = Commands(
            config.width, config.height, config.beams, config.lanes, config.preset,
            config.clock_hz, config.baud)
        m.submodules.sequencer = sequencer = Sequencer(config.clock_hz, frame_us=FRAME_US)
        m.submodules.laser_guard = guard = LaserGuard(config.clock_hz)
        measure_class = Paper if config.preset == "paper" else Capsule
        m.submodules.measure = measure = measure_class(config, self.clock_gated)
        self._connect_host(m, uart_rx, receiver, commands)
        self._connect_exposure(m, sequencer, guard, commands, measure)
        self._connect_measure(m, measure, sequencer, guard, commands)
        self._connect_state(m, commands, sequencer, guard, measure)
        return m

    def _connect_host(self, m, uart_rx, receiver, commands):
        """The host's commands."""
        connect(m, uart_rx.o, receiver.i)
        connect(m, receiver.o, commands.i)
        m.d.comb += [
            uart_rx.rx.eq(self.rx),
            uart_rx.divisor.eq(commands.divisor),
            receiver.address.eq(commands.address),
            receiver.write_enable.eq(commands.write_enable),
            receiver.write_data.eq(commands.write_data),
            commands.data.eq(receiver.data),
            commands.damaged.eq(receiver.damaged),
            commands.framing.eq(uart_rx.framing),
        ]

    def _connect_exposure(self, m, sequencer, guard, commands, measure):
        """Exposure, and the laser guard behind it."""
        m.d.comb += [
            *(getattr(sequencer, name).eq(getattr(commands, name))
              for name in sequencer.registers if name != "mode"),
            sequencer.mode.eq(Mux(commands.stop, Mode.STOP, commands.mode)),
            sequencer.laser_armed.eq(guard.armed),
            sequencer.lit.eq(guard.lit),
            sequencer.capture.eq(commands.capture),
            *(getattr(sequencer, name).eq(getattr(measure, name))
              for name in ("frame_begun", "frame_ended", "frame_broken")),
            sequencer.sending.eq(measure.frame_sending),
            *(getattr(self, name).eq(getattr(sequencer, name))
              for name in ("sensor_reset", "sensor_integrate", "sensor_read")),
            guard.request.eq(sequencer.laser_request),
            guard.tables_valid.eq(commands.tables_valid),
            guard.capture.eq(commands.capture),
            guard.heartbeat.eq(sequencer.heartbeat),
            guard.clear.eq(commands.clear),
            self.laser.eq(guard.laser),
        ]

    def _connect_measure(self, m, measure, sequencer, guard, commands):
        """Pixels to points, and everything to the reader."""
        paper = self.config.preset == "paper"
        connect_ports(m, camera_pins(self.config) | (BOARD if paper else {}), self, measure)
        connect_ports(m, measure.registers | TABLE_PORT, commands, measure)
        if paper:
            connect(m, commands.memory, measure.memory)
            connect(m, measure.memory_word, commands.memory_word)
            m.d.comb += commands.display.eq(measure.display_faults)
        connect(m, commands.o, measure.reply)
        cts = Signal()
        m.submodules.cts_synchronizer = FFSynchronizer(self.cts, cts)
        m.d.comb += [
            measure.tag.eq(sequencer.tag),
            measure.tripped.eq(guard.causes.any()),
            measure.tables_valid.eq(commands.tables_valid),
            measure.cts.eq(cts),
            measure.wake.eq(sequencer.frame_start),
            self.tx.eq(measure.tx),
            self.busy.eq(measure.busy),
        ]

    def _connect_state(self, m, commands, sequencer, guard, measure):
        """When written values act, and the values for STATUS."""
        # A single pair is over when the sequencer stops.
        running = Signal()
        m.d.sync += running.eq(sequencer.running)
        m.d.comb += [
            commands.table_ready.eq(measure.idle),
            commands.apply.eq(sequencer.pattern_start & measure.idle),
            commands.idle.eq(~sequencer.running & measure.idle & ~measure.sending),
            commands.single_done.eq(running & ~sequencer.running),
            commands.laser_armed.eq(guard.armed),
            commands.sensor_silent.eq(sequencer.silent),
            commands.guard_causes.eq(guard.causes),
            *(getattr(commands, name).eq(getattr(sequencer, name))
              for name in ("pairs", "timeouts", "late")),
            *(getattr(commands, name).eq(getattr(measure, name))
              for name in ("bad_sync", "overrun", "skipped", "packets")),
        ]
