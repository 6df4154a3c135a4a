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
    """Exposes an imager, lights the laser, measures, sends; all as the host tells.

    The host loads tables and registers over ``rx`` and starts the sequencer, which takes pattern
    and texture frames in turn. What measures them is :class:`.capsule.Capsule` or
    :class:`.paper.Paper`, as the preset says. Registers and tables that the host changed are
    handed over together, as a pattern frame begins at whose start no spot is under way; at once
    while the sequencer stands still. Only a stop waits for nothing but the frame that is being
    taken.

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
        To an AC-coupled laser driver: changes with every clock for light.
    frame_valid, line_valid, data : :py:`In(1)`, :py:`In(1)`, :py:`In(8)`
        From the imager, sampled at each rising edge in the domain ``pixel``.
    row, column, convert, data
        In their place if the configuration has a converter, see
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

        # Pins that know no clock of ours.
        cts = Signal()
        m.submodules.cts_synchronizer = FFSynchronizer(self.cts, cts)

        # The host's commands.
        m.submodules.uart_rx = uart_rx = UARTReceiver()
        m.submodules.receiver = receiver = Receiver()
        m.submodules.commands = commands = Commands(
            config.width, config.height, config.beams, config.lanes, config.preset,
            config.clock_hz, config.baud)
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

        # Exposure, and the last word on the laser.
        m.submodules.sequencer = sequencer = Sequencer(config.clock_hz, frame_us=FRAME_US)
        m.submodules.laser_guard = guard = LaserGuard(config.clock_hz)
        m.d.comb += [
            *(getattr(sequencer, name).eq(getattr(commands, name))
              for name in sequencer.registers if name != "mode"),
            sequencer.mode.eq(Mux(commands.stop, Mode.STOP, commands.mode)),
            sequencer.laser_armed.eq(guard.armed),
            sequencer.lit.eq(guard.lit),
            sequencer.capture.eq(commands.capture),
            self.sensor_reset.eq(sequencer.sensor_reset),
            self.sensor_integrate.eq(sequencer.sensor_integrate),
            self.sensor_read.eq(sequencer.sensor_read),
            guard.request.eq(sequencer.laser_request),
            guard.tables_valid.eq(commands.tables_valid),
            guard.capture.eq(commands.capture),
            guard.heartbeat.eq(sequencer.heartbeat),
            guard.clear.eq(commands.clear),
            self.laser.eq(guard.laser),
        ]

        # Pixels to points, and everything to the reader.
        paper = config.preset == "paper"
        m.submodules.measure = measure = (Paper if paper else Capsule)(config, self.clock_gated)
        connect_ports(m, camera_pins(config) | (BOARD if paper else {}), self, measure)
        connect_ports(m, measure.registers | TABLE_PORT, commands, measure)
        if paper:
            connect(m, commands.memory, measure.memory)
            connect(m, measure.memory_word, commands.memory_word)
            m.d.comb += commands.display.eq(measure.display_faults)
        connect(m, commands.o, measure.reply)
        m.d.comb += [
            measure.tag.eq(sequencer.tag),
            measure.tripped.eq(guard.causes.any()),
            measure.tables_valid.eq(commands.tables_valid),
            measure.cts.eq(cts),
            self.tx.eq(measure.tx),
            self.busy.eq(measure.busy),
            measure.wake.eq(sequencer.frame_start),
            sequencer.frame_begun.eq(measure.frame_begun),
            sequencer.frame_ended.eq(measure.frame_ended),
            sequencer.frame_broken.eq(measure.frame_broken),
            sequencer.sending.eq(measure.frame_sending),
        ]

        # What was written acts together. A single pair is over when the sequencer comes to rest.
        running = Signal()
        m.d.sync += running.eq(sequencer.running)
        m.d.comb += [
            commands.table_ready.eq(measure.idle),
            commands.apply.eq(sequencer.pattern_start & measure.idle),
            commands.idle.eq(~sequencer.running & measure.idle & ~measure.sending),
            commands.single_done.eq(running & ~sequencer.running),
        ]

        # What STATUS tells.
        m.d.comb += [
            commands.laser_armed.eq(guard.armed),
            commands.sensor_silent.eq(sequencer.silent),
            commands.guard_causes.eq(guard.causes),
            commands.pairs.eq(sequencer.pairs),
            commands.timeouts.eq(sequencer.timeouts),
            commands.late.eq(sequencer.late),
            *(getattr(commands, name).eq(getattr(measure, name))
              for name in ("bad_sync", "overrun", "skipped", "packets")),
        ]
        return m
