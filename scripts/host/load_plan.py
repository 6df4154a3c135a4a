"""What ``cyclope load`` does to the chip, and what is true if that is cut short."""

from dataclasses import dataclass, field

from hdl.protocol import Mode
from model.errors import UserError
from scripts.host.chip import REGISTERS, check_chip
from scripts.host.guard import TIMES, find_trips
from scripts.host.loading import load, points_carried, stop, wait_until, write_registers
from scripts.host.status import HEARTBEAT

__all__ = ["MODES", "LoadPlan", "fit_patterns"]

#: Ways to run: the mode, and the register ``pattern_as_texture``.
MODES = {"start": (Mode.CONTINUOUS, 0), "stop": (Mode.STOP, 0), "single": (Mode.SINGLE, 0),
         "pattern-only": (Mode.PATTERN, 0), "pattern-images": (Mode.PATTERN, 1)}
#: Seconds to wait until the chip has done what was asked.
_PATIENCE = 10.0


def fit_patterns(beams, baud, period_us, full_records=False):
    """The largest share of pattern frames whose points the line carries: one in so many.

    That of the register ``pattern_every`` at the most, even if the line is still slower.
    """
    most = (1 << REGISTERS["pattern_every"].bits) - 1
    return next((every for every in range(1, most) if points_carried(
        baud, every * period_us, full_records) >= beams), most)


@dataclass
class LoadPlan:
    """What is to be done with the chip, and how far that is.

    Parameters
    ----------
    calibration : :class:`calibration.file.Calibration` or None
        Tables to load.
    chosen : dict of :class:`int`
        Registers to write, by their names.
    mode : :class:`hdl.protocol.Mode` or None
        How it is to run; None for the mode it is in.
    pattern_as_texture : :class:`int` or None
        Likewise the register of that name.
    clear : :class:`bool`
        Clear the causes that the laser guard holds.
    capture_ms : :class:`int` or None
        Duration of a calibration capture.
    """

    calibration: object
    chosen: dict
    mode: Mode | None
    pattern_as_texture: int | None
    clear: bool
    capture_ms: int | None
    began: bool = False  # something may have changed in the chip
    tables: str = "as they were"
    registers: bool = False  # all are written
    identity: dict = field(default_factory=dict)  # of the chip
    before: dict = field(default_factory=dict)  # the status

    def check(self, commands):
        """Refuse what the chip cannot take, before anything is changed; fit the plan to the line.

        Returns
        -------
        list of :class:`str`
            Warnings: why the laser guard may trip, and that the line is too slow for the mesh.

        Raises
        ------
        UserError
            If the calibration is for another chip, or the laser guard is sure to trip.
        """
        self.identity, before = commands.identify(), commands.status()
        self.before = before
        if self.calibration is not None:
            check_chip(self.identity, self.calibration)
            self.mode = before["state"].mode if self.mode is None else self.mode
        mode = before["state"].mode if self.mode is None else self.mode
        warnings = []
        if mode != Mode.STOP and (self.mode is not None or self.chosen.keys() & set(TIMES)):
            certain, possible = find_trips(mode, self._registers(commands, TIMES), self.identity)
            if certain:
                raise UserError(f"The laser guard would trip: {'; '.join(certain)}.")
            warnings = [f"the laser guard may trip: {reason}." for reason in possible]
        return warnings + self._fit_line(commands)

    def _registers(self, commands, names):
        """Values that registers will have, by name: those to be written, or the chip's."""
        return {name: self.chosen[name] if name in self.chosen else commands.read(name)
                for name in names}

    def _fit_line(self, commands):
        """Choose ``pattern_every`` so that the line can carry the mesh, unless it was chosen.

        Gives what a line that is too slow for all points of every pattern frame leads to, in a
        list.
        """
        if self.calibration is None:
            return []
        clocks, period_us, full_records = self._registers(
            commands, ("divisor", "period_us", "full_records")).values()
        beams = len(self.calibration.settings.line)
        baud = self.identity["clock_khz"] * 1000 / max(1, clocks)

        def carried(every):
            return points_carried(baud, every * period_us, full_records)

        every = self.chosen.setdefault(
            "pattern_every", fit_patterns(beams, baud, period_us, full_records))
        slow = f"at {baud:,.0f} baud the line carries about {carried(1)} of {beams} points in " \
               f"{period_us / 1000:g} ms"
        if carried(max(1, every)) < beams:
            return [slow + (f", {carried(every)} in {every} times that" if every > 1 else "")
                    + ": the others, spread over the mesh, are dropped and counted."]
        return [] if every <= 1 else [
            f"{slow}: the chip measures one pattern frame in {every}, "
            f"{1e6 / (every * period_us):.3g} a second."]

    def carry_out(self, commands, progress=None):
        """Change the chip; ``progress`` as for :func:`scripts.host.loading.load`.

        Images for a calibration come without loss, other textures as after a reset, unless
        ``chosen`` has another ``texture_bound``.
        """
        self.began = True
        if self.pattern_as_texture or self.calibration is not None:
            self.chosen.setdefault("texture_bound", 0 if self.pattern_as_texture
                                   else REGISTERS["texture_bound"].reset)
        if self.calibration is not None:
            self.chosen.setdefault("texture_mosaic", int(self.calibration.bayer is not None))
            stop(commands)
            self.tables = "incomplete"
            load(commands, self.calibration, progress)
            self.tables = "loaded"
        elif self.mode == Mode.STOP:
            stop(commands)
        write_registers(commands, self.chosen)
        self.registers = True
        if self.clear:
            commands.clear()
        if self.capture_ms is not None:
            commands.capture(self.capture_ms)
        if self.pattern_as_texture is not None and (
                commands.read("pattern_as_texture") != self.pattern_as_texture):
            commands.write("pattern_as_texture", self.pattern_as_texture)
        if self.mode is not None:
            commands.write("mode", self.mode)

    def settle(self, commands):
        """Wait until the chip does what was asked; gives its status.

        A chip that stood still has missed its laser guard's heartbeat: that is cleared, as long as
        the guard held nothing else.
        """
        runs = self.mode not in (None, Mode.STOP)

        def done(state):
            # Tables are taken at a frame's start, and then it takes two frames to arm the laser.
            light = state.armed or not (state.tables_valid or state.capture)
            return not state.committing and (
                not runs or state.mode == self.mode and light
                or self.mode == Mode.SINGLE and state.mode == Mode.STOP)

        status = wait_until(commands, done, _PATIENCE if runs else _PATIENCE / 3)
        stood = self.before["state"].mode == Mode.STOP or (
            self.calibration is not None and not self.before["guard_causes"])
        if status["state"].armed and status["guard_causes"] == HEARTBEAT and stood:
            commands.clear()
            status = commands.status()
        return status

    def describe(self, owner, again):
        """The state of the chip after an early end, in words.

        Parameters
        ----------
        owner : :class:`scripts.host.owner.PortOwner`
            To ask the chip, if it still answers.
        again : :class:`str`
            The command that does it all.
        """
        if not self.began:
            return "Nothing was changed in the chip."
        tables = {
            "incomplete": "the new tables are not complete",
            "loaded": "the new tables are loaded" + (
                "" if self.registers else ", though not all of their registers"),
            "as they were": "the registers are written" if self.registers else
                            "not all registers are written"}[self.tables]
        try:
            state = owner.commands(timeout=0.5, tries=2).status()["state"]
        except (UserError, KeyboardInterrupt):
            mode = "was stopped" if self.tables != "as they were" else "may have changed"
        else:
            mode = "is stopped" if state.mode == Mode.STOP else "is running"
            if not (state.tables_valid or state.committing):
                tables += ", and without valid ones the laser stays off"
        return f"The chip {mode}, {tables}: `{again}` does it all."
